# SPDX-License-Identifier: MIT
"""Odometry that the recording holds, between its samples and beyond them; which frames become nodes."""

import math

import numpy as np
import pytest

from slamcli.geometry import quaternion, se3
from slamcli.measurements import Odometry
from slamcli.rtabmap.given_odometry import GivenOdometry, motion_covariance
from slamcli.rtabmap.node_rate import NodeRate, flattened, has_moved


def _sample(seconds: float, x: float, yaw: float = 0.0, z: float = 0.0) -> Odometry:
    quat = quaternion.from_yaw(yaw)
    return Odometry(stamp_ns=round(seconds * 1e9), frame_id="odom", position_m=np.array([x, 0.0, z]), quat_xyzw=quat)


def _filled(*samples: Odometry, planar: bool = False) -> GivenOdometry:
    track = GivenOdometry(planar=planar)
    for sample in samples:
        track.add(sample)
    return track


def test_poses_between_samples_are_interpolated() -> None:
    track = _filled(_sample(0.0, 0.0), _sample(0.5, 1.0, math.pi / 2))
    pose = track.at(250_000_000)
    assert pose is not None
    np.testing.assert_allclose(se3.to_se2(pose), [0.5, 0.0, math.pi / 4], atol=1e-12)
    assert track.covers(500_000_000)
    assert not track.covers(500_000_001)


def test_what_odometry_does_not_know() -> None:
    track = _filled(_sample(1.0, 0.0), _sample(2.0, 1.0), _sample(5.0, 9.0))
    assert track.at(800_000_000) is None
    assert track.at(950_000_000) is not None
    assert track.at(3_000_000_000) is None  # silent for 3 s
    assert np.array_equal(track.at(2_090_000_000), track.at(2_000_000_000))
    assert np.array_equal(track.at(4_910_000_000), track.at(5_000_000_000))
    assert track.at(5_050_000_000) is not None
    assert track.at(5_200_000_000) is None
    assert GivenOdometry().at(0) is None


def test_late_samples_are_left_out_and_planar_ones_are_flat() -> None:
    track = _filled(_sample(1.0, 0.0, z=3.0), _sample(0.5, 7.0), _sample(2.0, 1.0), planar=True)
    assert len(track) == 2
    pose = track.at(1_000_000_000)
    assert pose is not None
    assert pose[2, 3] == 0.0


def test_covariance_grows_with_the_motion() -> None:
    still, driven = motion_covariance(np.eye(4)), motion_covariance(se3.from_se2(np.array([1.0, 0.0, 0.5])))
    assert np.all(np.diag(still) > 0)
    assert driven[0, 0] == pytest.approx(0.0005**2 + 0.03**2 + 0.01**2 * 0.5, rel=1e-9)
    assert np.all(np.diag(driven) > np.diag(still))


def test_many_small_motions_are_as_sure_as_a_large_one() -> None:
    whole, part = motion_covariance(se3.from_se2(np.array([1.0, 0.0, 0.5]))), se3.from_se2(np.array([0.01, 0.0, 0.005]))
    np.testing.assert_allclose(100 * np.diag(motion_covariance(part)), np.diag(whole), rtol=0.03)


def test_rate_and_motion() -> None:
    rate = NodeRate(2.0)
    assert sum(rate.due(round(k * 1e8)) for k in range(21)) == 5  # at 0, 0.5, 1.0, 1.5 and 2.0 s
    assert all(NodeRate(0.0).due(0) for _ in range(3))
    restarted = NodeRate(1.0)
    assert restarted.due(100_000_000_000)
    assert restarted.due(0)
    assert has_moved(se3.from_se2(np.array([0.2, 0.0, 0.0])), 0.1, 0.1)
    assert has_moved(se3.from_se2(np.array([0.0, 0.0, 0.2])), 0.1, 0.1)
    assert not has_moved(se3.from_se2(np.array([0.05, 0.0, 0.05])), 0.1, 0.1)
    assert has_moved(np.eye(4), 0.0, 0.0)
    tilted = se3.from_position_quaternion(np.array([1.0, 2.0, 3.0]), quaternion.from_roll_pitch_yaw(0.1, 0.2, 0.3))
    flat = flattened(tilted)
    assert flat[2, 3] == 0.0
    assert flat[2, 2] == 1.0


def test_a_sample_is_itself_whenever_it_is_asked_for() -> None:
    given = GivenOdometry()
    rng = np.random.default_rng(3)
    samples = []
    for i in range(6):
        quat = rng.standard_normal(4)
        samples.append(
            Odometry(
                stamp_ns=i * 400_000_000,
                frame_id="odom",
                child_frame_id="base",
                position_m=rng.standard_normal(3),
                quat_xyzw=quat / np.linalg.norm(quat),
            )
        )
    at_once = []
    for sample in samples:
        given.add(sample)
        at_once.append(given.at(sample.stamp_ns))
    for sample, pose in zip(samples, at_once, strict=True):
        assert pose is not None
        np.testing.assert_array_equal(given.at(sample.stamp_ns), pose)
