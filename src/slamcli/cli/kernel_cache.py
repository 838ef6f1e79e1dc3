# SPDX-License-Identifier: MIT
"""Where compiled kernels are kept, so that a command waits for the compiler once and not each time."""

from __future__ import annotations

import os
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def prepare() -> None:
    """Make sure that numba finds a folder for compiled kernels; call it before anything imports numba.

    Numba keeps them beside the modules, or where it cannot write there in the user's cache folder, and refuses to work
    where it can write to neither (a read-only image without a home). A private temporary folder serves then.
    """
    if "NUMBA_CACHE_DIR" in os.environ or _can_write(_PACKAGE / "__pycache__") or _can_write(_user_cache()):
        return
    os.environ["NUMBA_CACHE_DIR"] = str(_private_temporary_folder())


def directory() -> Path:
    """Return the folder that holds the compiled kernels of this installation."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return Path(os.environ["NUMBA_CACHE_DIR"])
    return _PACKAGE if _can_write(_PACKAGE / "__pycache__") else _user_cache()


def is_filled(room: str) -> bool:
    """Return whether kernels of a room (``gmapping``) have been compiled here before."""
    found = directory().rglob("*kernels*.nbi")
    return any(path.parent.parent.name == room or path.parent.name.startswith(f"{room}_") for path in found)


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

    folder = Path(tempfile.gettempdir()) / f"slamcli-kernels-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="slamcli-kernels-"))
    private = (
        folder.is_dir() and not folder.is_symlink() and status.st_uid == os.getuid() and not status.st_mode & 0o077
    )
    return folder if private else Path(tempfile.mkdtemp(prefix="slamcli-kernels-"))
