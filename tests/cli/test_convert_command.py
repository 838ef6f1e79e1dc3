# SPDX-License-Identifier: MIT
import json
from pathlib import Path

import pytest

from slamcli.cli.main import run

LINE = "FLASER 3 1.0 2.0 81.83 0.1 0 0 0.1 0 0 {} h 0\n"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "a.clf"
    path.write_text("".join(LINE.format(f"{k}.5") for k in range(5)))
    return path


def test_json_and_summary(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = log.with_name("a.mcap")
    assert run(["convert", str(log), str(target), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["num_messages"], document["format"], document["source_format"]) == (16, "mcap", "carmen")
    assert document["topics"][-1] == {
        "name": "/scan",
        "type": "sensor_msgs/msg/LaserScan",
        "encoding": "cdr",
        "count": 5,
    }
    assert run(["convert", str(target), str(log.with_name("b.bag")), "--topics", "/scan,/tf", "--topics", "/odom"]) == 0
    out = capsys.readouterr().out
    assert "/scan" in out
    assert "rosbag1, 15 messages over 4.0 s" in out
    assert run(["convert", str(target), str(log.with_name("c.bag")), "-q"]) == 0
    assert capsys.readouterr().out == ""


def test_options_of_classic_logs(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = str(log.with_name("a.mcap"))
    assert run(["convert", str(log), target, "--laser-fov", "90", "--laser-max-range", "1.5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["counts"]["readings without return"] == 10


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a.clf"], "name what to convert and where to"),
        (["none.bag", "b.bag"], "none.bag: there is no such file"),
        (["a.clf", "a.clf"], "source and target are the same"),
        (["a.clf", "b.xyz"], "cannot tell the format"),
        (["a.clf", "b.bag", "--compression", "zstd"], "one of none, bz2, lz4"),
        (["a.clf", "b.bag", "--topics", "/scam"], "no topic '/scam'"),
        (["noise.bag", "b.bag"], "noise.bag: not a recording"),
    ],
)
def test_wrong_input_is_one_line_exit_2_and_nothing_written(
    log: Path, arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(log.parent)
    (log.parent / "noise.bag").write_bytes(bytes(range(256)) * 10)
    before = sorted(p.name for p in log.parent.iterdir())
    assert run(["convert", *arguments]) == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.err.strip().count("\n") <= 2  # a note on the log may stand before the error
    assert captured.out == ""
    assert sorted(p.name for p in log.parent.iterdir()) == before
