# SPDX-License-Identifier: MIT
"""Recordings that others made: identical in every container, and equal to what rosbags decodes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planar_run import planar_run

from slamcli.errors import RecordingError
from slamcli.measurements import FrameTransform, LaserScan, Odometry, StampedPose
from slamcli.recordings import Recording, open_recording
from slamcli.recordings.diagnosis import diagnose

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
BAGS, LASER = DATA / "bags", DATA / "laser"
pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not BAGS.is_dir(), reason=f"no recordings at {DATA} (set SLAMCLI_TEST_DATA)"),
]


def _scans(recording: Recording) -> list[LaserScan]:
    return list(recording.measurements([recording.topics(LaserScan)[0]]))


def test_three_containers_hold_the_same_measurements() -> None:
    def read(name: str) -> tuple[Any, ...]:
        with open_recording(BAGS / name) as recording:
            merged = list(recording.measurements(["/base_scan", "/odom"]))
            edges = recording.frames().edges
            assert not recording.log.warnings
        return (
            [m.stamp_ns for m in merged],
            [type(m) for m in merged],
            np.array([m.ranges_m for m in merged if isinstance(m, LaserScan)]),
            np.array([m.pose_se2 for m in merged if isinstance(m, Odometry)]),
            [(edge.parent, edge.child, edge.num_samples, edge.stamps_ns.sum()) for edge in edges],
        )

    first, *others = (read(name) for name in ("trace0.bag", "trace0_mcap", "trace0_sqlite3"))
    assert len(first[0]) == 1916
    assert first[0] == sorted(first[0])
    for other in others:
        for a, b in zip(first, other, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["trace0.bag", "simpath2.bag"])
def test_measurements_equal_what_rosbags_decodes(name: str) -> None:
    from rosbags.highlevel import AnyReader

    with AnyReader([BAGS / name]) as reader:
        wanted = {"/base_scan", "/odom"}
        truth = [
            (c.topic, reader.deserialize(data, c.msgtype)) for c, _, data in reader.messages() if c.topic in wanted
        ]
    with open_recording(BAGS / name) as recording:
        scans = list(recording.measurements(["/base_scan"]))
        odometry = list(recording.measurements(["/odom"]))
    messages = [message for topic, message in truth if topic == "/base_scan"]
    for scan, message in zip(scans, messages, strict=True):
        assert scan.stamp_ns == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        np.testing.assert_array_equal(scan.ranges_m, message.ranges)
        assert (scan.angle_min_rad, scan.angle_increment_rad) == (message.angle_min, message.angle_increment)
    messages = [message for topic, message in truth if topic == "/odom"]
    for sample, message in zip(odometry, messages, strict=True):
        p, q = message.pose.pose.position, message.pose.pose.orientation
        np.testing.assert_array_equal(sample.position_m, [p.x, p.y, p.z])
        np.testing.assert_allclose(sample.quat_xyzw, [q.x, q.y, q.z, q.w], atol=1e-9)


def test_a_real_robot_in_the_plane() -> None:
    with open_recording(BAGS / "trace0.bag") as recording:
        planar = planar_run(recording)
        scans = planar.scans
        assert planar.odometry is not None
        assert (len(scans), scans[0].num_beams, len(planar.odometry)) == (958, 726, 958)
        np.testing.assert_allclose(planar.mount.T_base_laser[:3, 3], [0.135, 0.0, 0.202])
        path_m = np.linalg.norm(np.diff(planar.odometry.poses[:, :2], axis=0), axis=1).sum()
        from_tf = planar_run(recording, odom_topic="tf").odometry
        assert from_tf is not None
        np.testing.assert_allclose(
            np.linalg.norm(np.diff(from_tf.poses[:, :2], axis=0), axis=1).sum(), path_m, rtol=0.01
        )


def test_a_hand_held_scanner_of_an_early_bag_writer() -> None:
    with open_recording(BAGS / "ccny_laser_scan_matcher_demo.bag") as recording:
        planar = planar_run(recording)
        assert planar.odometry is None
        assert len(planar.scans) == 360


def test_a_bag_of_the_past_is_refused() -> None:
    with pytest.raises(RecordingError, match=r"ccny_laser_scan_splitter_demo\.bag: .*V1\.2"):
        open_recording(BAGS / "ccny_laser_scan_splitter_demo.bag")


def test_poses_and_transforms() -> None:
    with open_recording(BAGS / "ROS_example.bag") as recording:
        assert {topic.name: topic.count for topic in recording.topics(StampedPose)} == {
            "groundtruth": 12765,
            "ORB-SLAM": 8362,
            "S-PTAM": 5439,
        }
    trees = []
    for name in ("tf_example.bag", "tf_example.db3"):
        with open_recording(BAGS / name) as recording:
            trees.append(recording.frames())
            assert len(list(recording.measurements(["/tf"]))) == 517
            assert {type(m) for m in recording.measurements(["/tf_static"])} == {FrameTransform}
    stamp = int(trees[0].edges[-1].stamps_ns[100])
    np.testing.assert_array_equal(*(tree.lookup("odom", "base_link", stamp) for tree in trees))


def test_a_carmen_log_as_it_is() -> None:
    with open_recording(LASER / "mit-csail.clf.gz") as recording:
        planar = planar_run(recording)
        assert planar.odometry is not None
        assert len(planar.scans) == 1988
        path_m = np.linalg.norm(np.diff(planar.odometry.poses[:, :2], axis=0), axis=1).sum()
        assert path_m == pytest.approx(374, abs=10)


@pytest.mark.parametrize(
    ("name", "severe"),
    [
        # The gmapping tier's estimate of these clock offsets is -0.085 s and 0.1 s.
        ("trace0.bag", ["stamp-turning", "sweep-stamp"]),
        ("simpath2.bag", ["stamp-turning"]),
        ("rp1.bag", ["odometry", "tf-missing"]),
    ],
)
def test_the_doctor_on_real_recordings(name: str, severe: list[str]) -> None:
    with open_recording(BAGS / name) as recording:
        found = diagnose(recording).findings
    assert sorted(finding.check for finding in found if finding.severity != "note") == severe
