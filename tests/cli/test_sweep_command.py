# SPDX-License-Identifier: MIT
"""The command as it is typed: a real sweep of a few seconds of a recording, and what is refused."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from slamcli.cli.main import run

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
BAG = str(SAMPLES / "office.bag")


def test_a_sweep_ranks_goes_on_and_its_best_file_gives_the_best_run(tmp_path, capsys):
    out = tmp_path / "out"
    words = [
        "sweep",
        BAG,
        "--start",
        "2",
        "--duration",
        "2",
        "--ref",
        "truth",
        "--workers",
        "1",
        "-o",
        str(out),
        "--json",
    ]
    words += ["--set", "minimumScore=50", "--set"]
    assert run([*words, "particles=2,4"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "slamcli.sweep.1"
    assert len(document["runs"]) == 3
    assert all(0 < one["median"] < 0.1 for one in document["sets"])
    assert document["fixed"] == {"minimumScore": 50.0}
    records = {path.name: path.stat().st_mtime_ns for path in (out / "jobs").iterdir()}
    assert run([*words, "particles=2,4"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert [one["label"] for one in again["sets"]] == [one["label"] for one in document["sets"]]
    assert {path.name: path.stat().st_mtime_ns for path in (out / "jobs").iterdir()} == records

    best = again["best"]
    assert run([*shlex.split(best["command"])[1:], "-o", str(tmp_path / "again"), "-q"]) == 0
    for file in ("trajectory.tum", "map.pgm", "map.yaml"):
        assert (tmp_path / "again" / file).read_bytes() == (out / best["folder"] / file).read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([BAG, "--set", "particels=3,4", "--ref", "truth"], "did you mean particles"),
        ([BAG, "--set", "srr=0.1:0.2", "--ref", "truth"], "add --random N"),
        ([BAG, "--set", "particles=3,-4", "--ref", "truth"], "must be between 1 and 10000"),
        ([BAG, "--set", "particles=3,4", "--ref", "none.tum"], "--ref none.tum: no such file"),
        ([BAG, "--set", "particles=3,4", "--ref", __file__], "test_sweep_command.py, line 2: "),
        (["nothing.bag", "--set", "particles=3,4", "--ref", "truth"], "nothing that is true of nothing.bag"),
        (["nothing.bag", "--set", "particles=3,4"], "nothing.bag: no such file"),
        ([BAG, "--set", "particles=3,4", "--objective", "ate.rmse"], "name that with --ref"),
        ([BAG, "--ref", "truth"], "nothing is varied"),
        ([BAG, "--set", "particles=3,4", "--together", "--ref", "truth"], "name several recordings"),
        ([BAG, "--set", "particles=3,4", "--together", "--each"], "choose one"),
        ([BAG, "--set", "particles=3,4", "--maximise", "--ref", "truth"], "smaller it is"),
        ([BAG, "--set", "particles=3,4", "--fresh", "--ref", "truth"], "--fresh is for many inputs"),
        ([BAG, "--algo", "slam", "--set", "a=1,2"], "no SLAM system 'slam'"),
        ([BAG, "--arg", "x", "--set", "particles=3,4"], "NAME=VALUE"),
    ],
)
def test_wrong_input_is_one_line_and_leaves_nothing(words, message, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(["sweep", *words, "-o", str(out)]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert not out.exists()


def test_an_interrupted_sweep_says_how_to_go_on(tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("slamcli.pipelines.sweep.run_jobs", interrupted)
    assert run(["sweep", BAG, "--set", "particles=3,4", "--ref", "truth", "-o", str(tmp_path / "out")]) == 130
    assert "interrupted: 0 runs are done and kept; the same command goes on" in capsys.readouterr().err
