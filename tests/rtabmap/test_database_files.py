# SPDX-License-Identifier: MIT
"""Files that are in use, killed, full, damaged, or none; and the same bytes for the same run."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import database_worlds as worlds
import numpy as np
import pytest

from slamcli.errors import FormatError, InputError
from slamcli.rtabmap.database import Database, StorageSettings
from slamcli.rtabmap.database.connection import sqlite_errors

OPENINGS: list[Callable[[Path], Database]] = [
    Database.read, Database.append, lambda path: Database.create(path, "", overwrite=True)
]  # fmt: skip


def test_the_same_run_writes_the_same_bytes_whatever_jobs_is(tmp_path: Path) -> None:
    first = worlds.written(tmp_path / "a.db").read_bytes()
    assert worlds.written(tmp_path / "b.db", jobs=2).read_bytes() == first
    with Database.create(tmp_path / "c.db", worlds.PARAMETERS, overwrite=True) as database:
        worlds.fill(database, 2)
    assert (tmp_path / "c.db").read_bytes() != first


def test_times_in_the_file_are_those_of_the_recording(tmp_path: Path) -> None:
    with worlds.raw(worlds.written(tmp_path / "a.db")) as connection:
        assert connection.execute("SELECT DISTINCT time_enter FROM Node WHERE id=1").fetchall() == [
            ("2023-11-14 22:13:21",)
        ]
        assert connection.execute("SELECT time_enter FROM Info").fetchall() == [
            ("1970-01-01 00:00:00",),
            ("2023-11-14 22:13:24",),
        ]
        assert connection.execute("SELECT COUNT(*) FROM Word WHERE time_enter IS NULL").fetchone() == (0,)


def test_nothing_is_left_beside_the_file(tmp_path: Path) -> None:
    worlds.written(tmp_path / "a.db", jobs=2)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.db"]


@pytest.mark.parametrize("opening", OPENINGS, ids=["read", "append", "create"])
def test_a_second_process_is_told_and_nothing_is_lost(tmp_path: Path, opening: Callable[[Path], Database]) -> None:
    path = tmp_path / "a.db"
    with Database.create(path, "") as database:
        worlds.fill(database, 2)
        with pytest.raises(FormatError, match="another process uses this database"):
            opening(path)
        worlds.fill(database, 1, first=3)
    with Database.read(path) as database:
        assert len(database.nodes()) == 3


def test_a_reader_keeps_writers_out_but_not_readers(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    with Database.read(path) as first, Database.read(path) as second:
        assert len(first.nodes()) == len(second.nodes()) == 4
        with pytest.raises(FormatError, match="another process uses"):
            Database.append(path)


KILLED = """
import sys
from pathlib import Path
import database_worlds as worlds
from slamcli.rtabmap.database import Database, StorageSettings
database = Database.create(Path(sys.argv[1]), "", settings=StorageSettings(journal_mode=int(sys.argv[2])))
for node_id in range(1, 10_000):
    worlds.fill(database, 1, first=node_id)
    print(node_id, flush=True)
"""


@pytest.mark.parametrize("journal_mode", [0, 2, 3])
def test_a_killed_run_leaves_every_node_that_was_committed(tmp_path: Path, journal_mode: int) -> None:
    path = tmp_path / "a.db"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path), str(journal_mode)], stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        committed = 0
        while committed < 12:
            committed = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
        committed = max([committed, *(int(line) for line in process.stdout if line.strip())])
    with worlds.raw(path) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    with Database.append(path) as database:
        count = len(database.nodes())
        assert committed <= count <= committed + 1
        assert database.read_signature(committed).id == committed
        assert len(database.links()) in (committed - 1, committed)
        worlds.fill(database, 1, first=count + 1)
    with Database.read(path) as database:
        assert len(database.nodes()) == count + 1


def test_what_was_not_committed_is_forgotten_when_an_error_leaves_the_context(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), Database.create(tmp_path / "a.db", "") as database:  # noqa: PT012
        worlds.fill(database, 2)
        database.add_node(worlds.signature(9), weight=0)
        raise ZeroDivisionError
    with Database.read(tmp_path / "a.db") as database:
        assert database.nodes().ids.tolist() == [1, 2]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_full_disk_costs_only_the_node_that_did_not_fit(tmp_path: Path, jobs: int) -> None:
    path = tmp_path / "a.db"
    database = Database.create(path, "", jobs=jobs)
    database._file.connection.execute("PRAGMA max_page_count = 60")
    with pytest.raises(FormatError, match=r"a\.db: the disk is full: everything committed before"):  # noqa: PT012
        for node_id in range(1, 200):
            worlds.fill(database, 1, first=node_id)
            database.nodes()
    database.close(commit=False)
    with Database.append(path) as database:
        count = len(database.nodes())
        assert count == node_id - 1 > 3
        assert database.read_signature(count).id == count
        worlds.fill(database, 1, first=count + 1)


def test_what_fails_on_the_thread_is_raised_by_the_next_call(tmp_path: Path) -> None:
    database = Database.append(worlds.written(tmp_path / "a.db"), jobs=2)
    database.add_node(worlds.signature(1), weight=0)
    with pytest.raises(FormatError, match="has this already"):
        database.nodes()
    with pytest.raises(FormatError, match="has this already"):
        database.close()
    with Database.read(tmp_path / "a.db") as database:
        assert len(database.nodes()) == 4


@contextmanager
def nobody() -> Iterator[None]:
    """Give up root's rights for a while, to whom nothing is read-only."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


def test_a_read_only_file_is_read_but_not_continued() -> None:
    with tempfile.TemporaryDirectory() as name:  # pytest's folders are closed to others
        folder = Path(name)
        path = worlds.written(folder / "a.db")
        path.chmod(0o444)
        folder.chmod(0o555)
        with nobody():
            with Database.read(path) as database:
                assert len(database.nodes()) == 4
            with pytest.raises(FormatError, match=r"a\.db: the file or its folder is read-only"):
                Database.append(path)
            with pytest.raises(FormatError, match=r"b\.db: the file cannot be opened here"):
                Database.create(folder / "b.db", "")
            with pytest.raises(FormatError, match=r"a\.db: cannot be replaced"):
                Database.create(path, "", overwrite=True)
        path.chmod(0o000)
        with nobody(), pytest.raises(FormatError, match=r"a\.db: cannot be read"):
            Database.read(path)
        folder.chmod(0o755)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("SQLITE_READONLY_DIRECTORY", "read-only; copy it"), ("SQLITE_IOERR_WRITE", "could not be read or written"),
        ("SQLITE_CANTOPEN", "permissions"), ("SQLITE_CORRUPT_INDEX", "damaged"), ("SQLITE_MISUSE", "SQLite refused"),
    ],
)  # fmt: skip
def test_every_error_of_sqlite_says_what_to_do(code: str, message: str) -> None:
    error = sqlite3.OperationalError("raw")
    error.sqlite_errorname = code
    with pytest.raises(InputError, match=rf"here\.db: .*{message}.*\(raw\)"), sqlite_errors(Path("here.db")):
        raise error


def test_files_that_are_no_databases(tmp_path: Path) -> None:
    (tmp_path / "empty.db").touch()
    (tmp_path / "text.db").write_text("no database " * 500)
    with worlds.raw(tmp_path / "other.db") as connection:
        connection.execute("CREATE TABLE messages (id)")
    expected = {
        "missing.db": "there is no such database", "empty.db": "an empty file", "text.db": "not an SQLite database",
        "other.db": "not a database of RTAB-Map (it has messages)", "": "a folder",
    }  # fmt: skip
    for name, message in expected.items():
        for opening in (Database.read, Database.append):
            with pytest.raises(FormatError) as caught:
                opening(tmp_path / name)
            assert message in str(caught.value)
            assert "\n" not in str(caught.value)
    with pytest.raises(FormatError, match="not an SQLite database"):
        Database.create(tmp_path / "text.db", "", overwrite=True)  # nobody's file is replaced
    assert (tmp_path / "text.db").stat().st_size == 6000
    with pytest.raises(FormatError, match="exists already"):
        Database.create(tmp_path / "other.db", "")
    with pytest.raises(FormatError, match="in a folder that exists"):
        Database.create(tmp_path / "nowhere" / "a.db", "")


def test_damage_is_one_line(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db", 6)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3])
    with pytest.raises(FormatError, match="damaged"), Database.read(path) as database:
        database.words()
    path.write_bytes(data)
    with worlds.raw(path) as connection:
        connection.execute(
            "UPDATE Data SET scan=substr(scan, 1, 40), depth=substr(depth, 1, 30), calibration=substr(calibration, 1, 50)"
        )
    with Database.read(path) as database:
        for action in (database.read_scan, database.read_images, database.read_cameras, database.read_signature):
            with pytest.raises(FormatError, match=r"damaged|unknown encoding"):
                action(1)


def test_a_database_that_is_only_read_is_not_written(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    before = path.read_bytes()
    with Database.read(path) as database:
        with pytest.raises(FormatError, match="opened for reading only"):
            database.set_weight(1, 5)
        database.read_signature(1)
    assert path.read_bytes() == before


def test_an_overwritten_database_is_new(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    shutil.copy(path, tmp_path / "a.db-journal")
    with Database.create(path, "", overwrite=True) as database:
        worlds.fill(database, 1)
    with Database.read(path) as database:
        assert len(database.nodes()) == 1


def test_a_database_in_memory_is_written_when_it_is_closed(tmp_path: Path) -> None:
    plain = worlds.written(tmp_path / "a.db")
    with Database.create(tmp_path / "b.db", worlds.PARAMETERS, settings=StorageSettings(in_memory=True)) as database:
        worlds.fill(database, 2)
        with closing(sqlite3.connect(f"file:{tmp_path / 'b.db'}?immutable=1", uri=True)) as connection:
            assert connection.execute("SELECT COUNT(*) FROM Node").fetchone() == (0,)
        with pytest.raises(FormatError, match="another process"):
            Database.append(tmp_path / "b.db")
    with Database.append(tmp_path / "b.db", settings=StorageSettings(in_memory=True)) as database:
        worlds.fill(database, 2, first=3)
    with Database.read(tmp_path / "b.db") as memory, Database.read(plain) as disk:
        assert memory.nodes().ids.tolist() == disk.nodes().ids.tolist()
        assert memory.words()[0].tolist() == disk.words()[0].tolist()


def test_sqlite_is_tuned_as_asked(tmp_path: Path) -> None:
    settings = StorageSettings(cache_pages=321, journal_mode=2, synchronous=1, temp_store=1)
    with Database.create(tmp_path / "a.db", "", settings=settings) as database:
        worlds.fill(database, 1)
        told = [
            database._file.connection.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("cache_size", "journal_mode", "synchronous", "temp_store")
        ]
    assert told == [321, "persist", 1, 1]


@pytest.mark.parametrize("jobs", [1, 2])
def test_closing_twice_does_nothing(tmp_path: Path, jobs: int) -> None:
    with Database.create(tmp_path / "a.db", "", jobs=jobs) as database:
        worlds.fill(database, 1)
        database.close()
        database.close(commit=False)
    with Database.read(tmp_path / "a.db") as database:
        assert len(database.nodes()) == 1


LEFT_OPEN = """
import sys
from pathlib import Path
import database_worlds as worlds
from slamcli.rtabmap.database import Database
database = Database.create(Path(sys.argv[1]), "", jobs=int(sys.argv[2]))
worlds.fill(database, 3)
database.add_node(worlds.signature(9), weight=0)
raise SystemExit(2)
"""


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_program_that_ends_without_closing_leaves_nothing_beside_the_file(tmp_path: Path, jobs: str) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    ended = subprocess.run(
        [sys.executable, "-c", LEFT_OPEN, str(tmp_path / "a.db"), jobs],
        env=environment,
        check=False,
        capture_output=True,
    )
    assert (ended.returncode, ended.stderr) == (2, b"")
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.db"]
    with Database.read(tmp_path / "a.db") as database:
        assert database.nodes().ids.tolist() == [1, 2, 3]


def test_random_damage_is_always_one_line_that_names_the_file(tmp_path: Path) -> None:
    """Bytes changed here and there: each question is answered, or refused by name."""
    data = worlds.written(tmp_path / "whole.db", 3).read_bytes()
    path = tmp_path / "damaged.db"
    rng = np.random.default_rng(8)
    said: list[str] = []
    whole = ["nodes", "links", "words", "parameters", "read_statistics", "optimised", "grid", "last_working_ids"]
    of_nodes = ["read_signature", "read_images", "read_scan", "read_local_grid", "read_cameras", "links"]
    questions = [*((name, ()) for name in whole), *((name, (i,)) for name in of_nodes for i in (1, 2, 3))]
    for _ in range(40):
        damaged = bytearray(data)
        for at in rng.integers(0, len(data) - 8, int(rng.integers(1, 30))):
            damaged[at : at + 4] = rng.integers(0, 256, 4, dtype=np.uint8).tobytes()
        path.write_bytes(bytes(damaged))
        try:
            with Database.read(path) as database:
                said += [
                    answer for name, arguments in questions if (answer := refusal(getattr(database, name), *arguments))
                ]
        except FormatError as error:
            said.append(str(error))
    assert len(said) > 20
    assert [message for message in said if not message.startswith(f"{path}: ") or "\n" in message] == []


def refusal(question: Callable[..., object], *arguments: int) -> str:
    try:
        question(*arguments)
    except FormatError as error:
        return str(error)
    return ""
