# SPDX-License-Identifier: MIT
"""``slamcli map`` on a sample recording: what it writes, the same bytes for any number of threads, wrong input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_tum

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
SHORT = ["--duration", "25", "--set", "particles=6", "-q"]


def test_the_folder_holds_what_the_page_says(tmp_path, capsys):
    out = tmp_path / "out"
    assert run(["map", str(SAMPLES / "office.bag"), "-o", str(out), *SHORT, "--json"]) == 0
    json.loads(capsys.readouterr().out)
    record = json.loads((out / "run.json").read_text())
    assert sorted(record["outputs"]) == sorted(path.name for path in out.iterdir())
    files = {"map.yaml", "map.pgm", "map.png", "trajectory.tum", "particles.npz", "report.html", "run.json"}
    assert files == set(record["outputs"])
    assert {len(column) for column in record["steps"].values()} == {record["summary"]["processed_scans"]}
    trajectory = read_tum(out / "trajectory.tum")
    truth = read_tum(SAMPLES / "office.truth.tum")
    n = len(trajectory)
    assert n == pytest.approx(251, abs=2)
    np.testing.assert_array_equal(trajectory.stamps_ns, truth.stamps_ns[:n])
    moved = np.linalg.norm(trajectory.positions_m[-1] - trajectory.positions_m[0])
    assert moved == pytest.approx(np.linalg.norm(truth.positions_m[n - 1] - truth.positions_m[0]), abs=0.2)
    grid = read_map(out / "map.yaml").grid
    assert (grid.cells == 0).sum() * grid.resolution_m**2 > 50  # square metres of free floor
    assert (grid.cells == 100).sum() > 200


def test_the_result_does_not_depend_on_threads_and_repeats(tmp_path):
    results = []
    for name, jobs in (("a", "1"), ("b", "2"), ("c", "2")):
        assert run(["map", str(SAMPLES / "office.bag"), "-o", str(tmp_path / name), *SHORT, "--jobs", jobs]) == 0
        results.append(
            [(tmp_path / name / file).read_bytes() for file in ("trajectory.tum", "map.pgm", "map.yaml", "map.png")]
        )
    assert results[0] == results[1] == results[2]


def test_another_seed_is_another_run(tmp_path):
    for seed in ("1", "2"):
        assert run(["map", str(SAMPLES / "office.bag"), "-o", str(tmp_path / seed), *SHORT, "--seed", seed]) == 0
    first, second = ((tmp_path / seed / "trajectory.tum").read_bytes() for seed in ("1", "2"))
    assert first != second


def test_the_missions_launch_file_is_taken_and_its_trap_told(tmp_path, capsys):
    launch = Path(__file__).resolve().parents[2] / "configs" / "gmapping.launch"
    arguments = ["map", str(SAMPLES / "loop_corridor.mcap"), "--config", str(launch), "-o", str(tmp_path / "out")]
    assert run([*arguments, "--duration", "25", "-q"]) == 0
    assert "minimumScore" in capsys.readouterr().err
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["parameters"]["minimumScore"] == 200
    assert record["parameters"]["srr"] == 0.01


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.bag"], "nowhere.bag"),
        ([str(SAMPLES / "README.md")], "README.md"),
        ([str(SAMPLES / "office.bag"), "--scan-topic", "/odom"], "/odom"),
        ([str(SAMPLES / "office.bag"), "--scan-topic", "/nothing"], "/scan"),
        ([str(SAMPLES / "office.bag"), "--algo", "gmaping"], "no SLAM system 'gmaping'"),
        ([str(SAMPLES / "office.bag"), "--set", "lstp=1"], "did you mean lstep"),
        ([str(SAMPLES / "office.bag"), "--config", "nowhere.launch"], "nowhere.launch: no such file"),
    ],
)
def test_wrong_input_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert run(["map", *arguments, "-o", "out", "-q"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
