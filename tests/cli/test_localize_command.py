# SPDX-License-Identifier: MIT
"""``slamcli localize`` as its users meet it: results, wrong usage, determinism by bytes, real recordings."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.maps import write_map
from slamcli.formats.trajectories import read_tum
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.generate import generate
from slamcli.recordings import create_recording, open_recording

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", ROOT.parent / "shared" / "data"))
FAST = ["--set", "max_particles=600", "--set", "slamcli.proposal_candidates=20000", "-q"]
FILES = ["map.png", "poses.csv", "report.html", "run.json", "trajectory.tum"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Twelve seconds in the cluttered room: drive.mcap, truth.tum and map.yaml."""
    folder = tmp_path_factory.mktemp("drive")
    generate(
        "cluttered_room", folder / "drive.mcap", seed=3, duration_s=12.0, truth=folder / "truth.tum", map_path=folder / "map.yaml"
    )  # fmt: skip
    return folder


@pytest.fixture(autouse=True)
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)


def first_pose(folder) -> str:
    return ",".join(f"{value:.4f}" for value in read_tum(folder / "truth.tum").poses_se2[0])


def localize(*arguments: str) -> int:
    return run(["localize", "drive.mcap", "--map", "map.yaml", *arguments, *FAST])


def test_every_scan_gets_a_pose_near_the_truth(folder, capsys):
    assert localize("--start", first_pose(folder), "--ref", "truth.tum", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    out = folder / "drive-localized"
    assert sorted(path.name for path in out.iterdir()) == FILES
    truth, found = read_tum(folder / "truth.tum"), read_tum(out / "trajectory.tum")
    np.testing.assert_array_equal(found.stamps_ns, truth.stamps_ns)
    assert np.hypot(*(found.poses_se2 - truth.poses_se2)[:, :2].T).max() < 0.1
    figures = document["summary"]["truth"]
    assert figures["ate.rmse"] < 0.05
    assert figures["converged.after_s"] == 0.0
    table = np.genfromtxt(out / "poses.csv", delimiter=",", names=True)
    assert len(table) == len(found) == document["summary"]["scans"]
    assert (table["cov_xx"] > 0).all()
    assert (table["cov_xx"] * table["cov_yy"] >= table["cov_xy"] ** 2).all()
    assert table["used"].sum() == document["summary"]["scans_used"]
    assert "Error against ground truth" in (out / "report.html").read_text()
    assert document["topics"] == {"scan": "/scan", "odometry": "/odom"}


def test_nobody_needs_to_know_where_it_began(folder):
    assert localize("--global", "-o", "found", "--ref", "truth.tum") == 0
    figures = json.loads((folder / "found" / "run.json").read_text())["summary"]["truth"]
    assert figures["converged.after_s"] < 6.0
    assert figures["converged.trans_rmse_m"] < 0.06


def test_the_same_seed_gives_the_same_bytes(folder):
    for name, seed in (("one", "5"), ("two", "5"), ("three", "6")):
        assert localize("--global", "--duration", "5", "-o", name, "--seed", seed) == 0
    for file in ("trajectory.tum", "poses.csv", "map.png"):
        assert (folder / "one" / file).read_bytes() == (folder / "two" / file).read_bytes()
    assert (folder / "one" / "poses.csv").read_bytes() != (folder / "three" / "poses.csv").read_bytes()


def test_parameters_come_from_the_missions_launch_file_and_from_yaml(folder):
    Path("amcl.yaml").write_text("amcl:\n  update_min_d: 0.4\n  odom_alpha1: 0.1\n")
    arguments = ["--config", "move_base.launch", "--config", "amcl.yaml", "--set", "odom_alpha2=0.3"]
    assert localize("--start", first_pose(folder), "--duration", "2", *arguments) == 0
    run_ = json.loads((folder / "drive-localized" / "run.json").read_text())
    wanted = {"min_particles": 500, "laser_max_range": 12.0, "update_min_a": 0.5, "odom_model_type": "diff-corrected",
              "update_min_d": 0.4, "odom_alpha1": 0.1, "odom_alpha2": 0.3, "max_particles": 600}  # fmt: skip
    assert {name: run_["parameters"][name] for name in wanted} == wanted
    assert run_["parameters"]["odom_alpha3"] == 0.2
    assert "--config move_base.launch --config amcl.yaml" in run_["command"]


def test_two_scanners(folder):
    with open_recording([folder / "drive.mcap"]) as recording, create_recording(folder / "two.mcap") as writer:
        import dataclasses

        for measurement in recording.measurements(recording.contents.topics, log_order=True):
            writer.write(measurement.topic, measurement)
            if measurement.topic == "/scan":
                writer.write("/scan_2", dataclasses.replace(measurement, topic="/scan_2"))
    arguments = ["--scan-topic", "/scan", "--scan-topic", "/scan_2", "--start", first_pose(folder), "-o", "both"]
    assert run(["localize", "two.mcap", "--map", "map.yaml", *arguments, "--ref", "truth.tum", *FAST]) == 0
    document = json.loads((folder / "both" / "run.json").read_text())
    assert document["topics"]["scan"] == ["/scan", "/scan_2"]
    assert document["summary"]["scans"] == 2 * len(read_tum(folder / "truth.tum"))
    assert document["summary"]["truth"]["ate.rmse"] < 0.06


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--start", "100,0,0"], "--start 100,0 is outside the map map.yaml (x "),
        (["--start", "0,0,0,0"], "write it as X,Y or X,Y,YAW"),
        (["--start", "nan,1,0"], "finite"),
        (["--start", "1,1,0", "--global"], "give one of them"),
        (["--global", "--set", "max_particle=3"], "did you mean max_particles"),
        (["--global", "--set", "odom_alpha1=nan"], "not a number"),
        (["--global", "--set", "laser_model_type=best"], "choose one of likelihood_field"),
        (["--global", "--set", "min_particles=700"], "min_particles=700 is more than max_particles=600"),
        (["--global", "--scan-topic", "/odom"], "/odom"),
        (["--global", "--odom-topic", "none"], "no odometry"),
        (["--global", "--begin", "100"], "lasts"),
        (["--global", "--ref", "no.tum"], "no.tum"),
        (["--global", "--config", "gmapping.launch"], "starts no node of amcl"),
        (["--global", "-o", "map.yaml"], "is a file"),
    ],
)  # fmt: skip
def test_wrong_usage_is_one_line(arguments, message, capsys, folder):
    before = sorted(path.name for path in folder.iterdir())
    assert localize(*arguments) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("slamcli:")]
    assert len(lines) == 1
    assert message in lines[0]
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize(
    ("value", "start", "message"),
    [
        (100, "--start=0.2,0.2,0", "is in a wall of the map odd.yaml"),
        (100, "--global", "has no free cell"),
        (0, "--global", "has no occupied cell"),
        (-1, "--global", "has no free cell"),
    ],
)
def test_maps_in_which_nobody_can_be_are_refused(value, start, message, capsys, folder):
    write_map(folder / "odd.yaml", OccupancyGrid(np.full((10, 10), value, np.int8), 0.1))
    assert run(["localize", "drive.mcap", "--map", "odd.yaml", start, *FAST]) == 2
    assert message in capsys.readouterr().err


def test_on_another_map_it_says_that_it_does_not_know(capsys, folder):
    bars = np.zeros((400, 400), np.int8)
    bars[::40] = bars[:, ::40] = 100
    write_map(folder / "bars.yaml", OccupancyGrid(bars, 0.05))
    assert run(["localize", "drive.mcap", "--map", "bars.yaml", "--global", "-o", "elsewhere", *FAST]) == 0
    said = capsys.readouterr().err
    deviation = json.loads((folder / "elsewhere" / "run.json").read_text())["summary"]["final_deviation_m"]
    assert deviation > 1.0
    assert "the robot may be somewhere else" in said


def test_a_recording_without_odometry_or_scans_is_refused(capsys, folder):
    for name, keep, message in (
        ("scans.mcap", "/scan", "AMCL needs it"),
        ("wheels.mcap", "/odom", "no sensor_msgs/LaserScan"),
    ):
        with open_recording([folder / "drive.mcap"]) as recording, create_recording(folder / name) as writer:
            for measurement in recording.measurements([keep]):
                writer.write(keep, measurement)
        assert run(["localize", name, "--map", "map.yaml", "--global", "--laser-pose", "0.1,0,0", *FAST]) == 2
        assert message in capsys.readouterr().err


def test_settings_are_explained(capsys):
    assert run(["localize", "--list-settings"]) == 0
    said = capsys.readouterr().out
    assert "laser_max_beams=30" in said
    assert "slamcli.proposals=scan" in said


@pytest.mark.real_data
def test_stage_in_the_meeting_map(tmp_path):
    bag, map_ = DATA / "bags" / "simpath2.bag", DATA / "maps" / "meeting" / "meeting.yaml"
    if not (bag.exists() and map_.exists()):
        pytest.skip(f"no {bag} with its map: set SLAMCLI_TEST_DATA")
    truth = [
        "--ref",
        f"{bag}:/base_pose_ground_truth",
        "--ref-align",
        "sim3",
    ]  # the map is 3 % smaller than Stage's world
    for name, start in (("known", ["--start", "27.6,12.7,0.82", *truth]), ("unknown", ["--global"])):
        assert run(["localize", str(bag), "--map", str(map_), *start, "-o", str(tmp_path / name), "-q"]) == 0
    figures = json.loads((tmp_path / "known" / "run.json").read_text())["summary"]["truth"]
    assert figures["ate.rmse"] < 0.12
    assert figures["ate_rot.rmse"] < 2.0
    known, unknown = (read_tum(tmp_path / name / "trajectory.tum").poses_se2 for name in ("known", "unknown"))
    # Two ends of the corridor look alike; later the place is known.
    assert np.hypot(*(known - unknown)[400:, :2].T).max() < 0.4


@pytest.mark.real_data
def test_a_recording_of_amcl_poses_alone_says_what_it_lacks(capsys):
    bag = DATA / "bags" / "nav2_turtlebot.mcap"
    if not bag.exists():
        pytest.skip(f"no {bag}: set SLAMCLI_TEST_DATA")
    assert run(["localize", str(bag), "--map", "map.yaml", "--global", "-q"]) == 2
    assert "no sensor_msgs/LaserScan topic (it has" in capsys.readouterr().err
