# SPDX-License-Identifier: MIT
"""Constant velocity: straight on in the local frame, over the last poses that were found."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.cartographer.pose_extrapolator_2d import ConstantVelocity2d
from slamcli.geometry import se2

S = 1_000_000_000


def led(pose, motions):
    for motion in motions:
        pose = se2.compose(pose, motion)
    return pose


def test_nothing_is_known_before_two_poses():
    speed = ConstantVelocity2d(0.001)
    np.testing.assert_array_equal(speed.motions(np.array([0, S]), None), 0.0)
    np.testing.assert_array_equal(speed.motions(np.array([0, S]), np.array([0.0, 0.3]))[:, 2], [0.0, 0.3])
    speed.add(0, np.array([1.0, 2.0, 0.5]))
    np.testing.assert_array_equal(speed.motions(np.array([S]), None), 0.0)


def test_position_goes_straight_on_while_the_heading_turns():
    speed, first, second = ConstantVelocity2d(0.001), np.array([1.0, 2.0, 3.0]), np.array([1.2, 1.9, -3.2])
    speed.add(0, first)
    speed.add(S // 2, second)
    turn = se2.wrap_angle(second[2] - first[2])
    motions = speed.motions(np.array([S, 2 * S]), None)
    for k, seconds in ((1, 0.5), (2, 1.5)):
        expected = second + np.append(0.4 * seconds, [-0.2 * seconds, 2 * turn * seconds])
        found = led(second, motions[:k])
        np.testing.assert_allclose(found[:2], expected[:2], atol=1e-12)
        assert se2.wrap_angle(found[2] - expected[2]) == pytest.approx(0.0, abs=1e-12)


def test_a_gyroscope_tells_the_turns():
    speed = ConstantVelocity2d(0.001)
    speed.add(0, np.zeros(3))
    speed.add(S, np.array([1.0, 0.0, 0.2]))
    motions = speed.motions(np.array([2 * S, 3 * S]), np.array([0.5, -0.1]))
    np.testing.assert_array_equal(motions[:, 2], [0.5, -0.1])
    np.testing.assert_allclose(led(np.array([1.0, 0.0, 0.2]), motions), [3.0, 0.0, 0.6], atol=1e-12)


def test_a_longer_queue_averages_velocities():
    poses = [np.array([x, 0.0, 0.0]) for x in (0.0, 1.0, 1.5, 3.0, 3.5)]
    speeds = {}
    for queue_s in (0.001, 2.0):
        speed = ConstantVelocity2d(queue_s)
        for k, pose in enumerate(poses):
            speed.add(k * S, pose)
        speeds[queue_s] = speed.motions(np.array([5 * S]), None)[0, 0]
    assert speeds == {0.001: pytest.approx(0.5), 2.0: pytest.approx(1.0)}


def test_two_poses_at_one_time_keep_the_velocity():
    speed = ConstantVelocity2d(0.0)
    for stamp, x in ((0, 0.0), (S, 1.0), (S, 1.5)):
        speed.add(stamp, np.array([x, 0.0, 0.0]))
    assert speed.motions(np.array([2 * S]), None)[0, 0] == pytest.approx(1.0)
