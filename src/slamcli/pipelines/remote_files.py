# SPDX-License-Identifier: MIT
"""Files behind addresses: listed, told apart from their earlier selves, and fetched for as long as a run needs them.

``http://`` and ``https://`` need nothing besides Python. ``s3://``, ``gs://`` and ``az://`` go through obstore, everything else
(``memory://``, ``sftp://`` ...) through what fsspec finds installed; stores take their keys from the environment (``AWS_...``).
"""

from __future__ import annotations

import contextlib
import json
import shutil
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import IO, Any
from urllib.parse import unquote, urlsplit

from slamcli.errors import DependencyError, ProcessError, UsageError
from slamcli.outputs import atomic_file

_WEB = ("http", "https")
_OBSTORE = ("s3", "s3a", "gs", "az", "adl", "azure", "abfs", "abfss")
_EXTRA = "pip install 'slamcli[fleet]'"
_BLOCK_BYTES = 8 << 20
_TIMEOUT_S = 60.0
_MARK = ".fetched"
"""Written last: the folder beside it is whole, and of what it was fetched from."""
_BAGS = (".bag", ".mcap", ".db3", ".clf", ".log", ".zst", ".zstd", ".gz", ".tum")
_TELLING = ("size", "ETag", "e_tag", "etag", "last_modified", "LastModified", "mtime", "created", "md5", "version")
"""What stores tell of a file that changes with its content."""

Remote = tuple[str, Path]
"""An address, and where it is to lie: a file or folder of its last part's name, in a folder of its own in the folder of its run."""


def plain_url(url: str) -> str:
    """Return an address without what must not be shown: the signature behind ``?``, a password."""
    scheme, _, rest = url.partition("://")
    host, slash, path = rest.partition("?")[0].partition("/")
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{path}"


def list_remote(url: str) -> list[str]:
    """Return the addresses that one stands for, by name: a pattern, a folder of recordings (with a slash at its end), or itself.

    Raises
    ------
    UsageError
        If nothing is there, or the store cannot be listed.
    DependencyError
        If a library is missing.
    """
    scheme = _scheme(url)
    if scheme in _WEB:
        if "*" in urlsplit(url).path:
            raise UsageError(f"{plain_url(url)}: web servers have no listing: write the addresses into a @list.txt")
        return [url]
    with _told(url):
        files = _filesystem(scheme)
        path = url.partition("://")[2]
        if set(path) & set("*?["):
            found = sorted(map(str, files.glob(path)))
            if "." not in PurePosixPath(path).name:  # as in a folder: what may be a recording
                found = [name for name in found if name.lower().endswith(_BAGS) or files.isdir(name)]
        elif url.endswith("/"):
            found = _in_folder(files, path.rstrip("/"))
        else:
            return [url]
    if not found:
        raise UsageError(f"{url}: nothing is there")
    return [f"{scheme}://{name.lstrip('/')}" for name in found]


def fingerprint(url: str) -> str:
    """Return what the store says of a file or folder (size, tag, time of change), so that a change shows; empty if it says nothing."""
    scheme = _scheme(url)
    if scheme in _WEB:
        with contextlib.suppress(OSError), _open_web(url, "HEAD") as answer:
            names = ("Content-Length", "ETag", "Last-Modified")
            return json.dumps([answer.headers.get(name) for name in names])
        return ""
    with _told(url):
        files, path = _filesystem(scheme), url.partition("://")[2]
        details = files.find(path, detail=True) if files.isdir(path) else {path: files.info(path)}
        told = [[str(details[name].get(key)) for key in _TELLING] for name in sorted(details)]
        return json.dumps([sorted(map(str, details)), told])


@contextlib.contextmanager
def fetched(
    remotes: Sequence[Remote], *, keep: bool = False, is_stopped: Callable[[], bool] = lambda: False
) -> Iterator[None]:
    """Have files in their places while the block runs; they are removed after it unless they are to be kept.

    A block of 8 MB is held in memory at a time. What an earlier run kept is used if the store still has the same.

    Raises
    ------
    ProcessError
        If something cannot be fetched.
    InterruptedError
        If it was stopped.
    """
    folders = {place.parent for _, place in remotes}
    try:
        for url, place in remotes:
            _fetch(url, place, is_stopped)
        yield
    finally:
        if not keep:
            for folder in folders:
                shutil.rmtree(folder, ignore_errors=True)
                with contextlib.suppress(OSError):  # of this run: once it is empty
                    folder.parent.rmdir()


def local_name(url: str) -> str:
    """Return the name of a fetched file."""
    return PurePosixPath(unquote(plain_url(url).rstrip("/"))).name


def _fetch(url: str, place: Path, is_stopped: Callable[[], bool]) -> None:
    mark = place.parent / _MARK
    now = json.dumps([plain_url(url), fingerprint(url)])
    with contextlib.suppress(OSError):
        if place.exists() and mark.read_text(encoding="utf-8") == now:
            return
    shutil.rmtree(place.parent, ignore_errors=True)
    with _told(url):
        scheme, path = _scheme(url), url.partition("://")[2].rstrip("/")
        if scheme in _WEB:
            with _open_web(url) as stream:
                length = stream.headers.get("Content-Length", "")
                _copy(stream, place, is_stopped, int(length) if length.isdecimal() else None)
        else:
            files = _filesystem(scheme)
            if files.isdir(path):
                for name in files.find(path):
                    inside = str(name).strip("/").removeprefix(path.strip("/")).strip("/")
                    if ".." in PurePosixPath(inside).parts:
                        raise UsageError(f"{url}: {name!r} leads out of it")
                    with files.open(name, "rb") as stream:
                        _copy(stream, place / inside, is_stopped)
            else:
                with files.open(path, "rb") as stream:
                    _copy(stream, place, is_stopped)
    with atomic_file(mark) as stream:
        stream.write(now)


def _copy(stream: IO[bytes], place: Path, is_stopped: Callable[[], bool], size_bytes: int | None = None) -> None:
    copied = 0
    with atomic_file(place, "wb") as target:
        while block := stream.read(_BLOCK_BYTES):
            if is_stopped():
                raise InterruptedError
            copied += target.write(block)
        if size_bytes not in (None, copied):  # urllib says nothing of an answer that was cut off
            raise ProcessError(f"only {copied:,} of {size_bytes:,} bytes came")


def _in_folder(files: Any, folder: str) -> list[str]:
    """Return the recordings in a folder: bags, and folders that hold one; the folder itself if it is a bag."""
    names = {str(entry["name"]).rstrip("/"): entry["type"] for entry in files.ls(folder, detail=True)}
    if any(PurePosixPath(name).name == "metadata.yaml" for name in names):
        return [folder]
    bags = [name for name, kind in names.items() if kind == "file" and name.lower().endswith(_BAGS)]
    inner = [name for name, kind in names.items() if kind == "directory" and files.exists(f"{name}/metadata.yaml")]
    return sorted([*bags, *inner])


def _open_web(url: str, method: str = "GET") -> Any:
    request = urllib.request.Request(url, method=method, headers={"User-Agent": "slamcli"})  # noqa: S310 - see _scheme
    return urllib.request.urlopen(request, timeout=_TIMEOUT_S)  # noqa: S310


def _filesystem(scheme: str) -> Any:
    """Return the fsspec file system of a scheme.

    Raises
    ------
    DependencyError
        If a library is missing; the message says which.
    UsageError
        If nobody knows the scheme.
    """
    try:
        import fsspec
    except ImportError as error:
        raise DependencyError(f"{scheme}:// needs fsspec: {_EXTRA}") from error
    if scheme in _OBSTORE:
        try:
            from obstore.fsspec import FsspecStore
        except ImportError as error:
            raise DependencyError(f"{scheme}:// needs obstore: {_EXTRA}") from error
        return FsspecStore(scheme)
    try:
        return fsspec.filesystem(scheme)
    except ImportError as error:
        raise DependencyError(f"{scheme}:// needs a library that is missing: {error}") from error
    except ValueError as error:
        raise UsageError(f"{scheme}:// is no store that fsspec knows") from error


def _scheme(url: str) -> str:
    return url.partition("://")[0].lower()


@contextlib.contextmanager
def _told(url: str) -> Iterator[None]:
    """Turn whatever a store's library raises into one line."""
    try:
        yield
    except (DependencyError, UsageError, InterruptedError):
        raise
    except FileNotFoundError as error:
        raise ProcessError(f"{plain_url(url)}: nothing is there") from error
    except Exception as error:
        reason = " ".join((str(error).partition("Debug source")[0] or type(error).__name__).split())
        raise ProcessError(f"{plain_url(url)}: cannot be fetched: {reason[:300]}") from error
