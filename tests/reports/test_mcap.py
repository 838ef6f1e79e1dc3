# SPDX-License-Identifier: MIT
"""A result as a recording: topics, types, order, frames and sizes, as rosbags and slamcli read them back."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from slamcli.formats.trajectories import write_tum
from slamcli.geometry import se3
from slamcli.measurements import PointCloud
from slamcli.pipelines.replay import load_replay
from slamcli.recordings import open_recording
from slamcli.recordings.diagnosis import diagnose
from slamcli.reports.mcap import write_replay
from slamcli.reports.mcap_clock import moments
from slamcli.trajectory import Trajectory

sys.path.append(str(Path(__file__).parents[1] / "pipelines"))
import small_result as small

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
TYPES = {
    "/map": "nav_msgs/msg/OccupancyGrid", "/trajectory": "nav_msgs/msg/Path", "/ground_truth": "nav_msgs/msg/Path",
    "/pose": "geometry_msgs/msg/PoseStamped", "/tf": "tf2_msgs/msg/TFMessage", "/tf_static": "tf2_msgs/msg/TFMessage",
    "/scan_in_map": "sensor_msgs/msg/PointCloud2", "/particles": "geometry_msgs/msg/PoseArray",
    "/nodes": "visualization_msgs/msg/MarkerArray", "/constraints": "visualization_msgs/msg/MarkerArray",
    "/steps/neff": "std_msgs/msg/Float64", "/rosout": "rcl_interfaces/msg/Log",
}  # fmt: skip


def whole_result(place):
    """Return a folder with a result that has everything a planar tier can have."""
    small.write_recording(place / "room.mcap")
    steps = {
        "stamp_ns": small.stamps_ns().tolist(),
        "neff": [5.0] * (small.STEPS - 1) + [None],
        "scan_index": [0] * small.STEPS,
    }
    folder = small.write_result(
        place / "result", place / "room.mcap", steps=steps, notes=["odometry from /odom"], warnings=["a warning"]
    )
    stamps = small.stamps_ns()
    np.savez(
        folder / "particles.npz", stamps_ns=stamps, poses=np.zeros((len(stamps), 30, 3), np.float32),
        weights=np.full((len(stamps), 30), 1 / 30, np.float32),
    )  # fmt: skip
    write_tum(folder / "keyframes.tum", Trajectory.from_se2(stamps[::5], small.poses_se2()[::5], "map", "base_link"))
    rows = ["stamp_a_s,stamp_b_s,kind,translation_residual_m,rotation_residual_rad"]
    text = [f"{ns // 10**9}.{ns % 10**9:09d}" for ns in stamps[::5].tolist()]
    rows += [f"{text[0]},{text[1]},odometry,,", f"{text[3]},{text[0]},loop,0.2,0.01"]
    (folder / "links.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return whole_result(tmp_path_factory.mktemp("mcap"))


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "result.mcap"
    replay = load_replay(result, truth=result / "trajectory.tum")
    return path, write_replay(path, replay)


def test_topics_have_the_types_that_viewers_expect(written):
    path, counts = written
    with open_recording(path) as recording:
        types = {topic.name: topic.msgtype for topic in recording.contents.topics}
        latched = {topic.name for topic in recording.contents.topics if topic.latched}
        assert {topic.name: topic.count for topic in recording.contents.topics} == counts
    assert types == TYPES
    assert latched == {"/map", "/trajectory", "/ground_truth", "/nodes", "/constraints", "/tf_static"}
    assert counts["/pose"] == counts["/tf"] == counts["/scan_in_map"] == counts["/particles"] == small.STEPS
    assert counts["/steps/neff"] == small.STEPS - 1


def test_log_times_increase_and_are_those_of_the_recording(written):
    with open_recording(written[0]) as recording:
        times = [message.log_time_ns for message in recording.raw.messages()]
    assert times == sorted(times)
    assert (times[0], times[-1]) == (small.START_NS, int(small.stamps_ns()[-1]))


def test_the_map_grows_to_what_it_is(written):
    with open_recording(written[0]) as recording:
        maps = [stamped.grid for stamped in recording.measurements(["/map"])]
    known = [np.count_nonzero(grid.cells >= 0) for grid in maps]
    assert len(maps) > 10
    assert known == sorted(set(known))
    assert np.array_equal(maps[-1].cells, small.room().cells)
    assert {grid.cells.shape for grid in maps} == {small.room().cells.shape}


def test_frames_put_the_recordings_own_scans_in_place(written):
    path, _ = written
    with open_recording(path) as recording:
        tree = recording.frames()
    assert tree.problems == ()
    assert [(edge.parent, edge.child) for edge in tree.edges] == [
        ("base_link", "laser"), ("map", "odom"), ("odom", "base_link")
    ]  # fmt: skip
    T, known = tree.lookup_many("map", "laser", small.stamps_ns())
    assert known.all()
    expected = se3.from_se2(small.poses_se2() + np.array([small.MOUNT_M, 0.0, 0.0]))
    np.testing.assert_allclose(T[:, :2, 3], expected[:, :2, 3], atol=1e-9)


def test_the_path_grows_pose_by_pose_and_ends_whole(written):
    with open_recording(written[0]) as recording:
        paths = [stamped.path for stamped in recording.measurements(["/trajectory"])]
        (truth,) = [stamped.path for stamped in recording.measurements(["/ground_truth"])]
    lengths = [len(path) for path in paths]
    assert lengths == sorted(set(lengths))
    assert lengths[-1] == small.STEPS
    assert len(truth) == small.STEPS
    np.testing.assert_allclose(paths[-1].positions_m[:, :2], small.poses_se2()[:, :2], atol=1e-9)


@pytest.mark.parametrize("name", ["again.mcap", "ros1.bag", "folder"])
def test_every_format_reads_back_and_the_same_input_gives_the_same_bytes(result, written, tmp_path, name):
    replay = load_replay(result, truth=result / "trajectory.tum")
    assert write_replay(tmp_path / name, replay) == written[1]
    with AnyReader([tmp_path / name]) as reader:
        last = {c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()}
        levels = [reader.deserialize(data, c.msgtype).level for c, _, data in reader.messages() if c.topic == "/rosout"]
    loop = next(marker for marker in last["/constraints"].markers if marker.ns == "to 25 cm, 2.5°")
    assert [(p.x, p.y) for p in loop.points] == [tuple(small.poses_se2()[i, :2]) for i in (15, 0)]
    assert len(last["/particles"].poses) == 30
    assert levels == ([2, 4, 2] if name == "ros1.bag" else [20, 30, 20])
    if name == "again.mcap":
        assert (tmp_path / name).read_bytes() == written[0].read_bytes()


def test_the_doctor_has_nothing_to_mend(written):
    with open_recording(written[0]) as recording:
        found = diagnose(recording).findings
    assert [finding.message for finding in found if finding.severity != "note"] == []


def test_a_cloud_grows_with_the_map_below_it(result, tmp_path):
    replay = load_replay(result)
    points = np.column_stack([np.linspace(0.1, 7.9, 500), np.full(500, 1.4), np.ones(500)]).astype(np.float32)
    colours = np.tile(np.array([10, 20, 30], np.uint8), (500, 1))
    cloud = PointCloud(stamp_ns=0, frame_id="", points_m=points, colours=colours)
    write_replay(tmp_path / "out.mcap", replace(replay, cloud=cloud, dense=cloud))
    with open_recording(tmp_path / "out.mcap") as recording:
        clouds = list(recording.measurements(["/cloud"]))
        (dense,) = recording.measurements(["/dense"])
        raw = next(iter(recording.raw.messages(("/dense",))))
        fields = [(f.name, f.offset, f.datatype) for f in recording.raw.decode(raw).fields]
        packed = np.frombuffer(recording.raw.decode(raw).data, dtype=np.uint8).reshape(500, 16)[:, 12:]
    sizes = [len(part.points_m) for part in clouds]
    assert sizes == sorted(set(sizes))
    assert 3 <= len(sizes) <= 13
    assert sizes[-1] == len(dense.points_m) == 500
    assert clouds[0].points_m[:, 0].max() < 3.5
    assert {part.frame_id for part in clouds} == {"map"}
    assert fields[3] == ("rgb", 12, 7)
    assert packed.tolist() == [[30, 20, 10, 0]] * 500


def test_images_come_with_their_calibration_at_their_keyframes(tmp_path):
    source = SAMPLES / "desk_rgbd.mcap"
    stamps = small.START_NS + np.arange(31) * 100_000_000
    folder = small.write_images_result(tmp_path / "desk", {})
    replay = load_replay(folder, recording=[source])
    assert [image.stamp_ns for image in replay.images] == stamps[::10].tolist()
    assert [image.pose_index for image in replay.images] == [0, 10, 20, 30]
    write_replay(tmp_path / "desk.mcap", replay)
    with open_recording(tmp_path / "desk.mcap") as recording, open_recording(source) as original:
        images = list(recording.measurements(["/camera/image/compressed"]))
        models = list(recording.measurements(["/camera/camera_info"]))
        first = next(iter(original.measurements(["/camera/color/image_raw/compressed"])))
        tree = recording.frames()
    assert [image.stamp_ns for image in images] == [model.stamp_ns for model in models] == stamps[::10].tolist()
    assert images[0].pixels.shape == (240, 320, 3)
    assert np.abs(images[0].pixels.astype(int) - first.pixels.astype(int)).mean() < 6.0
    assert (models[0].width, models[0].height) == (320, 240)
    assert tree.connected("map", images[0].frame_id)
    small_jpeg, large = (replay.images[0].jpeg(width) for width in (100, 320))
    assert small_jpeg.startswith(b"\xff\xd8")
    assert len(small_jpeg) < len(large)


def test_moments_share_what_is_new():
    amounts = np.array([0, 5, 5, 0, 0, 10, 0], dtype=np.int64)
    times = np.arange(7) * 10**9
    assert moments(amounts, times, 4) == [1, 2, 5]
    assert moments(amounts, times, 1) == [1, 5]
    assert moments(np.zeros(3, dtype=np.int64), times[:3], 4) == []
    # Less than half a second apart: the first, and the last that has it all.
    assert moments(amounts, times // 100, 4) == [1, 5]
