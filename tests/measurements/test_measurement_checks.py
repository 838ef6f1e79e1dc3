# SPDX-License-Identifier: MIT
"""Measurements are checked when they are made: the message names what and when."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.measurements import (
    FrameTransform,
    GeoFix,
    Image,
    LandmarkObservation,
    Landmarks,
    LaserScan,
    Odometry,
    PointCloud,
    StampedPose,
)
from slamcli.trajectory import Trajectory

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def scan(**changes):
    settings = {
        "stamp_ns": 7, "frame_id": "laser", "angle_min_rad": -1.0, "angle_increment_rad": 0.5, "range_min_m": 0.1,
        "range_max_m": 9.0, "ranges_m": np.ones(3, np.float32),
    }  # fmt: skip
    return LaserScan(**settings | changes)


def test_a_scans_beams():
    assert scan().num_beams == 3
    np.testing.assert_allclose(scan().angles_rad, [-1.0, -0.5, 0.0])
    assert scan(angle_increment_rad=0.0, ranges_m=np.ones(1, np.float32)).num_beams == 1
    with pytest.raises(FrozenInstanceError):
        scan().stamp_ns = 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ranges_m": np.ones((2, 2), np.float32)}, r"laser scan at 7 ns: ranges have shape \(2, 2\)"),
        ({"angle_min_rad": math.nan}, "not a finite number"),
        ({"angle_increment_rad": math.inf}, "not a finite number"),
        ({"angle_increment_rad": 0.0}, "angle_increment is 0 for 3 beams"),
    ],
)
def test_bad_scans_are_refused(changes, message):
    with pytest.raises(DataError, match=message):
        scan(**changes)


@pytest.mark.parametrize(
    ("position", "quat", "message"),
    [
        (np.zeros(2), IDENTITY, r"position \(2,\)"),
        (np.zeros(3), np.zeros(3), r"orientation \(3,\)"),
        (np.array([0.0, math.nan, 0.0]), IDENTITY, "not finite"),
        (np.zeros(3), np.full(4, math.inf), "not finite"),
        (np.array([1e16, 0.0, 0.0]), IDENTITY, "1e15 m"),
    ],
)
def test_bad_poses_are_refused(position, quat, message):
    for kind in (StampedPose, Odometry):
        with pytest.raises(DataError, match=message):
            kind(stamp_ns=7, frame_id="odom", position_m=position, quat_xyzw=quat)
    with pytest.raises(DataError, match="transform odom -> base"):
        FrameTransform(stamp_ns=7, parent_frame_id="odom", child_frame_id="base", position_m=position, quat_xyzw=quat)


def test_the_planar_part_of_a_pose():
    half = 0.35
    pose = StampedPose(
        stamp_ns=0, frame_id="map", position_m=np.array([1.0, 2.0, 3.0]), quat_xyzw=np.array([0, 0, math.sin(half), math.cos(half)])
    )  # fmt: skip
    np.testing.assert_allclose(pose.pose_se2, [1.0, 2.0, 0.7])


def test_clouds_and_images():
    points = np.zeros((4, 3), np.float32)
    PointCloud(stamp_ns=1, frame_id="lidar", points_m=points, offset_ns=np.zeros(4, np.int64))
    with pytest.raises(DataError, match=r"not \(N, 3\)"):
        PointCloud(stamp_ns=1, frame_id="lidar", points_m=points[:, :2])
    with pytest.raises(DataError, match="intensities has shape"):
        PointCloud(stamp_ns=1, frame_id="lidar", points_m=points, intensities=np.zeros(3, np.float32))
    Image(stamp_ns=1, frame_id="camera", encoding="mono8", pixels=np.zeros((2, 3), np.uint8))
    for encoding, shape in (("mono8", (2, 3, 3)), ("rgb8", (2, 3)), ("weird", (2, 3))):
        with pytest.raises(DataError, match=encoding):
            Image(stamp_ns=1, frame_id="camera", encoding=encoding, pixels=np.zeros(shape, np.uint8))


def test_trajectories():
    poses = np.array([[0, 0, 0], [3, 4, 1], [3, 5, -3]], dtype=float)
    made = Trajectory.from_se2([5, 3, 9], poses, "map", "base")
    assert len(made) == 3
    assert made.length_m == pytest.approx(6.0)
    assert made.stamps_ns.tolist() == [5, 3, 9]  # as recorded
    np.testing.assert_allclose(made.poses_se2, poses, atol=1e-12)
    np.testing.assert_allclose(made.transforms[1, :2, 3], [3, 4])
    part = made.select([2, 0])
    assert part.stamps_ns.tolist() == [9, 5]
    assert part.frame_id == "map"
    assert made.select(np.array([False, True, False])).poses_se2[0, 0] == 3
    assert Trajectory.from_se2([1_700_000_000_123_456_789], poses[:1]).stamps_s[0] == 1700000000.123456789
    with pytest.raises(DataError, match="stamps"):
        Trajectory.from_se2([1, 2], poses)
    with pytest.raises(DataError, match="not finite"):
        Trajectory.from_se2([1], [[0, np.nan, 0]])
    with pytest.raises(DataError, match="farther away"):
        Trajectory.from_se2([1], [[1e16, 0, 0]])


def test_fixes_and_landmarks_that_make_no_sense():
    place = {"stamp_ns": 7, "frame_id": "gps", "latitude_deg": 91.0, "longitude_deg": 0.0, "altitude_m": 0.0}
    with pytest.raises(DataError, match="fix at 7 ns: latitude 91°"):
        GeoFix(**place)
    assert not GeoFix(**place, has_fix=False).has_fix
    with pytest.raises(DataError, match="altitude 1e\\+300 m"):
        GeoFix(**place | {"latitude_deg": 9.0, "altitude_m": 1e300})
    with pytest.raises(DataError, match="landmark 'a': a weight of -1"):
        LandmarkObservation(id="a", position_m=np.zeros(3), quat_xyzw=IDENTITY, rotation_weight=-1.0)
    bad = LandmarkObservation(id="a", position_m=np.array([0, np.nan, 0]), quat_xyzw=IDENTITY)
    with pytest.raises(DataError, match="landmark 'a' at 3 ns: pose is not finite"):
        Landmarks(stamp_ns=3, frame_id="c", observations=(bad,))
