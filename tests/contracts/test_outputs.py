# SPDX-License-Identifier: MIT
"""Files appear whole or not at all."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from slamcli import outputs
from slamcli.errors import UsageError
from slamcli.outputs import atomic_directory, atomic_file, atomic_path, check_directory, check_file
from slamcli.recordings import open_recording


def test_a_file_appears_when_the_block_ends_and_not_before(tmp_path):
    target = tmp_path / "deep" / "a.txt"
    with atomic_file(target) as stream:
        stream.write("new")
        assert not target.exists()
    assert target.read_text() == "new"
    assert [p.name for p in target.parent.iterdir()] == ["a.txt"]
    umask = os.umask(0)
    os.umask(umask)
    assert target.stat().st_mode & 0o777 == 0o666 & ~umask


def test_an_error_leaves_what_was_there(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_file(target, "wb") as stream:  # noqa: PT012
        stream.write(b"half")
        raise ZeroDivisionError
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_replaces_the_earlier_runs_files_and_keeps_the_users(tmp_path):
    target = tmp_path / "out"
    target.mkdir()
    (target / "run.json").write_text(json.dumps({"outputs": ["run.json", "gone.txt", "same.txt"]}))
    for name in ("gone.txt", "same.txt", "mine.txt"):
        (target / name).write_text("old")
    (target / "sub").mkdir()
    (target / "sub" / "mine.txt").write_text("old")
    (target / "link").symlink_to("mine.txt")
    with atomic_directory(target) as folder:
        (folder / "same.txt").write_text("new")
    found = {str(p.relative_to(target)): p.read_text() for p in target.rglob("*") if p.is_file()}
    assert found == {"same.txt": "new", "mine.txt": "old", "sub/mine.txt": "old", "link": "old"}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_folder_that_cannot_be_made_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="file is a file"):
        check_directory(tmp_path / "file" / "sub" / "out")
    with pytest.raises(UsageError, match="cannot write /proc/out"):
        check_directory("/proc/out")
    check_directory(tmp_path / "new" / "out")
    with pytest.raises(UsageError, match="is a folder"):
        check_file(tmp_path)
    with pytest.raises(UsageError, match="file is a file"):
        check_file(tmp_path / "file" / "state.pbstream")
    check_file(tmp_path / "new" / "state.pbstream")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_an_error_leaves_the_folder_that_was_there(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a").write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_directory(tmp_path / "out") as folder:  # noqa: PT012
        (folder / "a").write_text("half")
        raise ZeroDivisionError
    assert (tmp_path / "out" / "a").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_the_two_step_exchange_where_the_system_has_no_other(tmp_path, monkeypatch):
    monkeypatch.setattr(outputs.ctypes, "CDLL", lambda *_, **__: object())
    for text in ("old", "new"):
        with atomic_directory(tmp_path / "out") as folder:
            (folder / "a").write_text(text)
    assert (tmp_path / "out" / "a").read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_targets_that_cannot_be_written_are_wrong_usage(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="is a folder: name a file"), atomic_path(tmp_path):
        pass
    with pytest.raises(UsageError, match="is a file: name a folder"), atomic_directory(tmp_path / "file"):
        pass
    with pytest.raises(UsageError, match="cannot write"), atomic_path(tmp_path / "file" / "a.txt"):
        pass
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="the folder you are in"), atomic_directory(tmp_path):
        pass


CHILD = """
import sys, time
from pathlib import Path
from slamcli.outputs import atomic_directory, atomic_file
kind, target = sys.argv[1:]
manager = atomic_directory(target) if kind == "folder" else atomic_file(target)
with manager as place:
    (place / "a").write_text("half") if kind == "folder" else (place.write("half"), place.flush())
    print("writing", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_a_killed_run_leaves_the_old_output_and_the_next_run_removes_its_rest(tmp_path, kind):
    target = tmp_path / "out"
    child = subprocess.Popen([sys.executable, "-c", CHILD, kind, str(target)], stdout=subprocess.PIPE)
    assert child.stdout is not None
    child.stdout.readline()
    with atomic_file(tmp_path / "other.txt") as stream:
        stream.write("x")
    assert any(p.name.startswith(".slamcli-") for p in tmp_path.iterdir())  # a running process keeps its own
    child.send_signal(signal.SIGKILL)
    child.communicate()
    assert sorted(p.name for p in tmp_path.iterdir() if not p.name.startswith(".slamcli-")) == ["other.txt"]
    with atomic_file(tmp_path / "other.txt") as stream:
        stream.write("x")
    assert [p.name for p in tmp_path.iterdir()] == ["other.txt"]


def test_another_machines_rest_is_left_alone(tmp_path):
    (tmp_path / ".slamcli-00000000-1-x").write_text("")
    with atomic_file(tmp_path / "a") as stream:
        stream.write("x")
    assert len(list(tmp_path.iterdir())) == 2


def test_a_killed_command_leaves_no_half_written_output(tmp_path):
    command = [sys.executable, "-m", "slamcli", "generate", "office", str(tmp_path / "out.bag"), "--duration", "20"]
    for seconds in (0.4, 0.9, 1.4):
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(seconds)
        child.send_signal(signal.SIGKILL)
        if child.wait() == 0:
            break
        if (tmp_path / "out.bag").exists():  # killed between the move into place and its own end: the whole drive
            with open_recording([tmp_path / "out.bag"]) as recording:
                assert recording.end_ns - recording.start_ns > 19_000_000_000
            break
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.bag", "out.run.json"]
