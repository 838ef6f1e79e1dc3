# SPDX-License-Identifier: MIT
"""What a tier is fed from recordings of one or several sensors."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamcli.cartographer import TIER as CARTOGRAPHER
from slamcli.errors import RecordingError, UsageError
from slamcli.geometry import quaternion, se3
from slamcli.gmapping import TIER as GMAPPING
from slamcli.measurements import (
    FrameTransform,
    GeoFix,
    ImuSample,
    LandmarkObservation,
    Landmarks,
    LaserScan,
    Odometry,
    PointCloud,
    StampedPose,
)
from slamcli.parameters import resolve
from slamcli.pipelines.message_sampling import FixedRatioSampler
from slamcli.pipelines.range_input import SensorFeed, feed_sensors
from slamcli.pipelines.scan_cloud import cloud_of
from slamcli.recordings import Mends, Recording, adapters, create_recording, open_recording
from slamcli.recordings.adapters import laser_scan
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.runtime import RunLog

MS = 1_000_000
START = 1_700_000_000_000_000_000
UP = np.array([0.0, 0.0, 0.0, 1.0])


def scan(i: int, frame: str = "laser", beams: int = 5) -> LaserScan:
    return LaserScan(
        stamp_ns=START + i * 100 * MS, frame_id=frame, angle_min_rad=-1.0, angle_increment_rad=0.5, range_min_m=0.1,
        range_max_m=10.0, ranges_m=np.arange(1, beams + 1, dtype=np.float32),
    )  # fmt: skip


def cloud(i: int, frame: str = "lidar", height: float = 0.0) -> PointCloud:
    points = np.column_stack([np.arange(1.0, 9.0), np.ones(8), np.linspace(0.0, height, 8)])
    return PointCloud(stamp_ns=START + i * 100 * MS, frame_id=frame, points_m=points.astype(np.float32))


def odometry(i: int, child: str = "base_link") -> Odometry:
    return Odometry(
        stamp_ns=START + i * 50 * MS, frame_id="odom", child_frame_id=child, position_m=np.array([0.1 * i, 0.0, 0.0]),
        quat_xyzw=quaternion.from_yaw(0.1 * i),
    )  # fmt: skip


def imu(i: int, frame: str = "imu") -> ImuSample:
    return ImuSample(
        stamp_ns=START + i * 10 * MS, frame_id=frame, angular_rad_s=np.zeros(3),
        acceleration_m_s2=np.array([0.0, 0.0, 9.8]),
    )  # fmt: skip


def fix(i: int, north_deg: float = 0.0, **changes: Any) -> GeoFix:
    values: dict[str, Any] = dict(
        stamp_ns=START + i * 200 * MS,
        frame_id="gps",
        latitude_deg=48.0 + north_deg,
        longitude_deg=11.0,
        altitude_m=math.nan,
    )
    return GeoFix(**{**values, **changes})


def landmarks(i: int) -> Landmarks:
    seen = LandmarkObservation(id="a", position_m=np.array([2.0, 0.0, 0.0]), quat_xyzw=UP)
    return Landmarks(stamp_ns=START + i * 200 * MS, frame_id="camera", observations=(seen,))


def fixed(child: str, xyz: tuple[float, float, float], *rpy: float) -> FrameTransform:
    return FrameTransform(
        stamp_ns=START, parent_frame_id="base_link", child_frame_id=child, position_m=np.array(xyz),
        quat_xyzw=quaternion.from_roll_pitch_yaw(*(rpy or (0.0, 0.0, 0.0))), static=True,
    )  # fmt: skip


MOUNTS = (
    fixed("laser", (0.2, 0.0, 0.3)),
    fixed("rear", (-0.2, 0.0, 0.3), math.pi, 0.0, math.pi),
    fixed("lidar", (0.0, 0.0, 1.0), math.pi, 0.0, 0.0),
    fixed("imu", (0.0, 0.0, 0.1), 0.0, 0.0, math.pi / 2),
)


def record(path: Path, **topics: Any) -> Path:
    """Write measurements by topic (`a__b` is /a/b), each logged at its stamp; one may be (message type, measurements)."""
    with create_recording(path) as writer:
        writer.write_transforms("/tf_static", MOUNTS)
        rows = []
        for name, listed in topics.items():
            msgtype, measurements = listed if isinstance(listed, tuple) else (None, listed)
            rows += [(m.stamp_ns, "/" + name.replace("__", "/"), m, msgtype) for m in measurements]
        for _, topic, measurement, msgtype in sorted(rows, key=lambda row: row[0]):
            writer.write(topic, measurement, msgtype=msgtype)
    return path


def feed(
    recording: Recording, tier: Any = CARTOGRAPHER, options: dict[str, Any] | None = None, **names: Any
) -> SensorFeed:
    how = {key: names.pop(key) for key in ("mode", "start_s", "duration_s") if key in names}
    given = options or {}
    parameters = resolve(tier.parameters, given)
    sources = dict.fromkeys(given, "--set")
    return feed_sensors(recording, tier, parameters, sources, TopicNames(**names), recording.log, **how)


def counted(found: SensorFeed) -> Counter[str]:
    return Counter(m.topic or type(m).__name__ for m in found.measurements())


ROBOT: dict[str, Any] = {
    "scan": [scan(i) for i in range(10)],
    "rear__scan": [scan(i, "rear", 9) for i in range(10)],
    "points": [cloud(i, height=2.0) for i in range(10)],
    "odom": [odometry(i) for i in range(20)],
    "imu": [imu(i) for i in range(100)],
    "fix": [fix(i, 1e-4 * i) for i in range(5)],
    "landmark": [landmarks(i) for i in range(5)],
}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("robot") / "robot.mcap", **ROBOT)


def test_everything_of_a_robot_in_recorded_order(robot: Path):
    with open_recording(robot) as recording:
        found = feed(recording)
        measurements = list(found.measurements())
        assert found.topics == {
            "scan": "/scan", "odometry": "/odom", "imu": "/imu", "fixes": "/fix", "landmarks": "/landmark"
        }  # fmt: skip
        assert found.frames == {
            "base": "base_link", "odom": "odom", "laser": "laser", "laser_mount": "tf", "imu": "imu", "fixes": "gps",
            "landmarks": "camera",
        }  # fmt: skip
        stamps = [m.stamp_ns for m in measurements]
        assert stamps == sorted(stamps)
        kinds = Counter(type(m).__name__ for m in measurements)
        assert kinds == {"LaserScan": 10, "Odometry": 20, "ImuSample": 100, "StampedPose": 5, "Landmarks": 5}
        np.testing.assert_allclose(found.T_base_sensor["/imu"][:3, 3], [0.0, 0.0, 0.1])
        np.testing.assert_allclose(found.T_base_sensor["/imu"][:2, :2], [[0, -1], [1, 0]], atol=1e-12)
        np.testing.assert_array_equal(found.T_base_sensor["/fix"], np.eye(4))
        assert recording.log.warnings == [
            (
                "no transform base_link -> gps: the receiver is taken to sit at base_link, with the same axes; give its place "
                "with --static-tf or --urdf"
            ),
            (
                "no transform base_link -> camera: the landmark detector is taken to sit at base_link, with the same axes; give its "
                "place with --static-tf or --urdf"
            ),
        ]
        assert "scans: /scan is used (also there: /rear/scan; choose with --scan-topic)" in recording.log.notes


def test_several_scanners_each_with_its_mount_and_its_fan(robot: Path):
    with open_recording(robot) as recording:
        found = feed(recording, scans=("/rear/scan", "scan"), imu="none", fixes="none", landmarks="none")
        measurements = [m for m in found.measurements() if isinstance(m, LaserScan)]
        assert found.topics["scan"] == ["/rear/scan", "/scan"]
        assert found.frames["laser"] == ["rear", "laser"]
        assert {m.topic: m.num_beams for m in measurements} == {"/scan": 5, "/rear/scan": 9}
        assert found.mounts["/rear/scan"].upside_down
        rear = next(m for m in measurements if m.topic == "/rear/scan")
        # Upside down and turned to the back: the first beam of the message is the last one, and all keep their places.
        T, raw = recording.frames().lookup("base_link", "rear"), scan(0, "rear", 9)
        wanted = points_of(raw) @ T[:3, :3].T + T[:3, 3]
        got = points_of(rear) @ found.T_base_laser["/rear/scan"][:3, :3].T + found.T_base_laser["/rear/scan"][:3, 3]
        np.testing.assert_allclose(got[::-1], wanted, atol=1e-6)
        assert found.T_base_laser["/scan"][0, 3] == pytest.approx(0.2)


def points_of(one: LaserScan) -> np.ndarray:
    angles = one.angles_rad
    flat = [one.ranges_m * np.cos(angles), one.ranges_m * np.sin(angles), np.zeros(one.num_beams)]
    return np.column_stack(flat)


def test_in_space_scans_are_clouds_of_their_returns(robot: Path):
    with open_recording(robot) as recording:
        found = feed(recording, scans=("/rear/scan",), mode="3d", imu="none", fixes="none", odometry="none")
        clouds = [m for m in found.measurements() if isinstance(m, PointCloud)]
        assert len(clouds) == 10
        raw = scan(0, "rear", 9)
        T = recording.frames().lookup("base_link", "rear")
        wanted = points_of(raw) @ T[:3, :3].T + T[:3, 3]
        mount = found.T_base_laser["/rear/scan"]
        np.testing.assert_allclose((clouds[0].points_m @ mount[:3, :3].T + mount[:3, 3])[::-1], wanted, atol=1e-6)


def test_a_cloud_of_a_scan_has_its_returns_and_their_times():
    ranges = np.array([1.0, np.inf, np.nan, 2.0], np.float32)
    one = replace(scan(0), ranges_m=ranges, time_increment_s=0.001, intensities=np.arange(4, dtype=np.float32))
    cloud = cloud_of(one)
    np.testing.assert_allclose(cloud.points_m[0], [math.cos(1.0), -math.sin(1.0), 0.0], atol=1e-6)
    np.testing.assert_array_equal(cloud.offset_ns, [0, 3_000_000])
    np.testing.assert_array_equal(cloud.intensities, [0, 3])
    np.testing.assert_array_equal(cloud_of(replace(one, time_increment_s=-0.001)).offset_ns, [3_000_000, 0])
    assert cloud_of(replace(one, time_increment_s=0.0)).offset_ns is None


def test_resampled_scans_are_told_by_their_scanner(tmp_path: Path):
    mixed = [scan(i, beams=5 if i else 7) for i in range(10)]
    path = record(tmp_path / "a.mcap", scan=mixed, rear__scan=ROBOT["rear__scan"])
    with open_recording(path) as recording:
        assert counted(feed(recording, scans=("/scan", "/rear/scan"))) == {"/scan": 10, "/rear/scan": 10}
        assert recording.log.counts["/scan: scans resampled to one fan"] == 1
        assert any(warning.startswith("/scan: 1 scans have other beams") for warning in recording.log.warnings)


def test_clouds_in_their_sensors_frame(robot: Path):
    with open_recording(robot) as recording:
        found = feed(recording, points=("/points",))
        assert found.plan.spatial
        first = next(m for m in found.measurements() if isinstance(m, PointCloud))
        # The sensor hangs upside down: its mount says so, the points stay as they are.
        np.testing.assert_array_equal(first.points_m, cloud(0, height=2.0).points_m)
        np.testing.assert_allclose(np.diag(found.T_base_laser["/points"]), [1, -1, -1, 1], atol=1e-12)
        assert found.topics["points"] == "/points"
        assert not found.picks.scans


def test_flat_clouds_are_a_planar_scanner(tmp_path: Path):
    path = record(tmp_path / "flat.mcap", points=[cloud(i) for i in range(5)], odom=ROBOT["odom"])
    with open_recording(path) as recording:
        found = feed(recording)
        assert not found.plan.spatial
        assert counted(found) == {"/points": 5, "/odom": 20}
        assert "mapping in 2D" in recording.log.notes[0]
    with open_recording(path) as recording:
        assert feed(recording, mode="3d").plan.spatial


def test_multi_echo_scans_by_number(tmp_path: Path):
    echoes = ("sensor_msgs/msg/MultiEchoLaserScan", ROBOT["scan"])
    path = record(tmp_path / "echoes.mcap", horizontal=echoes, scan=ROBOT["scan"])
    with open_recording(path) as recording:
        asked = {"num_laser_scans": 0, "num_multi_echo_laser_scans": 1, "num_point_clouds": 0}
        assert feed(recording, options=asked).topics["scan"] == "/horizontal"
        assert feed(recording, options={**asked, "num_laser_scans": 1}).topics["scan"] == ["/scan", "/horizontal"]
        assert feed(recording).topics["scan"] == "/scan"


def test_an_imu_without_a_place_has_the_axes_of_the_base(tmp_path: Path):
    path = record(tmp_path / "imu.mcap", scan=ROBOT["scan"], imu=[imu(i, "") for i in range(100)])
    with open_recording(path) as recording:
        found = feed(recording)
        assert counted(found) == {"/scan": 10, "/imu": 100}
        np.testing.assert_array_equal(found.T_base_sensor["/imu"], np.eye(4))
        assert "no transform base_link -> (no frame): the IMU is taken to sit at base_link" in recording.log.warnings[0]
        assert found.topics["odometry"] == "none"


def test_odometry_of_another_frame_is_moved_to_the_base(tmp_path: Path):
    path = record(tmp_path / "odom.mcap", scan=ROBOT["scan"], odom=[odometry(i, "laser") for i in range(20)])
    with open_recording(path) as recording:
        found = feed(recording, base_frame="base_link")
        last = [m for m in found.measurements() if isinstance(m, Odometry)][-1]
        raw = odometry(19)
        expected = se3.from_position_quaternion(raw.position_m, raw.quat_xyzw) @ np.linalg.inv(
            recording.frames().lookup("base_link", "laser")
        )
        np.testing.assert_allclose(last.position_m, expected[:3, 3], atol=1e-12)


def test_odometry_from_tf_is_planar_for_a_plane_and_whole_in_space(tmp_path: Path):
    moving = [
        FrameTransform(
            stamp_ns=START + i * 50 * MS, parent_frame_id="odom", child_frame_id="base_link",
            position_m=np.array([0.1 * i, 0.0, 0.02 * i]), quat_xyzw=quaternion.from_roll_pitch_yaw(0.1, 0.0, 0.01 * i),
        )
        for i in range(20)
    ]  # fmt: skip
    path = record(tmp_path / "tf.mcap", points=ROBOT["points"], tf=moving)
    for mode, height, roll in (("2d", 0.0, 0.0), ("3d", 0.38, 0.1)):
        with open_recording(path) as recording:
            told = [m for m in feed(recording, mode=mode).measurements() if isinstance(m, Odometry)]
        assert len(told) == 20
        np.testing.assert_allclose(told[-1].position_m, [1.9, 0.0, height], atol=1e-12)
        assert quaternion.to_matrix(told[-1].quat_xyzw)[2, 2] == pytest.approx(math.cos(roll), abs=1e-12)


def test_fixes_are_poses_in_a_plane_at_the_first_one(tmp_path: Path):
    listed = [
        fix(0, has_fix=False),
        fix(1),
        fix(2, 1e-4, altitude_m=3.0),
        fix(3, 2e-4, covariance_m2=np.diag([1.0, 2.0, 3.0])),
    ]
    path = record(tmp_path / "fix.mcap", scan=ROBOT["scan"], fix=listed)
    with open_recording(path) as recording:
        poses = [m for m in feed(recording).measurements() if isinstance(m, StampedPose)]
        assert recording.log.counts["/fix: messages without a fix"] == 1
    np.testing.assert_allclose(poses[0].position_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(poses[1].position_m, [0.0, 11.12, 3.0], atol=1e-2)
    np.testing.assert_allclose(poses[2].position_m, [0.0, 22.24, 0.0], atol=1e-2)
    assert (poses[0].frame_id, poses[0].child_frame_id, poses[0].topic) == ("earth_plane", "gps", "/fix")
    for pose, variances in ((poses[0], [math.nan] * 3), (poses[2], [1.0, 2.0, 3.0])):
        assert pose.covariance is not None
        np.testing.assert_array_equal(np.diag(pose.covariance), [*variances, math.inf, math.inf, math.inf])


def test_poses_of_another_system_stand_in_for_fixes(tmp_path: Path):
    told = [odometry(i) for i in range(20)]
    path = record(tmp_path / "gps.mcap", scan=ROBOT["scan"], odometry__gps=told, odom=ROBOT["odom"])
    with open_recording(path) as recording:
        found = feed(recording, fixes="/odometry/gps")
        poses = [m for m in found.measurements() if type(m) is StampedPose]
        assert len(poses) == 20
        np.testing.assert_array_equal(poses[7].position_m, told[7].position_m)
        assert found.topics["odometry"] == "/odom"


def test_a_share_of_the_messages(robot: Path):
    ratios = {"rangefinder_sampling_ratio": 0.5, "imu_sampling_ratio": 0.1, "odometry_sampling_ratio": 0.0}
    with open_recording(robot) as recording:
        counts = counted(feed(recording, options=ratios))
    assert counts == {"/scan": 5, "/imu": 10, "/fix": 5, "/landmark": 5}
    sampler = FixedRatioSampler(0.3)
    assert [sampler.pulse() for _ in range(10)] == [True, False, False, True, False, False, True, False, False, False]


def test_a_part_of_the_recording(robot: Path):
    with open_recording(robot) as recording:
        found = feed(recording, start_s=0.45, duration_s=0.3)
        assert found.length_s == pytest.approx(0.3)
        assert [m.stamp_ns - START for m in found.measurements() if isinstance(m, LaserScan)] == [
            500 * MS,
            600 * MS,
            700 * MS,
        ]


def test_the_configurations_frame_of_the_robot(robot: Path):
    with open_recording(robot) as recording:
        assert feed(recording, options={"tracking_frame": "imu"}).base_frame == "imu"
        assert feed(recording, options={"tracking_frame": "imu"}, base_frame="base_link").base_frame == "base_link"
    with open_recording(robot, log=RunLog()) as recording:
        assert feed(recording, options={"tracking_frame": "imu_link"}).base_frame == "base_link"
        assert any("imu_link, is not in the recording" in warning for warning in recording.log.warnings)


@pytest.mark.parametrize(
    ("tier", "names", "complaint"),
    [
        (GMAPPING, {"scans": ("/scan", "/rear/scan")}, "--scan-topic was given 2 times: gmapping takes one scanner"),
        (CARTOGRAPHER, {"scans": ("/scan", "/scan")}, "--scan-topic was given 2 times: one topic more than once"),
        (GMAPPING, {"points": ("/points",)}, "--points-topic /points: gmapping has no use for it"),
        (GMAPPING, {"imu": "/imu"}, "--imu-topic /imu: gmapping has no use for it"),
        (GMAPPING, {"mode": "3d"}, "--mode 3d: gmapping has one mode only"),
        (CARTOGRAPHER, {"mode": "4d"}, "--mode 4d: cartographer has 2d, 3d"),
    ],
)
def test_what_a_tier_has_no_use_for(robot: Path, tier: Any, names: dict[str, Any], complaint: str):
    with open_recording(robot) as recording, pytest.raises(UsageError, match=complaint):
        feed(recording, tier, **names)


@pytest.mark.parametrize(
    ("names", "complaint"),
    [
        ({"scans": ("/points",)}, "topic /points is sensor_msgs/PointCloud2, not LaserScan"),
        ({"imu": "/imi"}, "no topic '/imi'; did you mean /imu"),
        ({"fixes": "/scan"}, "topic /scan is sensor_msgs/LaserScan, not GeoFix"),
        ({"landmarks": "/fix"}, "topic /fix is sensor_msgs/NavSatFix, not Landmarks"),
    ],
)
def test_topics_that_do_not_fit(robot: Path, names: dict[str, Any], complaint: str):
    with open_recording(robot) as recording, pytest.raises(RecordingError, match=complaint):
        feed(recording, **names)


def test_a_recording_without_range_sensors(tmp_path: Path):
    path = record(tmp_path / "none.mcap", odom=ROBOT["odom"])
    with open_recording(path) as recording:
        with pytest.raises(RecordingError, match="no sensor_msgs/LaserScan or PointCloud2 topic"):
            feed(recording)
        with pytest.raises(RecordingError, match="no sensor_msgs/LaserScan topic"):
            feed(recording, GMAPPING)


def test_sensors_that_see_nothing_for_long(tmp_path: Path):
    nothing = np.full(5, np.inf, np.float32)
    scans = [replace(scan(i), ranges_m=nothing) if 10 <= i < 25 or i == 30 else scan(i) for i in range(40)]
    clouds = [replace(cloud(i), points_m=np.zeros((0, 3), np.float32)) if i >= 20 else cloud(i) for i in range(40)]
    path = record(tmp_path / "blind.mcap", scan=scans, points=clouds, odom=ROBOT["odom"])
    with open_recording(path) as recording:
        assert counted(feed(recording, scans=("/scan",), points=("/points",))) == {
            "/scan": 40,
            "/points": 40,
            "/odom": 20,
        }
        assert recording.log.counts["/scan: sweeps without any distance"] == 16
        assert recording.log.counts["/points: sweeps without any distance"] == 20
        assert recording.log.warnings == [
            (
                f"/scan sees nothing for more than a second once, the longest for 1.5 s from {(START + 1000 * MS) / 1e9:.3f} s: other "
                "sensors alone tell the motion there"
            ),
            (
                f"/points sees nothing for more than a second once, the longest for 1.9 s from {(START + 2000 * MS) / 1e9:.3f} s: "
                "other sensors alone tell the motion there"
            ),
        ]


def test_a_scanner_whose_messages_are_garbage_is_left_out(robot: Path, monkeypatch: pytest.MonkeyPatch):
    decode = laser_scan.ADAPTER.decode

    def broken(message: Any, stamp_ns: int, context: Any) -> Any:
        if context.topic == "/rear/scan":
            raise ValueError("garbage")
        return decode(message, stamp_ns, context)

    adapter = replace(laser_scan.ADAPTER, decode=broken)
    monkeypatch.setitem(adapters._BY_MSGTYPE, "sensor_msgs/msg/LaserScan", adapter)
    with open_recording(robot) as recording:
        assert counted(feed(recording, scans=("/rear/scan", "/scan"), imu="none", fixes="none"))["/scan"] == 10
        assert "/rear/scan: no message can be decoded, it is left out" in recording.log.warnings
        with pytest.raises(RecordingError, match="no message on topic /rear/scan can be decoded"):
            feed(recording, scans=("/rear/scan",))


def test_a_given_pose_is_for_one_scanner(robot: Path):
    with open_recording(robot, mends=Mends(laser_pose=np.array([1.0, 0.0, 0.0]))) as recording:
        assert feed(recording).T_base_laser["/scan"][0, 3] == 1.0
        with pytest.raises(UsageError, match="--laser-pose places one scanner, and there are /scan, /rear/scan"):
            feed(recording, scans=("/scan", "/rear/scan"))
