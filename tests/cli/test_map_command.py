# SPDX-License-Identifier: MIT
"""``slamcli map`` as its users meet it: wrong usage, what is written, determinism by bytes, and real recordings."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import time
from pathlib import Path

import numpy as np
import pytest

from slamcli import runtime
from slamcli.cli.main import run
from slamcli.formats.trajectories import read_tum
from slamcli.pipelines import run_record
from slamcli.pipelines.evaluate_relations import evaluate_relations
from slamcli.pipelines.map import default_output
from slamcli.recordings import create_recording, open_recording

ROOT = Path(__file__).resolve().parents[2]
OFFICE = str(ROOT / "sample_data" / "office.bag")
DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", ROOT.parent / "shared" / "data"))
FAST = ["--set", "particles=4", "--duration", "6", "-q"]
FILES = ["map.pgm", "map.png", "map.yaml", "particles.npz", "report.html", "run.json", "trajectory.tum"]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def scans_only(tmp_path_factory):
    """Twelve seconds of the office without odometry and transforms."""
    path = tmp_path_factory.mktemp("bags") / "scans.mcap"
    with open_recording([Path(OFFICE)]) as recording, create_recording(path) as writer:
        for scan in recording.measurements(["/scan"], duration_s=12.0):
            writer.write("/scan", scan)
    return str(path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--start", "1000"], "lasts 158.4 s"),
        (["--duration", "-3"], "--duration"),
        (["--duration", "nan"], "--duration"),
        (["--set", "particls=3"], "did you mean particles"),
        (["--set", "particles=abc"], "not a whole number"),
        (["--set", "particles"], "KEY=VALUE"),
        (["--set", "delta=0"], "between 0.001 and 10"),
        (["--set", "match=best"], "surface, hillclimb"),
        (["--set", "time_offset=soon"], "auto"),
        (["--duration", "2", "--set", "time_offset=1e300"], "time_offset"),
        (["--duration", "2", "--set", "xmax=inf"], "extent"),
        (["--duration", "6", "--set", "proposal=improved", "--set", "llsamplestep=1e-6"], "samples of each particle"),
        (["--odom-topic", "/scan"], "it could be one of: /odom"),
        (["--scan-topic", "/odom"], "topic /odom is nav_msgs/Odometry, not LaserScan"),
        (["--scan-topic", "/scan", "--points-topic", "/scan"], "--points-topic /scan: gmapping has no use for it"),
        (["--landmark-topic", "/tags"], "--landmark-topic /tags: gmapping has no use for it"),
        (["--mode", "2d"], "--mode 2d: gmapping has one mode only"),
        (["--config", str(ROOT / "sample_data" / "README.md")], "launch files"),
        (["--truth", "none.tum"], "none.tum: no such file"),
        (["--arg", "foo"], "NAME=VALUE"),
        (["--map-mode", "ternary"], "ternary"),
        (["--seed", "-1"], "-1"),
        (["--laser-pose", "1,2"], "laser-pose"),
    ],
)
def test_wrong_usage_is_one_line_and_nothing_is_written(tmp_path, capsys, arguments, message):
    assert run(["map", OFFICE, "-o", "out", "-q", *arguments]) == 2
    shown = capsys.readouterr()
    assert message in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""
    assert list(tmp_path.iterdir()) == []


def test_an_output_that_cannot_be_is_told_before_any_work(tmp_path, capsys, monkeypatch):
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr("slamcli.pipelines.map.open_recording", lambda *_, **__: pytest.fail("was read"))
    assert run(["map", OFFICE, "-o", "file"]) == 2
    assert "is a file" in capsys.readouterr().err
    assert run(["map", OFFICE, "-o", "."]) == 2
    assert "the folder you are in" in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "mine"


def test_the_json_document_is_run_json_with_its_keys(tmp_path, capsys):
    assert run(["map", OFFICE, "-o", "out", *FAST, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    record = json.loads(Path("out/run.json").read_text())
    assert set(document) <= set(record)
    assert set(record) >= {
        "slamcli", "command", "algo", "seed", "inputs", "topics", "frames", "parameters", "changed", "summary", "counts",
        "warnings", "notes", "versions", "outputs", "timing", "peak_memory_bytes",
    }  # fmt: skip
    assert record["outputs"] == FILES
    assert record["changed"] == {"particles": 4}
    assert record["inputs"][0]["name"] == "office.bag"
    assert re.fullmatch("[0-9a-f]{64}", record["inputs"][0]["sha256"])
    assert record["topics"] == {"scan": "/scan", "odometry": "/odom"}
    assert record["frames"]["base"] == "base_link"
    assert record["summary"]["poses"] == record["summary"]["scans"] == len(read_tum("out/trajectory.tum"))
    assert record["timing"]["recording_s"] == pytest.approx(6.0)


def test_the_recorded_command_makes_the_result_again(tmp_path):
    (tmp_path / "office.bag").symlink_to(OFFICE)
    mends = ["--time-offset", "/scan=0.01", "--laser-pose", "0.1,0,0", "--flip-scan", "--no-return", "free"]
    words = ["map", "office.bag", "-o", "out", *FAST, *mends, "--map-mode", "scale", "--cloud-format", "none", "--mcap"]
    assert run(words) == 0
    command = json.loads(Path("out/run.json").read_text())["command"]
    assert "-o" not in command.split()
    assert "--cloud-colour" not in command
    assert run([*shlex.split(command)[1:], "-o", "again", "-q"]) == 0
    for name in ("trajectory.tum", "map-scale.png", "map.yaml", "map.png", "result.mcap"):
        assert Path("out", name).read_bytes() == Path("again", name).read_bytes(), name


def test_the_earlier_result_is_replaced_and_foreign_files_stay(tmp_path):
    assert run(["map", OFFICE, "-o", "out", *FAST]) == 0
    before = Path("out/trajectory.tum").read_bytes()
    Path("out/notes.txt").write_text("mine")
    assert run(["map", OFFICE, "-o", "out", *FAST, "--duration", "4"]) == 0
    assert sorted(path.name for path in Path("out").iterdir()) == sorted([*FILES, "notes.txt"])
    assert Path("out/notes.txt").read_text() == "mine"
    assert len(Path("out/trajectory.tum").read_bytes()) < len(before)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_every_byte_is_the_same_for_any_number_of_jobs(monkeypatch):
    monkeypatch.setattr(time, "perf_counter", lambda: 1.0)
    monkeypatch.setattr(run_record, "peak_memory_bytes", lambda: 10**8)
    monkeypatch.setattr(runtime, "peak_memory_bytes", lambda: 10**8)
    settings = [*FAST, "--duration", "12", "--json", "--set", "linearUpdate=0.2", "--set", "resampleThreshold=1"]
    for folder, jobs in (("a", "1"), ("b", "2"), ("c", "2")):
        assert run(["map", OFFICE, "-o", folder, *settings, "--jobs", jobs]) == 0
    for name in set(FILES) - {"run.json", "report.html"}:
        assert Path("a", name).read_bytes() == Path("b", name).read_bytes() == Path("c", name).read_bytes(), name
    assert Path("b/report.html").read_bytes() == Path("c/report.html").read_bytes()
    assert Path("b/run.json").read_bytes() == Path("c/run.json").read_bytes()
    one, two = (json.loads(Path(folder, "run.json").read_text()) for folder in "ab")
    assert one["summary"]["resamplings"] > 0
    assert one["timing"].pop("jobs") == 1
    assert two["timing"].pop("jobs") == 2
    assert one == two


def test_scans_alone_make_a_map_and_a_warning(scans_only, capsys):
    assert run(["map", scans_only, "-o", "out", "-q", "--set", "particles=4", "--laser-pose", "0.12,0,0"]) == 0
    assert "no odometry" in capsys.readouterr().err
    with open_recording([Path(OFFICE)]):
        truth = read_tum(ROOT / "sample_data" / "office.truth.tum")
    found = read_tum("out/trajectory.tum")
    # Without wheels the speed along the corridor is found after a while: the way from the fifth second on counts.
    known = slice(40, len(found))
    ways = [np.linalg.norm(np.diff(path.positions_m[known], axis=0), axis=1).sum() for path in (found, truth)]
    assert ways[0] == pytest.approx(ways[1], rel=0.05)
    assert run(["map", scans_only, "-o", "two", "-q", "--set", "scan_odometry=false", "--laser-pose", "0,0,0"]) == 2
    assert "scan_odometry" in capsys.readouterr().err
    assert not Path("two").exists()


def test_a_minimum_score_out_of_reach_warns_loudly(capsys):
    assert run(["map", OFFICE, "-o", "out", *FAST, "--set", "minimumScore=5000"]) == 0
    assert "minimumScore=5000 cannot be reached" in capsys.readouterr().err
    record = json.loads(Path("out/run.json").read_text())
    assert record["summary"]["fallbacks"] == 4 * (record["summary"]["processed_scans"] - 1) > 0


def test_the_default_folder_stands_beside_the_recording():
    for name in ("intel.clf.gz", "intel.mcap", "intel.bag", "intel"):
        assert default_output([Path("data") / name]) == Path("data/intel-maps")


real = pytest.mark.skipif(not DATA.exists(), reason=f"no {DATA}: set SLAMCLI_TEST_DATA")


@real
@pytest.mark.real_data
@pytest.mark.parametrize(
    ("log", "duration", "translation_m", "rotation_deg"), [("intel", "300", 0.05, 1.5), ("mit-csail", "100", 0.06, 1.2)]
)
def test_a_part_of_a_known_log(log, duration, translation_m, rotation_deg):
    laser = DATA / "laser"
    arguments = ["--duration", duration, "--set", "particles=10", "-q", "-o", "out"]
    assert run(["map", str(laser / f"{log}.clf.gz"), *arguments]) == 0
    figures = evaluate_relations(Path("out/trajectory.tum"), laser / f"{log}.relations").figures()
    assert figures["relations.matched"] > 150
    assert figures["relations.trans.mean"] < translation_m
    assert figures["relations.rot.mean"] < rotation_deg


@real
@pytest.mark.real_data
@pytest.mark.parametrize("name", ["trace0.bag", "rp1.bag"])
def test_recordings_of_real_robots(name):
    arguments = ["--duration", "20", "--set", "particles=5", "-q", "-o", "out"]
    assert run(["map", str(DATA / "bags" / name), *arguments]) == 0
    record = json.loads(Path("out/run.json").read_text())
    assert record["summary"]["free_m2"] > 3
    assert record["summary"]["mean_match_quality"] > 0.5
    assert record["summary"]["poses"] == record["summary"]["scans"] > 50


@real
@pytest.mark.real_data
def test_a_simulated_drive_against_its_truth():
    bag = str(DATA / "bags" / "simpath2.bag")
    truth = f"{bag}:/base_pose_ground_truth"
    assert run(["map", bag, "--duration", "60", "--truth", truth, "--set", "particles=5", "-q", "-o", "out"]) == 0
    figures = json.loads(Path("out/run.json").read_text())["summary"]["truth"]
    error = next(value for key, value in figures.items() if key.endswith("rmse") and "rot" not in key)
    assert math.isfinite(error)
    assert error < 0.1


def test_a_truth_of_another_time_costs_the_score_and_not_the_map(capsys):
    Path("other.tum").write_text("".join(f"{t} {t} 0 0 0 0 0 1\n" for t in range(5)))
    assert run(["map", OFFICE, "--duration", "4", "--truth", "other.tum", "-q", "-o", "out"]) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("slamcli:")]
    assert line.startswith("slamcli: --truth other.tum: ")
    assert line.endswith("(the map is in out)")
    assert "truth" not in json.loads(Path("out/run.json").read_text())["summary"]
    assert Path("out/map.pgm").exists()
