# SPDX-License-Identifier: MIT
"""A robot driven by a script of velocities, and what it leaves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import ConfigError, EstimationError, UsageError
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_tum
from slamcli.measurements import LaserScan, Odometry
from slamcli.pipelines.rhythm import Rhythm
from slamcli.pipelines.teleop import Teleop
from slamcli.pipelines.teleop_request import TeleopRequest
from slamcli.pipelines.velocity_script import read_velocities
from slamcli.recordings import open_recording
from slamcli.runtime import RunLog

FEW = {"laser.beams": 91}


def driven(tmp_path, text, name="o.mcap", **changed):
    script = tmp_path / "s.csv"
    script.write_text(text)
    given = {"world": "office", "path": tmp_path / name, "script": script, "settings": FEW, **changed}
    teleop = Teleop(TeleopRequest(**given))
    teleop.play(read_velocities(script))
    return teleop


def messages(path):
    with open_recording([path]) as recording:
        return {topic.name: topic.count for topic in recording.contents.topics}, list(
            recording.measurements(["/odom", "/scan"])
        )


def test_the_robot_does_what_the_script_says(tmp_path):
    teleop = driven(tmp_path, "2,0.5,0\n1,0,1\n1,0,0\n", truth=tmp_path / "t.tum", map_path=tmp_path / "m.yaml")
    made = teleop.driven
    assert made.duration_s == 4.0
    # 0.5 m/s for 2 s at 2.5 m/s2 from rest and to rest; a turn of 1 rad at 5 rad/s2
    assert made.length_m == pytest.approx(1.0, abs=0.02)
    assert made.collisions == ()
    start, end = teleop.robot.start, teleop.robot.plant.pose
    assert np.hypot(*(end - start)[:2]) == pytest.approx(1.0, abs=0.02)
    assert (end - start)[2] == pytest.approx(1.0, abs=0.02)
    truth = read_tum(made.truth)
    assert len(truth) == made.messages["/scan"] == 40
    np.testing.assert_allclose(truth.positions_m[0, :2], start[:2], atol=2e-4)
    np.testing.assert_allclose(truth.positions_m[-1, :2], end[:2], atol=1e-6)
    assert read_map(made.map).grid.resolution_m == 0.05
    document = json.loads(made.record.read_text())
    assert document["outputs"] == ["m.yaml", "o.mcap", "o.run.json", "t.tum"]
    assert [entry["name"] for entry in document["inputs"]] == ["office.yaml", "s.csv"]


def test_the_recording_has_the_topics_of_generate_and_commands(tmp_path):
    made = driven(tmp_path, "1,0.5,0\n1,0,1\n").driven
    counts, found = messages(made.path)
    assert dict(made.messages) == counts
    assert counts == {
        "/tf_static": 1,
        "/scan": 20,
        "/odom": 41,
        "/tf": 41,
        "/ground_truth": 101,
        "/cmd_vel": counts["/cmd_vel"],
    }
    assert 40 <= counts["/cmd_vel"] <= 44
    odometry = [m for m in found if isinstance(m, Odometry) and m.topic == "/odom"]
    assert odometry[0].position_m.tolist() == [0, 0, 0]
    scans = [m for m in found if isinstance(m, LaserScan)]
    assert scans[0].stamp_ns == 1_700_000_000_005_000_000  # a sweep takes 75 ms, a tick 10
    assert scans[0].num_beams == 91


@pytest.mark.parametrize("slam", [None, "gmapping"])
def test_the_same_seed_gives_the_same_bytes(tmp_path, slam):
    names = ["o.mcap", "t.tum", "m.yaml", "m.pgm"]
    texts = []
    for seed in (3, 3, 4):
        driven(
            tmp_path, "2,0.5,0.3\n1,0,1\n", seed=seed, slam=slam, truth=tmp_path / "t.tum", map_path=tmp_path / "m.yaml",
            settings={**FEW, "people.count": 2, "laser.fov": 270},
        )  # fmt: skip
        texts.append([(tmp_path / name).read_bytes() for name in names])
    assert texts[0] == texts[1]
    assert texts[0][0] != texts[2][0]


def test_a_velocity_holds_longer_than_the_robot_waits_for_commands(tmp_path):
    teleop = driven(tmp_path, "3,0.4,0\n", settings={**FEW, "robot.command_timeout": 0.02})
    assert teleop.driven.length_m == pytest.approx(1.2, abs=0.05)


@pytest.mark.parametrize("name", ["o.bag", "folder"])
def test_other_containers(tmp_path, name):
    made = driven(tmp_path, "0.5,0.5,0\n", name).driven
    assert messages(made.path)[0]["/odom"] == 11


@pytest.mark.parametrize("turned", [{}, {"laser.clockwise": True, "laser.upside_down": True}])
def test_slam_on_the_way_lays_the_map_where_the_world_is(tmp_path, turned):
    teleop = driven(
        tmp_path,
        "6,0.5,0\n",
        slam="gmapping",
        map_path=tmp_path / "m.yaml",
        settings={"laser.fov": 270, "laser.beams": 181, **turned},
    )
    grid = read_map(tmp_path / "m.yaml").grid
    assert teleop.robot.pose == pytest.approx(teleop.robot.plant.pose, abs=0.1)
    assert grid.origin[2] == 0.0
    wall = grid.map_to_cell([[3.9, 10.0]])[0]  # the corridor's northern wall
    assert (grid.cells[wall[0] - 2 : wall[0] + 3, wall[1]] == 100).any()
    assert grid.cells[tuple(grid.map_to_cell([[4.0, 8.8]])[0])] == 0
    counts, _ = messages(tmp_path / "o.mcap")
    assert counts["/map"] == 6
    assert teleop.robot.grid is not None


@pytest.mark.parametrize(("algo", "file"), [("gmapping", "gmapping.launch"), ("cartographer", "backpack_2d.lua")])
def test_the_missions_files_of_the_system_that_maps(tmp_path, algo, file):
    teleop = driven(
        tmp_path, "3,0.5,0\n", slam=algo, slam_files=(Path(file),), map_path=tmp_path / "m.yaml",
        settings={"laser.fov": 270, "laser.beams": 181},
    )  # fmt: skip
    assert (read_map(tmp_path / "m.yaml").grid.cells == 100).sum() > 100
    assert file in [entry["name"] for entry in json.loads(teleop.driven.record.read_text())["inputs"]]


def test_a_drive_that_breaks_off_leaves_nothing(tmp_path):
    teleop = Teleop(TeleopRequest(world="office", path=tmp_path / "o.mcap", settings=FEW))
    with pytest.raises(ZeroDivisionError), teleop.driving() as robot:  # noqa: PT012
        robot.advance_to(0.5)
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UsageError, match="nothing has been driven"):
        _ = teleop.driven


def test_a_map_of_nothing_is_an_error_but_the_recording_stays(tmp_path):
    request = TeleopRequest(world="office", path=tmp_path / "o.mcap", slam="gmapping", map_path=tmp_path / "m.yaml")
    with (
        pytest.raises(EstimationError, match=r"the recording is in .*o\.mcap; no map was made: "),
        Teleop(request).driving(),
    ):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["o.mcap"]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"world": "nowhere"}, "no world file and no built-in world"),
        ({"start": (900.0, 0.0, 0.0)}, r"start 900,0 is outside world office: it reaches from 0,0 to 30,18"),
        ({"start": (0.0, 0.0, 0.0)}, "touches a wall"),
        ({"start": (float("nan"), 0.0, 0.0)}, "not finite"),
        ({"max_time_s": float("nan")}, "--max-time nan s"),
        ({"max_time_s": 0.0}, "--max-time 0 s"),
        ({"slam_sets": ("particles=3",)}, "give --slam too"),
        ({"slam": "gmapping", "settings": {"laser.enabled": False}}, "--slam gmapping needs the scanner"),
        (
            {"slam": "gmapping", "slam_files": (Path("move_base.launch"),)},
            r"move_base\.launch: says nothing to gmapping",
        ),
        ({"path": Path()}, "names no file: name the recording"),
        ({"slam": "rtabmap"}, "does not map as it goes"),
        ({"name": "o.txt"}, "cannot tell the format"),
    ],
)
def test_wrong_requests(tmp_path, changed, message):
    with pytest.raises(UsageError, match=message):
        driven(tmp_path, "1,0,0\n", **{"name": "o.mcap", **changed})
    assert [p.name for p in tmp_path.iterdir()] == ["s.csv"]


def test_inputs_are_not_overwritten(tmp_path):
    for key in ("truth", "map_path"):
        with pytest.raises(UsageError, match=r"s\.csv is read: name another file"):
            driven(tmp_path, "1,0,0\n", **{key: tmp_path / "s.csv"})
    with pytest.raises(UsageError, match="named twice"):
        driven(tmp_path, "1,0,0\n", truth=tmp_path / "o.mcap")


def test_a_script_without_an_end(tmp_path):
    with pytest.raises(ConfigError, match="the drive lasts 0 s: the last time is where it ends"):
        driven(tmp_path, "0,1,0,0\n")


def test_what_the_simulator_does_not_have_is_said(tmp_path):
    log = RunLog()
    settings = {"laser.enabled": False, "imu.enabled": True}
    Teleop(TeleopRequest(world="office", path=tmp_path / "o.mcap", settings=settings), log)
    assert log.warnings[0].startswith("nothing is scanned: laser.enabled is false")
    assert log.warnings[1].startswith("imu.enabled: not simulated")


def test_a_world_without_a_start(tmp_path):
    (tmp_path / "w.yaml").write_text("rooms:\n  - [0, 0, 6, 4]\n")
    teleop = Teleop(TeleopRequest(world=str(tmp_path / "w.yaml"), path=tmp_path / "o.mcap"))
    assert teleop.robot.start == pytest.approx([3, 2, 0], abs=1.1)


@pytest.mark.parametrize(
    ("rate", "first", "dues"), [(20.0, 0, [0, 5, 10]), (30.0, 2, [2, 5, 9]), (1000.0, 1, [1, 2, 3])]
)
def test_rhythms_keep_to_the_tick(rate, first, dues):
    rhythm = Rhythm(rate, lambda: None, first)
    found = []
    for _ in dues:
        found.append(rhythm.due)
        rhythm.advance()
    assert found == dues
    assert Rhythm(0.0, lambda: None).due == float("inf")
