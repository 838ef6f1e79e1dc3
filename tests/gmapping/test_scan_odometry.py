# SPDX-License-Identifier: MIT
"""Scan odometry in an exact room: follows motions with and without wheels, and finds slips."""

from __future__ import annotations

import math

import numpy as np
import pytest
from room_world import beams_at, drifting, drive, from_first

from slamcli.geometry import se2
from slamcli.registration.scan_odometry import ScanOdometry, between, compose


def follow(poses, motions, known=True, beams=120):
    """Poses and steps of scan odometry; `motions` None predicts the last motion again."""
    odometry = ScanOdometry(0.05)
    found, steps, last = [], [], (0.0, 0.0, 0.0)
    for k, pose in enumerate(poses):
        before = odometry.pose
        motion = last if motions is None else tuple(motions[k])
        steps.append(odometry.step(beams_at(pose, beams=beams), motion, known=known))
        found.append(odometry.pose)
        last = between(before, odometry.pose)
    return np.array(found), steps


def assert_follows(found, poses, translation_m=0.04, rotation_rad=0.02):
    error = found - from_first(poses)
    assert np.hypot(error[:, 0], error[:, 1]).max() < translation_m
    assert np.abs(se2.wrap_angle(error[:, 2])).max() < rotation_rad


def wheel_motions(poses):
    drifted = drifting(poses, scale=1.05, turn=1.1)
    return np.vstack([np.zeros((1, 3)), se2.between(drifted[:-1], drifted[1:])])


@pytest.mark.parametrize("beams", [120, 360])
def test_follows_a_drive_with_wheels_that_drift(beams):
    poses = drive(100)[1]
    found, steps = follow(poses, wheel_motions(poses), beams=beams)
    assert_follows(found, poses)
    assert np.mean([step.quality for step in steps[1:]]) > 0.85
    assert all(0.0 <= step.quality <= 1.0 for step in steps)


def test_follows_a_drive_without_wheels():
    poses = drive(100)[1]
    assert_follows(follow(poses, None, known=False)[0], poses)


def test_a_slip_is_found_and_said():
    poses = np.zeros((40, 3))
    poses[:, 0] = np.linspace(-2, -1.6, 40)
    poses[20:30, 2] = np.cumsum(np.full(10, math.radians(8.0)))
    poses[30:, 2] = poses[29, 2]
    motions = np.vstack([np.zeros((1, 3)), se2.between(poses[:-1], poses[1:])])
    motions[20:30, 2] = math.radians(1.0)  # the wheels tell one degree where the robot turns by eight
    found, steps = follow(poses, motions, beams=360)
    assert_follows(found, poses)
    disagreement = np.array([step.disagreement for step in steps])
    assert (disagreement[20:30] > 5).all()
    assert (disagreement[[*range(1, 20), *range(31, 40)]] < 5).all()


def test_one_jump_of_the_heading_is_searched_for():
    poses = np.zeros((12, 3))
    poses[6:, 2] = 0.5
    found, steps = follow(poses, np.zeros((12, 3)), beams=360)
    assert [k for k, step in enumerate(steps) if step.searched] == [6]
    assert_follows(found, poses)


def test_scans_without_points_follow_the_wheels():
    odometry = ScanOdometry(0.05)
    empty = beams_at((0.0, 0.0, 0.0), maxRange=0.2)
    assert len(empty.points) == 0
    for _ in range(3):
        step = odometry.step(empty, (0.1, 0.0, 0.2))
    assert step.quality == 0.0
    assert not step.searched
    expected = compose(compose((0.1, 0.0, 0.2), (0.1, 0.0, 0.2)), (0.1, 0.0, 0.2))
    np.testing.assert_allclose(odometry.pose, expected)


def test_scalar_poses_equal_the_arrays_of_geometry():
    rng = np.random.default_rng(3)
    for a, b in rng.uniform(-3, 3, (20, 2, 3)):
        np.testing.assert_allclose(compose(tuple(a), tuple(b)), se2.compose(a, b), atol=1e-12)
        np.testing.assert_allclose(between(tuple(a), tuple(b)), se2.between(a, b), atol=1e-12)
