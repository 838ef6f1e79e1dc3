# SPDX-License-Identifier: MIT
"""Where compiled kernels are kept, so that a command waits for the compiler once and not each time."""

from __future__ import annotations

import os
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent
_SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - a private folder is made in it


def prepare() -> None:
    """Make sure that numba finds a folder for compiled kernels; call it before anything imports numba.

    Numba keeps them beside the modules, or where it cannot write there in the user's cache folder, and refuses to work
    where it can write to neither (a read-only image without a home), even if all that it needs is there. A private
    temporary folder serves then; what a read-only ``$NUMBA_CACHE_DIR`` holds is linked into it.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given is None:
        if _can_write(_PACKAGE / "__pycache__") or _can_write(_user_cache()):
            return
    elif _can_write(Path(given)):
        return
    folder = _private_temporary_folder()
    if given is not None:
        _link_kernels(Path(given), folder)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


def directory() -> Path:
    """Return the folder that holds the compiled kernels of this installation."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return Path(os.environ["NUMBA_CACHE_DIR"])
    return _PACKAGE if _can_write(_PACKAGE / "__pycache__") else _user_cache()


def is_filled(room: str) -> bool:
    """Return whether kernels of a room (``gmapping``) have been compiled here before."""
    found = directory().rglob("*kernels*.nbi")
    return any(path.parent.parent.name == room or path.parent.name.startswith(f"{room}_") for path in found)


def _link_kernels(source: Path, folder: Path) -> None:
    """Link compiled kernels of one cache folder into another; what was compiled there stays.

    Numba replaces a link when it has something to add, and never writes through one.
    """
    for kernel in source.rglob("*.nb[ic]"):
        link = folder / kernel.relative_to(source)
        link.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not os.path.lexists(link):
            link.symlink_to(kernel.resolve())


def _user_cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    return Path(base) / "numba"


def _can_write(folder: Path) -> bool:
    """Whether files can be made in a folder, or the folder itself can be made."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


def _private_temporary_folder() -> Path:
    """Return a folder that is this user's only: compiled code is loaded from it."""
    import tempfile

    root = Path(tempfile.gettempdir())
    if root == Path.cwd() and _can_write(_SHARED_MEMORY):  # no /tmp: better there than among the user's files
        root = _SHARED_MEMORY
    folder = root / f"slamcli-kernels-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="slamcli-kernels-", dir=root))
    private = (
        folder.is_dir() and not folder.is_symlink() and status.st_uid == os.getuid() and not status.st_mode & 0o077
    )
    return folder if private else Path(tempfile.mkdtemp(prefix="slamcli-kernels-", dir=root))
