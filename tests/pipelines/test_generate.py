# SPDX-License-Identifier: MIT
"""Generated recordings: what is in them is what was simulated, and the same seed gives the same bytes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from slamcli.errors import SlamcliError, UsageError
from slamcli.formats.maps import read_map, write_map
from slamcli.formats.trajectories import read_tum
from slamcli.grids import OccupancyGrid
from slamcli.measurements import Image, ImuSample, LaserScan, Odometry
from slamcli.pipelines.generate import generate, open_world
from slamcli.recordings import open_recording
from slamcli.runtime import RunLog
from slamcli.simulation import Simulation, resolve_settings

FAST = {"laser.beams": 61, "truth.rate": 20}


@pytest.mark.parametrize("name", ["out.bag", "out.mcap", "out.db3", "folder"])
def test_what_is_read_back_is_what_was_simulated(tmp_path, name):
    made = generate("cluttered_room", tmp_path / name, seed=3, duration_s=3.0, settings={**FAST, "imu.enabled": True})
    world = open_world("cluttered_room")
    simulation = Simulation(
        world, resolve_settings(world.settings, FAST, {"imu.enabled": True}), seed=3, duration_s=3.0
    )
    wanted = [m.measurement for m in simulation.messages() if m.topic == "/scan"]
    with open_recording(tmp_path / name) as recording:
        counts = {t.name: t.count for t in recording.contents.topics}
        assert counts == dict(made.messages)
        assert [t.name for t in recording.topics(LaserScan)] == ["/scan"]
        assert {t.name for t in recording.topics(Odometry)} == {"/odom", "/ground_truth"}
        assert [t.name for t in recording.topics(ImuSample)] == ["/imu"]
        found = list(recording.measurements(["/scan"]))
        np.testing.assert_allclose(recording.frames().lookup("base_link", "imu")[:3, 3], [0, 0, 0.2])
        T_odom_base = recording.frames().lookup("odom", "base_link", found[-1].stamp_ns)
    odometry = [m.measurement for m in simulation.messages() if m.topic == "/odom"]
    nearest = min(odometry, key=lambda o: abs(o.stamp_ns - found[-1].stamp_ns))
    np.testing.assert_allclose(T_odom_base[:2, 3], nearest.position_m[:2], atol=0.03)
    assert len(found) == len(wanted) == 18
    for a, b in zip(found, wanted, strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.ranges_m, b.ranges_m)
        assert a.angle_increment_rad == pytest.approx(b.angle_increment_rad)
        assert a.time_increment_s == pytest.approx(b.time_increment_s)


@pytest.mark.parametrize("changed", [{}, {"camera.compressed": True}, {"depth.encoding": "32FC1"}])
def test_images_are_read_back_as_they_were_taken(tmp_path, changed):
    small = {"camera.width": 40, "camera.height": 30, "camera.rate": 4, "texture.texel": 0.05, **changed}
    for folder in ("a", "b"):
        generate("visual_room", tmp_path / folder / "o.mcap", seed=3, duration_s=0.5, settings=small)
    assert (tmp_path / "a" / "o.mcap").read_bytes() == (tmp_path / "b" / "o.mcap").read_bytes()
    world = open_world("visual_room")
    simulation = Simulation(world, resolve_settings(world.settings, small), seed=3, duration_s=0.5)
    taken = [m for m in simulation.messages() if isinstance(m.measurement, Image)]
    with open_recording(tmp_path / "a" / "o.mcap") as recording:
        topics = [t.name for t in recording.topics(Image)]
        read = list(recording.measurements(topics))
        assert recording.frames().lookup("body", "camera_color_optical_frame")[:3, 3].tolist() == [0.05, 0.03, 0.02]
        info = next(iter(recording.measurements(["/camera/color/camera_info"])))
    assert info.intrinsics[0, 0] == pytest.approx(20 / np.tan(np.radians(32.5)))
    for message, found in zip(taken, read, strict=True):
        image, metres = message.measurement, found.encoding == "depth"
        wanted = image.pixels / 1000 if image.pixels.dtype == np.uint16 else image.pixels
        if not metres and changed.get("camera.compressed"):  # JPEG, and blue first
            assert np.abs(found.pixels[..., ::-1].astype(float) - wanted).mean() < 6
        else:
            np.testing.assert_allclose(found.pixels, wanted, atol=6e-4 if metres else 0)


@pytest.mark.parametrize("name", ["out.bag", "out.mcap", "out.db3"])
def test_the_same_seed_gives_the_same_bytes(tmp_path, name):
    for folder in ("a", "b"):
        generate(
            "cluttered_room", tmp_path / folder / name, seed=3, duration_s=3.0, settings={**FAST, "people.count": 2},
            truth=tmp_path / folder / "t.tum", map_path=tmp_path / folder / "m.yaml",
        )  # fmt: skip
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert files == sorted([name, "out.run.json", "t.tum", "m.yaml", "m.pgm"])
    for file in set(files) - {"out.run.json"}:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_truth_and_map_fit_the_scans(tmp_path):
    generate(
        "office", tmp_path / "o.bag", duration_s=20.0, settings={"laser.noise": 0, "laser.dropout": 0, "laser.sweep": 0},
        truth=tmp_path / "t.tum", map_path=tmp_path / "m.yaml",
    )  # fmt: skip
    truth, grid = read_tum(tmp_path / "t.tum"), read_map(tmp_path / "m.yaml").grid
    with open_recording(tmp_path / "o.bag") as recording:
        scans = list(recording.measurements(["/scan"]))
    assert truth.stamps_ns.tolist() == [s.stamp_ns for s in scans]
    for pose, scan in list(zip(truth.poses_se2, scans, strict=True))[::40]:
        r, a = scan.ranges_m.astype(np.float64), scan.angles_rad + pose[2]
        hit = np.isfinite(r)
        centre = pose[:2] + 0.12 * np.array([np.cos(pose[2]), np.sin(pose[2])])
        points = centre + (r[:, None] * np.column_stack([np.cos(a), np.sin(a)]))[hit]
        rc = grid.map_to_cell(points)
        window = np.stack([grid.cells[rc[:, 0] + i, rc[:, 1] + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
        assert (window == 100).any(axis=0).mean() > 0.999


def test_a_map_yaml_is_a_world(tmp_path):
    cells = np.zeros((120, 200), np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[40:60, 90:94] = 100
    write_map(tmp_path / "m.yaml", OccupancyGrid(cells, 0.05, (-1.0, -2.0, 0.0)))
    made = generate(
        str(tmp_path / "m.yaml"), tmp_path / "o.mcap", duration_s=10.0, settings=FAST, start=(0.0, 0.0, 1.0)
    )
    assert made.length_m > 2
    (tmp_path / "w.yaml").write_text("grid: m.yaml\nstart: [0, 0, 90]\nroute: {waypoints: [[0, 2], [2, 2]]}\n")
    assert generate(str(tmp_path / "w.yaml"), tmp_path / "p.mcap", settings=FAST).length_m == pytest.approx(
        3.7, abs=0.4
    )


def test_settings_given_win_over_the_world_and_start_over_its_start(tmp_path):
    made = generate("office", tmp_path / "o.bag", duration_s=2.0, settings={"laser.beams": 7}, start=(12.0, 8.8, 0.0))
    assert made.settings["laser.beams"] == 7
    assert made.settings["laser.range_max"] == 20
    with open_recording(tmp_path / "o.bag") as recording:
        first = next(iter(recording.measurements(["/ground_truth"])))
    np.testing.assert_allclose(first.pose_se2, [12.0, 8.8, 0.0])


def test_the_runs_record(tmp_path):
    made = generate("office", tmp_path / "o.mcap", seed=4, duration_s=2.0, settings=FAST, truth=tmp_path / "t.tum")
    record = json.loads(made.record.read_text())
    assert made.record == tmp_path / "o.run.json"
    assert record["seed"] == 4
    assert record["changed"] == FAST
    assert record["parameters"]["laser.beams"] == 61
    assert record["outputs"] == ["o.mcap", "o.run.json", "t.tum"]
    assert record["inputs"][0]["name"] == "office.yaml"
    assert record["topics"]["/scan"] == 20


def test_nothing_is_left_of_what_failed(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(SlamcliError):
        generate("office", tmp_path / "o.bag", duration_s=1.0, map_path=tmp_path / "file" / "m.yaml")
    with pytest.raises(SlamcliError):
        generate("office", tmp_path / "o.txt", duration_s=1.0)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_outputs_must_differ_from_each_other_and_from_the_world(tmp_path):
    with pytest.raises(UsageError, match="twice"):
        generate("office", tmp_path / "o.bag", truth=tmp_path / "." / "o.bag")
    world = tmp_path / "w.yaml"
    world.write_text("rooms: [[0, 0, 5, 5]]\n")
    with pytest.raises(UsageError, match="is the world"):
        generate(str(world), tmp_path / "o.bag", map_path=world)
    assert world.read_text() == "rooms: [[0, 0, 5, 5]]\n"


def test_carts_that_only_robots_that_navigate_meet_are_warned_of(tmp_path):
    world = tmp_path / "w.yaml"
    world.write_text("rooms: [[0, 0, 6, 5]]\nobstacles: [{at: [4, 4], radius: 0.2}]\n")
    log = RunLog()
    generate(str(world), tmp_path / "a.mcap", duration_s=1.0, log=log)
    assert [w for w in log.warnings if w.startswith("carts and obstacles that come and go")] == log.warnings
    assert len(log.warnings) == 1
