# SPDX-License-Identifier: MIT
"""``slamcli view`` by exit code, JSON and the pictures that it leaves."""

import io
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slamcli.cli.main import run
from slamcli.formats.clouds import write_cloud
from slamcli.formats.maps import write_map
from slamcli.formats.trajectories import write_tum
from slamcli.geometry import quaternion
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform, LaserScan, Odometry, PointCloud, StampedPose
from slamcli.recordings import create_recording, open_recording
from slamcli.trajectory import Trajectory

BEGIN = 1_700_000_000_000_000_000


def loop(n=60, shift=(0.0, 0.0)):
    turn = np.linspace(0, 2 * math.pi, n)
    stamps = BEGIN + (np.arange(n) * 100_000_000)
    return Trajectory.from_se2(
        stamps, np.column_stack([2 * np.cos(turn) + shift[0], 2 * np.sin(turn) + shift[1], turn])
    )


@pytest.fixture
def result(tmp_path):
    folder = tmp_path / "office"
    folder.mkdir()
    cells = np.full((100, 120), -1, dtype=np.int8)
    cells[10:90, 10:110] = 0
    cells[10, 10:110] = 100
    write_map(folder / "map.yaml", OccupancyGrid(cells, 0.05, (-3.0, -2.5, 0.0)))
    write_tum(folder / "trajectory.tum", loop())
    (folder / "run.json").write_text(json.dumps({"algo": "gmapping", "seed": 0, "outputs": ["map.pgm"]}))
    return folder


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "drive.mcap"
    angles = np.linspace(-1.5, 1.5, 31)
    with create_recording(path) as bag:
        for i, pose in enumerate(loop().poses_se2):
            stamp = BEGIN + i * 100_000_000
            quat = quaternion.from_yaw(pose[2])
            bag.write("/odom", Odometry(stamp_ns=stamp, frame_id="odom", child_frame_id="base_link", position_m=np.array([pose[0], pose[1], 0.0]), quat_xyzw=quat))  # fmt: skip
            if i == 0:
                bag.write("/tf_static", FrameTransform(stamp_ns=stamp, parent_frame_id="base_link", child_frame_id="laser", position_m=np.zeros(3), quat_xyzw=quaternion.from_yaw(0.0), static=True))  # fmt: skip
            ranges = np.full(31, 3.0, dtype=np.float32)
            ranges[3], ranges[4] = np.inf, np.nan
            bag.write("/scan", LaserScan(stamp_ns=stamp, frame_id="laser", angle_min_rad=float(angles[0]), angle_increment_rad=0.1, range_min_m=0.1, range_max_m=10.0, ranges_m=ranges))  # fmt: skip
    return path


def pixels(path):
    return np.asarray(Image.open(io.BytesIO(path.read_bytes())).convert("RGB")).astype(int)


def size(path):
    height, width, _ = pixels(path).shape
    return width, height


def facts(capsys):
    return json.loads(capsys.readouterr().out)


def test_result(result, capsys):
    assert run(["view", str(result), "--json"]) == 0
    told = facts(capsys)
    assert told["kind"] == "result"
    assert told["output"] == str(result / "view.png")
    assert told["algo"] == "gmapping"
    assert told["poses"] == 60
    assert told["length_m"] == pytest.approx(4 * math.pi, rel=0.01)
    assert told["resolution_m"] == pytest.approx(0.05)
    assert told["known_area_m2"] == pytest.approx(80 * 100 * 0.0025)
    assert min(size(result / "view.png")) > 500


def test_the_same_bytes_twice(result, tmp_path):
    outputs = [tmp_path / "a.png", tmp_path / "b.png"]
    for output in outputs:
        assert run(["view", str(result), "-o", str(output)]) == 0
    assert outputs[0].read_bytes() == outputs[1].read_bytes()


def test_truth_is_green(result, tmp_path):
    truth = tmp_path / "truth.tum"
    write_tum(truth, loop())
    assert run(["view", str(result), "--truth", str(truth), "-o", str(tmp_path / "t.png"), "--title", "x"]) == 0
    with_truth = pixels(tmp_path / "t.png")
    assert ((with_truth[..., 1] > with_truth[..., 0] + 40) & (with_truth[..., 1] > with_truth[..., 2] + 10)).sum() > 200


def test_map_and_its_size(result, tmp_path, capsys):
    output = tmp_path / "m.png"
    assert run(["view", str(result / "map.yaml"), "-o", str(output), "--max-pixels", "64", "--json"]) == 0
    assert facts(capsys)["kind"] == "map"
    assert max(size(output)) < 400
    assert run(["view", str(result / "map.yaml")]) == 0
    assert (result / "map-view.png").is_file()


def test_a_point_cloud_from_above(tmp_path, capsys):
    points = np.random.default_rng(1).uniform(-5, 5, (2000, 3)).astype(np.float32)
    write_cloud(tmp_path / "c.ply", PointCloud(stamp_ns=0, frame_id="map", points_m=points))
    assert run(["view", str(tmp_path / "c.ply"), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert (shown["kind"], shown["points"], shown["low_m"]) == ("cloud", 2000, points.min(axis=0).tolist())
    with Image.open(tmp_path / "c-view.png") as picture:
        assert min(picture.size) > 1000
    (tmp_path / "g.pcd").write_bytes(b"garbage")
    assert run(["view", str(tmp_path / "g.pcd")]) == 2
    assert "neither a PLY nor a PCD" in capsys.readouterr().err


def test_trajectories(tmp_path, capsys):
    for i in range(3):
        write_tum(tmp_path / f"t{i}.tum", loop(shift=(0.1 * i, 0.0)))
    assert run(["view", *(str(tmp_path / f"t{i}.tum") for i in range(3)), "--json", "--align", "none"]) == 0
    told = facts(capsys)
    assert told["output"] == str(tmp_path / "t0-view.png")
    assert [t["poses"] for t in told["others"]] == [60, 60]


def test_recording(recording, capsys):
    assert run(["view", str(recording), "--json", "--scans", "10"]) == 0
    told = facts(capsys)
    assert told["kind"] == "recording"
    assert told["duration_s"] == pytest.approx(5.9)
    topics = {t["name"]: t for t in told["topics"]}
    assert topics["/scan"]["count"] == 60
    assert topics["/scan"]["rate_hz"] == pytest.approx(10.0)
    assert topics["/odom"]["largest_gap_s"] == pytest.approx(0.1)
    assert told["scans_drawn"] == 10
    assert told["paths"] == [{"source": "/odom", "poses": 60, "length_m": pytest.approx(4 * math.pi, rel=0.01)}]
    assert size(recording.parent / "drive-view.png")[0] > 900


def test_part_of_a_recording(recording, tmp_path, capsys):
    assert (
        run(["view", str(recording), "--start", "1", "--duration", "2", "-o", str(tmp_path / "p.png"), "--json"]) == 0
    )
    told = facts(capsys)
    assert told["duration_s"] == pytest.approx(2.0)
    assert {t["name"]: t["count"] for t in told["topics"]}["/scan"] == 20


def test_a_recording_of_scans_alone(tmp_path, capsys):
    with create_recording(tmp_path / "s.mcap") as bag:
        for i in range(5):
            bag.write("/scan", LaserScan(stamp_ns=BEGIN + i * 10**8, frame_id="laser", angle_min_rad=0.0, angle_increment_rad=0.1, range_min_m=0.1, range_max_m=10.0, ranges_m=np.ones(20, dtype=np.float32)))  # fmt: skip
    assert run(["view", str(tmp_path / "s.mcap"), "--json"]) == 0
    told = facts(capsys)
    assert told["scans_drawn"] == 1
    assert "neither odometry nor transforms" in told["notes"][0]


def test_transforms_place_scans_where_there_is_no_odometry_topic(tmp_path, capsys):
    with create_recording(tmp_path / "tf.mcap") as bag:
        for i in range(30):
            for parent, child, x in (("odom", "base_link", 0.1 * i), ("base_link", "laser", 0.2)):
                bag.write("/tf", FrameTransform(stamp_ns=BEGIN + i * 10**8, parent_frame_id=parent, child_frame_id=child, position_m=np.array([x, 0.0, 0.0]), quat_xyzw=quaternion.from_yaw(0.0)))  # fmt: skip
            bag.write("/scan", LaserScan(stamp_ns=BEGIN + i * 10**8, frame_id="laser", angle_min_rad=0.0, angle_increment_rad=0.1, range_min_m=0.1, range_max_m=10.0, ranges_m=np.ones(20, dtype=np.float32)))  # fmt: skip
    assert run(["view", str(tmp_path / "tf.mcap"), "--json"]) == 0
    told = facts(capsys)
    assert told["scans_drawn"] == 30
    assert told["paths"] == [{"source": "transforms odom > laser", "poses": 30, "length_m": pytest.approx(2.9)}]


def test_ground_truth_in_another_frame_starts_where_odometry_does(tmp_path, capsys):
    with create_recording(tmp_path / "gt.mcap") as bag:
        for i, pose in enumerate(loop().poses_se2):
            for topic, frame, shift in (("/odom", "odom", 0.0), ("/ground_truth", "map", 50.0)):
                bag.write(topic, Odometry(stamp_ns=BEGIN + i * 10**8, frame_id=frame, child_frame_id="base_link", position_m=np.array([pose[0] + shift, pose[1], 0.0]), quat_xyzw=quaternion.from_yaw(pose[2])))  # fmt: skip
    for align, width_m in (("auto", 6.0), ("none", 60.0)):
        assert run(["view", str(tmp_path / "gt.mcap"), "--align", align, "-o", str(tmp_path / f"{align}.png")]) == 0
        assert (size(tmp_path / f"{align}.png")[1] > 1200) == (width_m < 10)
    capsys.readouterr()


def test_an_empty_recording(tmp_path, capsys):
    with create_recording(tmp_path / "e.mcap"):
        pass
    assert run(["view", str(tmp_path / "e.mcap"), "--json"]) == 0
    assert facts(capsys)["topics"] == []


def test_mcap_of_a_result_reads_back(result, tmp_path, capsys):
    truth, output = tmp_path / "truth.tum", tmp_path / "office.mcap"
    write_tum(truth, loop())
    assert run(["view", str(result), "-o", str(output), "--truth", str(truth), "--json"]) == 0
    messages = facts(capsys)["messages"]
    assert messages["/ground_truth"] == 1
    assert (messages["/pose"], messages["/tf"]) == (60, 60)
    first = output.read_bytes()
    with open_recording(output) as bag:
        poses = list(bag.measurements(["/pose"]))
        *_, stamped = bag.measurements(["/map"])
        *_, path = bag.measurements(["/trajectory"])
        tree = bag.frames()
    assert [p.stamp_ns for p in poses] == loop().stamps_ns.tolist()
    assert all(isinstance(p, StampedPose) for p in poses)
    assert stamped.grid.cells.shape == (100, 120)
    assert (stamped.grid.cells[10, 10:110] == 100).all()
    np.testing.assert_allclose(path.path.positions_m, loop().positions_m, atol=1e-12)
    assert tree.frames == ("base_link", "map")
    assert run(["view", str(result), "-o", str(output), "--truth", str(truth), "-q"]) == 0
    assert output.read_bytes() == first


def test_a_damaged_run_record_is_left_out(result, capsys):
    (result / "run.json").write_text("{")
    assert run(["view", str(result), "--json"]) == 0
    assert "run.json" in facts(capsys)["warnings"][0]


def test_open_without_a_desktop(result, monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert run(["view", str(result), "--open"]) == 0
    assert "no desktop" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nothing"], "no such file"),
        ([], "SOURCE"),
        (["{result}", "{result}"], "one result at a time"),
        (["{result}", "{recording}"], "one by one"),
        (["{result}", "-o", "x.jpg"], ".png"),
        (["{recording}", "-o", "x.mcap"], ".png"),
        (["{result}/map.pgm"], ".yaml"),
        (["{empty}"], "neither a result"),
        (["{text}"], "trajectory"),
        (["{log}"], "x.clf.gz"),
        (["{result}", "--truth", "gone.tum"], "gone.tum"),
        (["{recording}", "--start", "99"], "--start"),
        (["{result}", "--max-pixels", "1"], "max-pixels"),
        (["{result}", "--start", "3"], "--start is for recordings, and this is a result"),
        (["{result}", "--scans", "3", "-o", "x.gif"], "--scans is for recordings"),
        (["{result}", "--host", "localhost"], "--host is for --serve"),
        (["{result}", "--export", "x.html", "--port", "80"], "--port is for --serve"),
        (
            ["{result}", "--export", "x.html", "--max-pixels", "2000"],
            "--max-pixels is for pictures, and --export makes none",
        ),
        (["{result}", "--serve", "--align", "fit"], "--align is for pictures, and --serve makes none"),
        (["{bag}"], "bag"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(arguments, told, result, recording, tmp_path, capsys, monkeypatch):
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    empty = tmp_path / "empty"
    empty.mkdir()
    (tmp_path / "x.txt").write_text("hello world\n")
    (tmp_path / "x.clf.gz").write_bytes(b"")
    (tmp_path / "x.bag").write_bytes(b"not a bag at all")
    places = dict(result=result, recording=recording, empty=empty, text=tmp_path / "x.txt", log=tmp_path / "x.clf.gz", bag=tmp_path / "x.bag")  # fmt: skip
    before = sorted(str(p) for p in tmp_path.rglob("*"))
    assert run(["view", *(a.format(**places) for a in arguments)]) == 2
    captured = capsys.readouterr()
    assert told in captured.err
    assert len([line for line in captured.err.splitlines() if line.startswith("slamcli:")]) == 1
    assert captured.out == ""
    assert sorted(str(p) for p in tmp_path.rglob("*")) == before


def test_a_folder_that_cannot_be_written(result, capsys, tmp_path):
    (tmp_path / "file").write_text("")
    assert run(["view", str(result), "-o", str(tmp_path / "file" / "x.png")]) == 2
    assert "cannot write" in capsys.readouterr().err


DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))


@pytest.mark.real_data
@pytest.mark.parametrize(
    "name",
    ["bags/trace0.bag", "bags/trace0_mcap", "bags/rp1.bag", "bags/nav2_turtlebot.mcap", "maps/meeting/meeting.yaml", "trajectories/KITTI_00_gt.txt"],
)  # fmt: skip
def test_real_data(name, tmp_path, capsys):
    if not (DATA / name).exists():
        pytest.skip(f"{DATA / name} is absent: set SLAMCLI_TEST_DATA")
    output = tmp_path / "x.png"
    assert run(["view", str(DATA / name), "-o", str(output), "-q"]) == 0
    assert min(size(output)) > 300


def test_the_last_map_of_a_recording_is_drawn(result, tmp_path, capsys):
    from slamcli.formats.maps import read_map
    from slamcli.recordings.adapters import StampedGrid

    grid = read_map(result / "map.yaml").grid
    path = tmp_path / "nav.mcap"
    with create_recording(path) as bag:
        bag.write("/costmap", StampedGrid(stamp_ns=BEGIN, grid=OccupancyGrid(grid.cells[:5, :5].copy(), 0.05)))
        bag.write("/map", StampedGrid(stamp_ns=BEGIN, grid=OccupancyGrid(grid.cells[:50].copy(), 0.05)))
        for i, pose in enumerate(loop().poses_se2):
            stamp = BEGIN + i * 100_000_000
            bag.write("/tf", FrameTransform(stamp_ns=stamp, parent_frame_id="map", child_frame_id="base_link", position_m=np.array([pose[0], pose[1], 0.0]), quat_xyzw=quaternion.from_yaw(pose[2])))  # fmt: skip
        bag.write("/map", StampedGrid(stamp_ns=BEGIN + 5 * 10**9, grid=grid))
    assert run(["view", str(path), "-o", str(tmp_path / "a.png"), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["map"]
    assert (shown["topic"], shown["stamp_ns"]) == ("/map", BEGIN + 5 * 10**9)
    assert (shown["width_cells"], shown["height_cells"]) == (120, 100)
    assert pixels(tmp_path / "a.png").shape[0] > 400
    assert run(["view", str(path), "-o", str(tmp_path / "b.png"), "--json", "--duration", "3"]) == 0
    assert json.loads(capsys.readouterr().out)["map"]["height_cells"] == 50


def test_a_classic_log_is_drawn_as_it_is(tmp_path, capsys):
    lines = [f"FLASER 4 1 2 3 4 {i / 10} 0 0 {i / 10} 0 0 {1000 + i / 10} host {i / 10}" for i in range(30)]
    (tmp_path / "walk.clf").write_text("\n".join(lines) + "\n")
    assert run(["view", str(tmp_path / "walk.clf"), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["kind"] == "recording"
    assert shown["scans_drawn"] == 30
    assert Path(shown["output"]).is_file()
