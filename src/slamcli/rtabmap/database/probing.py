# SPDX-License-Identifier: MIT
"""What can be told of a file without opening it as a database: whether it is one of RTAB-Map, and whether it is in use."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from urllib.parse import quote

_MAGIC = b"SQLite format 3\0"
_TABLES = {"Node", "Link", "Admin"}
_WAIT_S = 0.2


def is_database(path: Path) -> bool:
    """Return whether a file is a database of RTAB-Map, by its tables: bags of ROS 2 are SQLite files as well."""
    try:
        with path.open("rb") as stream:
            if stream.read(len(_MAGIC)) != _MAGIC:
                return False
        connection = sqlite3.connect(_address(path, "ro"), uri=True, timeout=_WAIT_S)
    except (OSError, sqlite3.Error):
        return False
    try:
        names = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}
    except (sqlite3.Error, UnicodeError) as error:
        return _is_busy(error)  # bags are not locked while they are read
    finally:
        connection.close()
    return names >= _TABLES


def is_in_use(path: Path) -> bool:
    """Return whether another process writes to a database; False for what is none, or is not there."""
    if not path.is_file() or not path.stat().st_size:
        return False
    try:
        connection = sqlite3.connect(_address(path, "rw"), uri=True, timeout=_WAIT_S, isolation_level=None)
        try:
            connection.execute("BEGIN EXCLUSIVE")
        finally:
            connection.close()
    except sqlite3.Error as error:
        return _is_busy(error)
    return False


def count_committed_nodes(path: Path) -> int:
    """Return how many nodes are in a database that this process may have open still: its lock is passed by; 0 for what is none."""
    try:
        connection = sqlite3.connect(_address(path, "ro") + "&immutable=1", uri=True)
        try:
            return int(connection.execute("SELECT COUNT(*) FROM Node").fetchone()[0])
        finally:
            connection.close()
    except sqlite3.Error:
        return 0


def _address(path: Path, mode: str) -> str:
    return f"file:{quote(str(path.absolute()))}?mode={mode}"


def _is_busy(error: Exception) -> bool:
    return (getattr(error, "sqlite_errorname", "") or "").startswith(("SQLITE_BUSY", "SQLITE_LOCKED"))
