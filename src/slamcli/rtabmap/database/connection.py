# SPDX-License-Identifier: MIT
"""Opening a database: one process at a time, clear errors, and a clock that is not the wall's."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from slamcli.errors import FormatError
from slamcli.rtabmap.database.older_versions import show_as_current
from slamcli.rtabmap.database.records import StorageSettings
from slamcli.rtabmap.database.schema import Layout, check_extendable, create_tables, read_layout

Mode = Literal["create", "append", "read"]
_MAGIC = b"SQLite format 3\0"
_JOURNALS = (
    "DELETE",
    "TRUNCATE",
    "PERSIST",
    "DELETE",
    "DELETE",
)  # RTAB-Map's MEMORY and OFF do not outlive a killed run
_SYNCHRONOUS = ("OFF", "NORMAL", "FULL")
_STORES = ("DEFAULT", "FILE", "MEMORY")
_BESIDE = ("-journal", "-wal", "-shm")
_WAIT_S = 0.2


@dataclass(slots=True)
class Clock:
    """What ``DATETIME('NOW')`` gives in the schema's triggers: the latest stamp of a node, so that the same run writes the same bytes."""

    now: str = "1970-01-01 00:00:00"

    def advance(self, stamp_ns: int) -> None:
        """Set the time to a node's stamp, unless it was later already."""
        moment = datetime.fromtimestamp(stamp_ns // 1_000_000_000, tz=UTC).strftime("%Y-%m-%d %H:%M:%S")
        self.now = max(self.now, moment.zfill(19))

    def __call__(self, _: object) -> str:
        """Return the time as SQLite's function does."""
        return self.now


@dataclass(slots=True)
class OpenFile:
    """An open database."""

    path: Path
    mode: Mode
    connection: sqlite3.Connection
    layout: Layout
    clock: Clock = field(default_factory=Clock)
    disk: sqlite3.Connection | None = None
    """The file, where `connection` is in memory."""

    def close(self) -> None:
        """Write what was committed to the file, where it is in memory, and close it; what was not committed is forgotten."""
        try:
            with sqlite_errors(self.path):
                if self.connection.in_transaction:
                    self.connection.rollback()
                if self.disk is not None:
                    self.connection.backup(self.disk)
        finally:
            self.connection.close()
            if self.disk is not None:
                self.disk.close()


def open_file(path: Path, mode: Mode, settings: StorageSettings, *, overwrite: bool = False) -> OpenFile:
    """Return the open database.

    A database that is written is locked by SQLite for this process until it is closed or the process ends, however it ends.

    Raises
    ------
    FormatError
        If the file is missing, no database, another program's or of another version, in use, or cannot be written.
    """
    if mode == "create":
        _make_way(path, overwrite=overwrite)
    else:
        _check_file(path)
    with sqlite_errors(path):
        connection = _connect(path, mode)
        try:
            return _prepare(path, mode, settings, connection)
        except BaseException:
            connection.close()
            raise


@contextmanager
def sqlite_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's errors into one line that says what to do."""
    try:
        yield
    except sqlite3.Error as error:
        name = getattr(error, "sqlite_errorname", "") or ""
        raise FormatError(f"{path}: {_explained(name)} ({error})") from error
    except UnicodeError as error:  # in a message of SQLite's, or in a text
        raise FormatError(
            f"{path}: {_explained('SQLITE_CORRUPT')} ({error.reason if isinstance(error, UnicodeDecodeError) else error})"
        ) from error


def _explained(name: str) -> str:
    begun = {
        "SQLITE_BUSY": "another process uses this database; wait until it has ended, or give another file",
        "SQLITE_LOCKED": "another process uses this database; wait until it has ended, or give another file",
        "SQLITE_FULL": "the disk is full: everything committed before is in the file; make room and continue it",
        "SQLITE_IOERR": "the file could not be read or written: everything committed before is in the file; look at the disk",
        "SQLITE_READONLY": "the file or its folder is read-only; copy it to where it can be written",
        "SQLITE_CANTOPEN": "the file cannot be opened here; look at the folder and its permissions",
        "SQLITE_NOTADB": "not a database",
        "SQLITE_CORRUPT": "the database is damaged; sqlite3's .recover may save what is left",
        "SQLITE_CONSTRAINT": "the database has this already, or lacks what it should refer to",
    }
    return next((text for start, text in begun.items() if name.startswith(start)), "SQLite refused")


def _check_file(path: Path) -> None:
    if path.is_dir():
        raise FormatError(f"{path}: a folder, not a database")
    try:
        with path.open("rb") as file:
            head = file.read(len(_MAGIC))
    except FileNotFoundError:
        raise FormatError(f"{path}: there is no such database") from None
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror})") from error
    if head != _MAGIC:
        what = "an empty file" if not head else "not an SQLite database"
        raise FormatError(f"{path}: {what}; give a .db of RTAB-Map or of slamcli")


def _make_way(path: Path, *, overwrite: bool) -> None:
    """Remove a database that is to be written anew, unless it is in use."""
    if path.is_dir() or not path.parent.is_dir():
        raise FormatError(f"{path}: a database cannot be written there; give a file in a folder that exists")
    if not path.exists():
        return
    if not overwrite:
        raise FormatError(f"{path}: exists already; continue it, remove it, or give another name")
    if path.stat().st_size:
        _check_file(path)
        with sqlite_errors(path):
            old = sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)
            try:
                old.execute("BEGIN EXCLUSIVE")
            finally:
                old.close()
    try:
        for name in (path, *(path.with_name(path.name + ending) for ending in _BESIDE)):
            name.unlink(missing_ok=True)
    except OSError as error:
        raise FormatError(f"{path}: cannot be replaced ({error.strerror})") from error


def _connect(path: Path, mode: Mode) -> sqlite3.Connection:
    left = any(path.with_name(path.name + ending).exists() for ending in _BESIDE)
    rights = "rwc" if mode == "create" else "rw" if mode == "append" or (left and os.access(path, os.W_OK)) else "ro"
    return sqlite3.connect(
        f"file:{quote(str(path.absolute()))}?mode={rights}",
        uri=True,
        timeout=_WAIT_S,
        isolation_level=None,
        check_same_thread=False,
    )


def _prepare(path: Path, mode: Mode, settings: StorageSettings, connection: sqlite3.Connection) -> OpenFile:
    if mode == "read":
        layout = read_layout(connection, str(path))
        show_as_current(connection, layout)
        connection.execute("PRAGMA query_only = ON")
        connection.execute("BEGIN")
        connection.execute("SELECT version FROM Admin").fetchone()  # from here on the same state, as long as it is open
        return OpenFile(path, mode, connection, layout)
    connection.execute("PRAGMA locking_mode = EXCLUSIVE")
    if mode == "append":
        check_extendable(read_layout(connection, str(path)), str(path))
    _tune(connection, settings)
    connection.execute("BEGIN EXCLUSIVE")
    if mode == "create":
        create_tables(connection)
    connection.execute("COMMIT")
    disk = None
    if settings.in_memory:
        disk, connection = connection, sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False)
        disk.backup(connection)
        _tune(connection, settings)
    file = OpenFile(path, mode, connection, read_layout(connection, str(path)), disk=disk)
    latest = "SELECT time_enter FROM Node UNION SELECT time_enter FROM Info UNION SELECT time_enter FROM Word"
    entered = connection.execute(f"SELECT MAX(time_enter) FROM ({latest})").fetchone()[0]  # noqa: S608
    file.clock.now = max(file.clock.now, str(entered or ""))
    connection.create_function("DATETIME", 1, file.clock)
    return file


def _tune(connection: sqlite3.Connection, settings: StorageSettings) -> None:
    connection.execute(f"PRAGMA cache_size = {int(settings.cache_pages)}")
    connection.execute(f"PRAGMA journal_mode = {_JOURNALS[settings.journal_mode]}")
    connection.execute(f"PRAGMA synchronous = {_SYNCHRONOUS[settings.synchronous]}")
    connection.execute(f"PRAGMA temp_store = {_STORES[settings.temp_store]}")
