# SPDX-License-Identifier: MIT
"""What a tier that sees and ranges is fed: all sensors of one recording, and what happens where they do not go together."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamcli.errors import CalibrationError, RecordingError, UsageError
from slamcli.measurements import (
    CameraModel,
    FrameTransform,
    Image,
    ImuSample,
    LaserScan,
    Measurement,
    Odometry,
    PointCloud,
    RgbdFrame,
    StereoPair,
)
from slamcli.pipelines.camera_input import CameraFeed
from slamcli.pipelines.config import load_native
from slamcli.pipelines.feeds import find_feed
from slamcli.pipelines.fused_input import FusedFeed
from slamcli.pipelines.range_input import SensorFeed
from slamcli.pipelines.sensor_request import SensorRequest
from slamcli.recordings import create_recording, open_recording
from slamcli.recordings.camera_topics import CameraNames
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.rtabmap import TIER
from slamcli.runtime import RunLog

MS = 1_000_000
START = 1_700_000_000_000_000_000
UP = np.array([0.0, 0.0, 0.0, 1.0])
OPTICAL = np.array([-0.5, 0.5, -0.5, 0.5])
SIZE = (24, 32)


def image(ms: int, frame: str = "camera", encoding: str = "mono8") -> Image:
    pixels = np.full(SIZE, 2.0, np.float32) if encoding == "depth" else np.full(SIZE, 60, np.uint8)
    return Image(stamp_ns=START + ms * MS, frame_id=frame, encoding=encoding, pixels=pixels)


def info(shift: float = 0.0) -> CameraModel:
    K = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])
    return CameraModel(
        stamp_ns=START, frame_id="camera", width=SIZE[1], height=SIZE[0], distortion_model="plumb_bob",
        distortion=np.zeros(5), intrinsics=K, rectification=np.eye(3), projection=np.hstack([K, [[shift], [0.0], [0.0]]]),
    )  # fmt: skip


def scan(ms: int) -> LaserScan:
    return LaserScan(
        stamp_ns=START + ms * MS, frame_id="laser", angle_min_rad=-1.0, angle_increment_rad=0.5, range_min_m=0.1,
        range_max_m=10.0, ranges_m=np.arange(1, 6, dtype=np.float32), time_increment_s=0.01,
    )  # fmt: skip


def cloud(ms: int) -> PointCloud:
    points = np.column_stack([np.arange(1.0, 9.0), np.ones(8), np.linspace(0.0, 2.0, 8)])
    return PointCloud(stamp_ns=START + ms * MS, frame_id="lidar", points_m=points.astype(np.float32))


def odometry(ms: int, child: str = "base_link") -> Odometry:
    return Odometry(
        stamp_ns=START + ms * MS, frame_id="odom", child_frame_id=child, position_m=np.array([ms / 1e3, 0.0, 0.0]), quat_xyzw=UP
    )  # fmt: skip


def imu(ms: int) -> ImuSample:
    return ImuSample(
        stamp_ns=START + ms * MS, frame_id="imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.array([0, 0, 9.8])
    )


def place(child: str, xyz: tuple[float, float, float], quat: Any = UP, parent: str = "base_link") -> FrameTransform:
    return FrameTransform(
        stamp_ns=START,
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=np.array(xyz),
        quat_xyzw=quat,
        static=True,
    )


CAMERA, LASER = place("camera", (0.1, 0.0, 0.4), OPTICAL), place("laser", (0.2, 0.0, 0.3))
MOUNTS = (CAMERA, LASER, place("lidar", (0.0, 0.0, 1.0)), place("imu", (0.0, 0.0, 0.1)))
RGBD = {
    "/rgb/camera_info": [info()],
    "/rgb/image": [image(50 * i) for i in range(20)],
    "/depth/image": [image(50 * i + 2, encoding="depth") for i in range(20)],
}
STEREO = {
    "/left/camera_info": [info()], "/left/image": [image(50 * i) for i in range(20)],
    "/right/camera_info": [info(-3.0)], "/right/image": [image(50 * i) for i in range(20)],
}  # fmt: skip
ODOM = {"/odom": [odometry(40 * i + 5) for i in range(27)]}
SCAN = {"/scan": [scan(100 * i + 20) for i in range(9)]}
CLOUD = {"/points": [cloud(100 * i + 20) for i in range(9)]}
IMU = {"/imu": [imu(10 * i) for i in range(100)]}


def record(path: Path, *kinds: dict[str, list[Any]], places: tuple[FrameTransform, ...] = MOUNTS) -> Path:
    with create_recording(path) as writer:
        if places:
            writer.write_transforms("/tf_static", places, log_time_ns=START)
        rows = [(m.stamp_ns, topic, m) for kind in kinds for topic, listed in kind.items() for m in listed]
        for _, topic, measurement in sorted(rows, key=lambda row: row[:2]):
            writer.write(topic, measurement)
    return path


class Fed:
    """A feed, its log, and what it gives."""

    def __init__(self, path: Path, *, sets: tuple[str, ...] = (), **asked: Any) -> None:
        cameras = CameraNames(**asked.pop("cameras", {}))
        mode, window = (
            asked.pop("mode", None),
            {key: asked.pop(key) for key in ("start_s", "duration_s") if key in asked},
        )
        self.log = RunLog()
        config = load_native("rtabmap", (), sets, self.log)
        request = SensorRequest(names=TopicNames(**asked), cameras=cameras, mode=mode, **window)
        with open_recording(path, log=self.log) as recording:
            self.feed = find_feed(recording, TIER, config, request, self.log)
            self.measurements = list(self.feed.measurements())
        self.kinds = Counter(type(m).__name__ for m in self.measurements)


def check_order(measurements: list[Measurement]) -> None:
    """Assert that frames and scans come by stamp, each after odometry and IMU samples past its end."""
    last, known = 0, {"Odometry": 0, "ImuSample": 0}
    for m in measurements:
        name = type(m).__name__
        stamp = m.stamp_ns  # type: ignore[union-attr]
        if name in known:
            known[name] = stamp
            continue
        assert stamp >= last
        last = stamp
        end = stamp + (40 * MS if isinstance(m, LaserScan) else 0)
        assert all(reached >= end for kind, reached in known.items() if reached)


def test_everything_of_one_recording(tmp_path: Path) -> None:
    fed = Fed(record(tmp_path / "a.mcap", RGBD, ODOM, SCAN, IMU))
    assert isinstance(fed.feed, FusedFeed)
    assert fed.kinds["RgbdFrame"] == 20
    assert fed.kinds["LaserScan"] == 9
    assert fed.kinds["Odometry"] >= 25
    check_order([m for m in fed.measurements if not isinstance(m, ImuSample) and m.stamp_ns < START + 900 * MS])  # type: ignore[union-attr]
    assert fed.feed.topics == {
        "rgb": "/rgb/image", "depth": "/depth/image", "scan": "/scan", "odometry": "/odom", "imu": "/imu",
    }  # fmt: skip
    assert (fed.feed.base_frame, fed.feed.frames["laser"], fed.feed.frames["camera"]) == (
        "base_link",
        "laser",
        "camera",
    )
    rig = fed.feed.rig
    assert (rig.mode, rig.base_is_upright, rig.inertial) == ("rgbd", True, True)
    np.testing.assert_allclose(rig.T_base_main @ [0.0, 0.0, 1.0, 1.0], [1.1, 0.0, 0.4, 1.0], atol=1e-12)
    np.testing.assert_allclose(fed.feed.T_base_laser["/scan"][:3, 3], [0.2, 0.0, 0.3])
    np.testing.assert_allclose(fed.feed.T_base_sensor["/imu"][:3, 3], [0.0, 0.0, 0.1], atol=1e-12)
    assert fed.log.warnings == []
    assert fed.feed.length_s == pytest.approx(0.95)


def test_a_clock_of_odometry_that_is_ahead_parts_no_image_from_its_depth(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    kinds = {**RGBD, **SCAN, "/odom": [odometry(40 * i + 5) for i in range(27)]}
    with create_recording(path) as writer:
        writer.write_transforms("/tf_static", MOUNTS, log_time_ns=START)
        for measurement, topic in sorted(
            ((m, t) for t, ms in kinds.items() for m in ms), key=lambda row: row[0].stamp_ns
        ):
            ahead = replace(measurement, stamp_ns=measurement.stamp_ns + 3000 * MS) if topic == "/odom" else measurement
            writer.write(topic, ahead, log_time_ns=measurement.stamp_ns)
    fed = Fed(path)
    assert fed.kinds["RgbdFrame"] == 20
    assert fed.kinds["LaserScan"] == 9
    assert fed.log.warnings == []


def test_stereo_with_clouds(tmp_path: Path) -> None:
    fed = Fed(record(tmp_path / "a.mcap", STEREO, CLOUD, ODOM))
    assert isinstance(fed.feed, FusedFeed)
    assert (fed.kinds["StereoPair"], fed.kinds["PointCloud"]) == (20, 9)
    check_order([m for m in fed.measurements if m.stamp_ns < START + 900 * MS])  # type: ignore[union-attr]
    assert isinstance(next(m for m in fed.measurements if not isinstance(m, Odometry)), StereoPair)


def test_images_with_odometry_of_another_frame(tmp_path: Path) -> None:
    places = (*MOUNTS, place("base_footprint", (0.0, 0.0, -0.1)))
    wheels = {"/odom": [odometry(40 * i, "base_footprint") for i in range(27)]}
    fed = Fed(record(tmp_path / "a.mcap", RGBD, wheels, places=places), base_frame="base_link")
    found = next(m for m in fed.measurements if isinstance(m, Odometry))
    np.testing.assert_allclose(found.position_m, [0.0, 0.0, 0.1])
    assert fed.feed.base_frame == "base_link"


def test_odometry_of_transforms(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with create_recording(path) as writer:
        writer.write_transforms("/tf_static", MOUNTS, log_time_ns=START)
        writer.write("/rgb/camera_info", info())
        for i in range(20):
            moved = FrameTransform(
                stamp_ns=START + 50 * i * MS, parent_frame_id="odom", child_frame_id="base_link",
                position_m=np.array([0.05 * i, 0.0, 0.0]), quat_xyzw=UP,
            )  # fmt: skip
            writer.write_transforms("/tf", [moved], log_time_ns=START + 50 * i * MS)
            writer.write("/rgb/image", image(50 * i))
            writer.write("/depth/image", image(50 * i, encoding="depth"))
    fed = Fed(path)
    assert (fed.kinds["Odometry"], fed.kinds["RgbdFrame"]) == (20, 20)
    check_order(fed.measurements)
    assert isinstance(fed.measurements[0], Odometry)
    assert isinstance(fed.measurements[1], RgbdFrame)
    assert fed.feed.topics["odometry"] == "tf"


def test_images_alone_and_scans_alone_are_fed_as_to_other_tiers(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", RGBD, ODOM, SCAN)
    assert isinstance(Fed(path, odometry="none", scans=("none",)).feed, CameraFeed)
    alone = Fed(path, mode="scan")
    assert isinstance(alone.feed, SensorFeed)
    assert set(alone.kinds) == {"LaserScan", "Odometry"}
    assert not alone.feed.plan.samples_first  # planar scans are aligned at the end: as they were recorded
    alone = Fed(path, mode="scan", sets=("slamcli.odometry=recording",))
    assert alone.feed.plan.samples_first
    check_order([m for m in alone.measurements if m.stamp_ns < START + 900 * MS])  # type: ignore[union-attr]
    assert isinstance(Fed(record(tmp_path / "b.mcap", SCAN, ODOM)).feed, SensorFeed)
    images = Fed(record(tmp_path / "c.mcap", RGBD, places=()))
    assert isinstance(images.feed, CameraFeed)
    assert images.feed.base_frame == "camera"
    assert images.kinds == {"RgbdFrame": 20}


def test_one_part_of_the_recording(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", RGBD, ODOM, SCAN)
    fed = Fed(path, start_s=0.3, duration_s=0.3)
    assert fed.kinds["RgbdFrame"] == 6
    assert fed.kinds["LaserScan"] == 3


def test_sensors_that_tf_does_not_join_with_the_camera_are_left_out(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", RGBD, ODOM, SCAN, places=(LASER,))
    fed = Fed(path)
    assert isinstance(fed.feed, CameraFeed)
    assert (
        "tf does not say where the camera (camera) sits on the robot (base_link), so odometry and /scan"
        in fed.log.warnings[0]
    )
    with pytest.raises(
        CalibrationError, match=r"cannot be used with its images: give its place with --static-tf base_link"
    ):
        Fed(path, odometry="/odom")
    apart = record(tmp_path / "b.mcap", RGBD, ODOM, SCAN, places=(CAMERA,))
    fed = Fed(apart)
    assert set(fed.kinds) == {"RgbdFrame", "Odometry"}
    assert "tf does not say where /scan sits on the robot (base_link): left out" in fed.log.warnings[0]
    with pytest.raises(CalibrationError, match="tf does not say where /scan sits"):
        Fed(apart, scans=("/scan",))


def test_the_truth_in_transforms_is_no_odometry(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with create_recording(path) as writer:
        writer.write("/rgb/camera_info", info())
        for i in range(6):
            moved = FrameTransform(
                stamp_ns=START + 50 * i * MS, parent_frame_id="world", child_frame_id="camera",
                position_m=np.array([0.05 * i, 0.0, 0.0]), quat_xyzw=UP,
            )  # fmt: skip
            writer.write_transforms("/tf", [moved], log_time_ns=START + 50 * i * MS)
            writer.write("/rgb/image", image(50 * i))
            writer.write("/depth/image", image(50 * i, encoding="depth"))
    assert isinstance(Fed(path).feed, CameraFeed)


def test_what_is_said_of_what_does_not_fit(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", RGBD, ODOM, SCAN)
    with pytest.raises(UsageError, match="--mode stereo needs images of a left and a right camera"):
        Fed(path, mode="stereo")
    with pytest.raises(UsageError, match="--mode mono: rtabmap has rgbd, stereo, scan"):
        Fed(path, mode="mono")
    with pytest.raises(UsageError, match="--rgb-topic /rgb/image: --mode scan takes no images"):
        Fed(path, mode="scan", cameras={"rgb": "/rgb/image"})
    with pytest.raises(RecordingError, match="no topic '/lidar'"):
        Fed(path, scans=("/lidar",))
    with pytest.raises(RecordingError, match="no images and no scans or point clouds"):
        Fed(record(tmp_path / "b.mcap", ODOM))
    with pytest.raises(RecordingError, match="no scans or point clouds"):
        Fed(record(tmp_path / "c.mcap", RGBD), mode="scan")
