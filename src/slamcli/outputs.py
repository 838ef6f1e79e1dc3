# SPDX-License-Identifier: MIT
"""Files that appear whole or not at all: written under a temporary name, then moved into place."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import json
import os
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from slamcli.errors import UsageError

_TEMPORARY_PREFIX = f".slamcli-{zlib.crc32(os.uname().nodename.encode()):08x}"
"""With the machine in the name: only its own processes can be known to be gone."""
_RENAME_EXCHANGE = 2
_AT_FDCWD = -100


@contextlib.contextmanager
def atomic_path(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside `target` that is moved over it when the block ends without an error.

    The temporary file keeps the suffix of `target`, because writers choose their format by it.

    Raises
    ------
    UsageError
        If the folder of `target` does not exist and cannot be made, or cannot be written to, or if `target`
        is a folder.
    """
    target = Path(target)
    if target.is_dir():
        raise UsageError(f"{target} is a folder: name a file in it")
    with _writable(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(target.parent)
        handle, name = tempfile.mkstemp(prefix=_prefix(), suffix=target.suffix, dir=target.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        _flush(temporary)
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_file(target: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a file for writing (`mode` "w" or "wb") that replaces `target` when the block ends without an error."""
    with atomic_path(target) as temporary:
        text = "b" not in mode
        with temporary.open(mode, encoding="utf-8" if text else None, newline="\n" if text else None) as stream:
            yield stream


@contextlib.contextmanager
def atomic_directory(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary folder that takes the place of `target` when the block ends without an error.

    Files in an existing `target` that an earlier run wrote (listed under ``outputs`` in its ``run.json``) go away with
    it; everything else that lies there is carried over.

    Raises
    ------
    UsageError
        If `target` is a file, the current folder or one above it, or cannot be written to.
    """
    target = Path(target)
    resolved = target.resolve()
    check_directory(target)
    with _writable(target):
        resolved.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(resolved.parent)
        temporary = Path(tempfile.mkdtemp(prefix=_prefix(), dir=resolved.parent))
    try:
        yield temporary
        for path in temporary.rglob("*"):
            if path.is_file():
                _flush(path)
        temporary.chmod(0o777 & ~_umask())
        if resolved.exists():
            _carry_over(resolved, temporary)
            _exchange(temporary, resolved)
        else:
            temporary.rename(resolved)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_directory(target: str | os.PathLike[str]) -> None:
    """Raise what `atomic_directory` would for a target that cannot be one: worth knowing before long work.

    Raises
    ------
    UsageError
        If `target` is a file, or the current folder or one above it, or cannot be made or written.
    """
    target = Path(target)
    if target.exists() and not target.is_dir():
        raise UsageError(f"{target} is a file: name a folder for the output")
    if Path.cwd().is_relative_to(target.resolve()):
        raise UsageError(f"{target} is the folder you are in (or above it): name a new folder for the output")
    _check_place(target)


def check_file(target: str | os.PathLike[str]) -> None:
    """Raise if `target` is a folder or cannot be made: worth knowing before long work.

    Raises
    ------
    UsageError
        With the reason.
    """
    target = Path(target)
    if target.is_dir():
        raise UsageError(f"{target} is a folder: name a file for the output")
    _check_place(target)


def _check_place(target: Path) -> None:
    """Raise if nothing can be written where `target` is to be."""
    above = next(folder for folder in target.resolve().parents if folder.exists())
    if not above.is_dir():
        raise UsageError(f"cannot write {target}: {above} is a file")
    with _writable(target):  # by trying: os.access knows neither read-only file systems nor root
        Path(tempfile.mkdtemp(prefix=_prefix(), dir=above)).rmdir()


@contextlib.contextmanager
def _writable(target: Path) -> Iterator[None]:
    try:
        yield
    except (FileExistsError, NotADirectoryError) as error:
        raise UsageError(f"cannot write {target}: {error.filename} is a file") from error
    except OSError as error:
        raise UsageError(f"cannot write {target}: {error.strerror or error}") from error


def _carry_over(old: Path, new: Path) -> None:
    """Link what lies in `old` and is not an earlier run's output into `new`, unless `new` has its own."""
    try:
        ours = set(json.loads((old / "run.json").read_text(encoding="utf-8"))["outputs"])
    except (OSError, ValueError, KeyError, TypeError):
        ours = set()
    for path in sorted(old.rglob("*")):
        name = path.relative_to(old)
        copy = new / name
        if path.is_dir() or str(name) in ours or copy.exists():
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path.is_symlink():
            copy.symlink_to(path.readlink())
        else:
            os.link(path, copy)


def _exchange(new: Path, old: Path) -> None:
    """Swap two folders in one step where the system can, in two where it cannot."""
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
        if renameat2(_AT_FDCWD, os.fsencode(new), _AT_FDCWD, os.fsencode(old), _RENAME_EXCHANGE) == 0:
            return
        if ctypes.get_errno() not in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP):
            raise UsageError(f"cannot replace {old}: {os.strerror(ctypes.get_errno())}")
    except (AttributeError, OSError):
        pass
    aside = Path(tempfile.mkdtemp(prefix=_prefix(), dir=old.parent)) / "old"
    old.rename(aside)
    new.rename(old)
    shutil.rmtree(aside.parent, ignore_errors=True)


def _prefix() -> str:
    return f"{_TEMPORARY_PREFIX}-{os.getpid()}-"


def _remove_stale(folder: Path) -> None:
    """Remove what processes of this machine that were killed left behind in `folder`."""
    for path in folder.glob(f"{_TEMPORARY_PREFIX}-*"):
        owner = path.name.removeprefix(f"{_TEMPORARY_PREFIX}-").partition("-")[0]
        if not owner.isdecimal() or _is_running(int(owner)):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with contextlib.suppress(OSError):
                path.unlink()


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _flush(path: Path) -> None:
    with path.open("rb") as stream:
        os.fsync(stream.fileno())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
