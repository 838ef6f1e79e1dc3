# SPDX-License-Identifier: MIT
"""Poses between updates pass through both ends and keep the shape of the motion."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.trajectory.bending import as_pose, between_updates, compose, moved_scans


def integrated(motions, start):
    poses = [np.asarray(start, float)]
    for motion in motions[1:]:
        poses.append(se2.compose(poses[-1], motion))
    return np.array(poses)


def random_motions(count=40, seed=0):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0.0, 0.2, count), rng.normal(0, 0.01, count), rng.normal(0.1, 0.15, count)])


def assert_same_poses(found, expected, atol=1e-9):
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=atol)
    np.testing.assert_allclose(se2.wrap_angle(found[:, 2] - expected[:, 2]), 0.0, atol=atol)


def test_composing_scalars_equals_the_arrays_of_geometry():
    rng = np.random.default_rng(3)
    for a, b in rng.uniform(-3, 3, (20, 2, 3)):
        found = compose(as_pose(a), b)
        assert_same_poses(np.array([found]), se2.compose(a, b)[None])
        assert found[2] == a[2] + b[2]  # not wrapped


@pytest.mark.parametrize("indices", [[0], [0, 39], [0, 1, 2, 20], [0, 7, 21, 38]])
def test_updates_that_agree_with_the_motions_change_nothing(indices):
    motions = random_motions()
    poses = integrated(motions, (1.0, -2.0, 3.0))
    found = between_updates(motions, np.array(indices), poses[indices])
    assert_same_poses(found, poses)
    assert np.abs(found[:, 2]).max() <= np.pi


def test_poses_pass_through_the_updates_and_the_rest_is_spread_evenly():
    motions, indices = random_motions(seed=4), np.array([0, 10, 25])
    path = integrated(motions, (0.0, 0.0, 0.0))[indices] + np.array([[0, 0, 0], [0.5, -0.2, 0.1], [0.1, 0.9, -0.3]])
    found = between_updates(motions, indices, path)
    assert_same_poses(found[indices], path)
    for a, b in ((0, 10), (10, 25)):
        plain = integrated(motions[a : b + 1], path[0 if a == 0 else 1])
        missing = path[1 if a == 0 else 2] - plain[-1]
        missing[2] = se2.wrap_angle(missing[2])
        for k in range(a, b):
            expected = plain[k - a] + missing * (k - a) / (b - a)
            assert_same_poses(found[k : k + 1], expected[None])
    assert_same_poses(found[25:], integrated(motions[25:], path[2]))  # after the last update the motions lead on


def test_an_update_across_the_wrap_takes_the_short_way():
    motions = np.zeros((5, 3))
    found = between_updates(motions, np.array([0, 4]), np.array([[0.0, 0, 3.1], [0, 0, -3.1]]))
    turn = (2 * np.pi - 6.2) / 4
    np.testing.assert_allclose(se2.wrap_angle(found[:, 2] - (3.1 + turn * np.arange(5))), 0.0, atol=1e-12)


def test_scans_are_chosen_after_a_distance_or_a_turn():
    x = np.arange(0, 1.0, 0.09)
    straight = np.column_stack([x, 0 * x, 0 * x])
    assert moved_scans(straight).tolist() == [0, 3, 6, 9]  # over 0.2 m since the last chosen one
    turning = np.column_stack([0 * x, 0 * x, 3.1 + 0.06 * np.arange(len(x))])
    turning[:, 2] = se2.wrap_angle(turning[:, 2])
    assert moved_scans(turning).tolist() == [0, 2, 4, 6, 8, 10]
    assert moved_scans(turning, turn_rad=0.25).tolist() == [0, 5, 10]
    assert moved_scans(np.zeros((4, 3))).tolist() == [0]
    assert moved_scans(np.zeros((4, 3)), every=True).tolist() == [0, 1, 2, 3]
