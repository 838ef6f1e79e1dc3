# SPDX-License-Identifier: MIT
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from memory_recording import MemoryContainer
from planar_run import pick_topics, planar_run

from slamcli.errors import RecordingError
from slamcli.geometry import quaternion, se3
from slamcli.measurements import FrameTransform, LaserScan, Odometry
from slamcli.recordings.laser_mount import find_laser_mount
from slamcli.recordings.mends import Mends
from slamcli.recordings.odometry_track import read_odometry
from slamcli.recordings.recording import Recording

S = 1_000_000_000


def _scan(i: int, frame: str = "laser", num: int = 4) -> LaserScan:
    return LaserScan(
        stamp_ns=i * S,
        frame_id=frame,
        angle_min_rad=-0.5,
        angle_increment_rad=0.25,
        range_min_m=0.1,
        range_max_m=10.0,
        ranges_m=np.arange(1, num + 1, dtype=np.float32),
    )


def _odometry(i: int, child: str = "base_link") -> Odometry:
    return Odometry(
        stamp_ns=i * S,
        frame_id="odom",
        child_frame_id=child,
        position_m=np.array([float(i), 0.0, 0.0]),
        quat_xyzw=quaternion.from_yaw(0.1 * i),
    )


def _transform(i: int, parent: str, child: str, xyz: Any, rpy: Any = (0.0, 0.0, 0.0)) -> FrameTransform:
    return FrameTransform(
        stamp_ns=i * S,
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=np.array(xyz, dtype=np.float64),
        quat_xyzw=quaternion.from_roll_pitch_yaw(*rpy),
    )


def _robot(
    *, scans: dict[str, str] | None = None, odometry: tuple[str, ...] = ("/odom",), tf: bool = True, roll: float = 0.0
) -> MemoryContainer:
    container = MemoryContainer()
    with container.writer() as writer:
        for i in range(1, 11):
            for topic, frame in (scans or {"/scan": "laser"}).items():
                writer.write(topic, _scan(i, frame))
            for topic in odometry:
                writer.write(topic, _odometry(i))
            if tf:
                writer.write("/tf", _transform(i, "odom", "base_link", (2.0 * i, 0.0, 0.0)))
        if tf:
            static = _transform(0, "base_link", "laser", (0.2, 0.0, 0.3), (roll, 0.0, 0.5))
            writer.write("/tf_static", static, log_time_ns=S)
    return container


def test_the_usual_robot() -> None:
    recording = _robot().recording()
    planar = planar_run(recording)
    assert (planar.picks.scan.name, planar.picks.base_frame, planar.picks.odom_frame) == ("/scan", "base_link", "odom")
    assert planar.picks.odometry == "topic"
    np.testing.assert_allclose(se3.to_se2(planar.mount.T_base_laser), [0.2, 0.0, 0.5])
    assert planar.odometry is not None
    np.testing.assert_allclose(planar.odometry.poses[:, 0], np.arange(1, 11))
    np.testing.assert_allclose(planar.odometry.poses[:, 2], 0.1 * np.arange(1, 11))
    assert len(planar.scans) == 10
    assert recording.log.notes == ["odometry from topic /odom (odom -> base_link)"]
    assert not recording.log.warnings


def test_odometry_from_tf_where_there_is_no_topic_or_when_asked() -> None:
    for container, asked in ((_robot(odometry=()), None), (_robot(), "tf")):
        recording = container.recording()
        planar = planar_run(recording, odom_topic=asked)
        assert planar.picks.odometry == "tf"
        assert planar.odometry is not None
        np.testing.assert_allclose(planar.odometry.poses[:, 0], 2.0 * np.arange(1, 11))
        np.testing.assert_array_equal(planar.odometry.stamps_ns, np.arange(1, 11) * S)
        why = "as asked" if asked else "there is no odometry topic"
        assert recording.log.notes == [f"odometry from the transform odom -> base_link on /tf ({why})"]


def test_part_of_the_odometry() -> None:
    for asked in (None, "tf"):
        planar = planar_run(_robot().recording(), odom_topic=asked, start_s=4.0, duration_s=3.0)
        assert planar.odometry is not None
        assert len(planar.odometry) == (3 if asked is None else 5)
        assert [scan.stamp_ns // S for scan in planar.scans] == [5, 6, 7]


def test_no_odometry_is_warned_of() -> None:
    recording = _robot(odometry=(), tf=False).recording()
    planar = planar_run(recording)
    assert planar.odometry is None
    assert planar.picks.base_frame == "laser"
    assert any(warning.startswith("no odometry:") for warning in recording.log.warnings)
    assert any("poses are those of the scanner itself (laser)" in warning for warning in recording.log.warnings)


def test_tf_odometry_that_is_not_there_is_an_error() -> None:
    with pytest.raises(RecordingError, match="no odometry in tf: odom -> laser"):
        planar_run(_robot(tf=False).recording(), odom_topic="tf")


def test_ground_truth_is_not_taken_for_odometry() -> None:
    recording = _robot(odometry=("/base_pose_ground_truth",)).recording()
    assert pick_topics(recording).odometry == "tf"
    recording = _robot(odometry=("/base_pose_ground_truth", "/robot/odom")).recording()
    picks = pick_topics(recording)
    assert picks.odom_topic is not None
    assert picks.odom_topic.name == "/robot/odom"
    assert "also there: /base_pose_ground_truth; choose with --odom-topic" in recording.log.notes[0]
    named = pick_topics(recording, odom_topic="/base_pose_ground_truth")
    assert named.odom_topic is not None
    assert named.odom_topic.name == "/base_pose_ground_truth"


def test_the_usual_scanner_of_several_and_the_named_one() -> None:
    recording = _robot(scans={"/tilt_scan": "tilt", "/base_scan": "laser"}).recording()
    assert pick_topics(recording).scan.name == "/base_scan"
    assert recording.log.notes[0] == "scans: /base_scan is used (also there: /tilt_scan; choose with --scan-topic)"
    assert pick_topics(recording, scan_topic="tilt_scan").laser_frame == "tilt"
    with pytest.raises(RecordingError, match="did you mean /base_scan"):
        pick_topics(recording, scan_topic="/bace_scan")


def test_a_recording_without_scans() -> None:
    container = MemoryContainer()
    container.writer().write("/odom", _odometry(1))
    with pytest.raises(RecordingError, match=r"no sensor_msgs/LaserScan topic \(it has /odom \(nav_msgs/Odometry\)\)"):
        pick_topics(container.recording())


def test_odometry_of_the_footprint_is_moved_to_the_base() -> None:
    container = MemoryContainer()
    with container.writer() as writer:
        for i in range(1, 4):
            writer.write("/odom", _odometry(i, "base_footprint"))
            writer.write("/scan", _scan(i))
        writer.write("/tf_static", _transform(1, "base_footprint", "base_link", (-1.0, 0.0, 0.1)))
        writer.write("/tf_static", _transform(1, "base_link", "laser", (0.2, 0.0, 0.1)))
    picks = pick_topics(container.recording(), base_frame="base_link")
    track = read_odometry(container.recording(), picks)
    assert track is not None
    np.testing.assert_allclose(track.poses[1], [2.0 - np.cos(0.2), -np.sin(0.2), 0.2])
    assert pick_topics(container.recording()).base_frame == "base_footprint"


def _mounted(recording: Recording) -> Any:
    return find_laser_mount(recording, base_frame="base_link", laser_frame="laser")


def test_an_upside_down_scanner() -> None:
    recording = _robot(roll=np.pi).recording()
    planar = planar_run(recording)
    assert planar.mount.upside_down
    assert "laser is mounted upside down: scans are turned" in recording.log.notes
    np.testing.assert_allclose(planar.mount.T_base_laser[2, :3], [0, 0, 1], atol=1e-12)
    # The same points in the base frame, whichever way they are computed.
    scan, raw = planar.scans[0], _scan(1)
    T = recording.frames().lookup("base_link", "laser")
    expected = {tuple(np.round(T[:2, :2] @ p + T[:2, 3], 6)) for p in _xy(raw)}
    upright = planar.mount.T_base_laser
    assert {tuple(np.round(upright[:2, :2] @ p + upright[:2, 3], 6)) for p in _xy(scan)} == expected


def _xy(scan: LaserScan) -> np.ndarray:
    angles = scan.angles_rad
    return np.column_stack([scan.ranges_m * np.cos(angles), scan.ranges_m * np.sin(angles)]).astype(np.float64)


def test_the_mount_from_a_given_pose_a_mend_and_a_robot_model() -> None:
    container = _robot(tf=False)
    given = _mounted(container.recording(Mends(laser_pose=np.array([1.0, 2.0, 0.5]))))
    np.testing.assert_allclose(se3.to_se2(given.T_base_laser), [1.0, 2.0, 0.5])
    joint = _transform(0, "base_link", "laser", (0.4, 0.0, 0.0))
    for mends in (Mends(static_transforms=(joint,)), Mends(model_transforms=(joint,))):
        recording = container.recording(mends)
        np.testing.assert_allclose(se3.to_se2(_mounted(recording).T_base_laser), [0.4, 0.0, 0.0])
        assert not recording.log.warnings


def test_a_missing_mount_and_a_tilted_one_are_warned_of() -> None:
    recording = _robot(scans={"/scan": "lidar"}).recording()
    mount = find_laser_mount(recording, base_frame="base_link", laser_frame="lidar")
    assert mount.source == "none"
    assert "no transform base_link -> lidar: the scanner is taken to sit at base_link" in recording.log.warnings[0]
    recording = _robot(roll=0.3).recording()
    _mounted(recording)
    assert "laser is tilted by 17° against base_link" in recording.log.warnings[0]
