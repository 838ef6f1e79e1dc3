# SPDX-License-Identifier: MIT
"""Alignment of points: exact recovery, equivariance, least squares, and what cannot be aligned."""

import numpy as np
import pytest

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import alignment, quaternion, se3


def random_pose(rng):
    quat = quaternion.normalise(rng.normal(size=4))
    return se3.from_position_quaternion(rng.normal(size=3) * 10, quat)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [1.0, 0.2, 7.5])
def test_umeyama_recovers_a_similarity(seed, scale):
    rng = np.random.default_rng(seed)
    points, T = rng.normal(size=(30, 3)), random_pose(rng)
    target = scale * points @ T[:3, :3].T + T[:3, 3]
    found = alignment.umeyama(points, target, with_scale=True)
    np.testing.assert_allclose(found.rotation, T[:3, :3], atol=1e-12)
    np.testing.assert_allclose(found.translation_m, T[:3, 3], atol=1e-11)
    assert found.scale == pytest.approx(scale, rel=1e-12)
    np.testing.assert_allclose(found.transform_points(points), target, atol=1e-11)
    np.testing.assert_allclose(found.matrix[:3, :3], scale * T[:3, :3], atol=1e-11)


def test_rotation_stays_a_rotation_where_a_mirror_would_fit_better():
    points = np.random.default_rng(0).normal(size=(20, 3))
    found = alignment.umeyama(points, points * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1)


def test_planar_points_are_enough_and_lines_are_not():
    plane = np.column_stack([np.random.default_rng(1).normal(size=(10, 2)), np.zeros(10)])
    np.testing.assert_allclose(alignment.umeyama(plane, plane).rotation, np.eye(3), atol=1e-12)
    line = np.outer(np.arange(5.0), [1, 2, 3])
    for points in (line, np.ones((5, 3)), np.ones((1, 3))):
        with pytest.raises(EstimationError, match="on one line or in one point"):
            alignment.umeyama(points, points)


def test_no_other_transform_is_better():
    rng = np.random.default_rng(2)
    source, target = rng.normal(size=(2, 40, 3))
    found = alignment.umeyama(source, target, with_scale=True)
    best = ((found.transform_points(source) - target) ** 2).sum()
    for _ in range(200):
        turn = quaternion.to_matrix(quaternion.normalise(np.append(rng.normal(size=3) * 1e-3, 1)))
        other = alignment.Similarity(
            turn @ found.rotation, found.translation_m + rng.normal(size=3) * 1e-3, found.scale + rng.normal() * 1e-3
        )
        assert ((other.transform_points(source) - target) ** 2).sum() >= best


@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 0.5, 2.0, np.pi])
def test_posyaw_finds_the_yaw(yaw):
    points = np.random.default_rng(3).normal(size=(30, 3))
    turn = quaternion.to_matrix(quaternion.from_yaw(yaw))
    found = alignment.yaw_and_position(points, points @ turn.T + [1, 2, 3])
    np.testing.assert_allclose(found.rotation, turn, atol=1e-12)
    np.testing.assert_allclose(found.translation_m, [1, 2, 3], atol=1e-12)
    assert found.scale == 1


def test_posyaw_is_least_squares_over_yaw_by_brute_force():
    rng = np.random.default_rng(4)
    source, target = rng.normal(size=(2, 25, 3))
    found = alignment.yaw_and_position(source, target)

    def cost(yaw):
        turned = source @ quaternion.to_matrix(quaternion.from_yaw(yaw)).T
        return ((turned - turned.mean(0) - target + target.mean(0)) ** 2).sum()

    yaws = np.linspace(-np.pi, np.pi, 20001)
    best = yaws[np.argmin([cost(yaw) for yaw in yaws])]
    assert np.arctan2(found.rotation[1, 0], found.rotation[0, 0]) == pytest.approx(best, abs=5e-4)


def test_posyaw_of_one_pose_keeps_z_upright():
    rng = np.random.default_rng(5)
    pose = random_pose(rng)
    turn = se3.from_position_quaternion([4, 5, 6], quaternion.from_yaw(0.8))
    found = alignment.yaw_and_position_of_pose(pose, turn @ pose)
    np.testing.assert_allclose(found.matrix, turn, atol=1e-12)


def test_posyaw_of_a_vertical_line_is_refused():
    with pytest.raises(EstimationError, match="stand above one another"):
        alignment.yaw_and_position(np.outer(np.arange(4.0), [0, 0, 1]), np.outer(np.arange(4.0), [0, 0, 1]))


def test_pose_to_pose_lays_one_on_the_other():
    rng = np.random.default_rng(6)
    a, b = random_pose(rng), random_pose(rng)
    found = alignment.pose_to_pose(a, b)
    np.testing.assert_allclose(found.transform_poses(a), b, atol=1e-12)


def test_poses_are_scaled_in_position_only():
    rng = np.random.default_rng(7)
    pose = random_pose(rng)
    moved = alignment.Similarity(np.eye(3), np.array([1.0, 0, 0]), 2.0).transform_poses(pose[None])[0]
    np.testing.assert_allclose(moved[:3, :3], pose[:3, :3])
    np.testing.assert_allclose(moved[:3, 3], 2 * pose[:3, 3] + [1, 0, 0])


def test_shapes_are_checked():
    with pytest.raises(DataError, match="not paired points"):
        alignment.umeyama(np.zeros((3, 3)), np.zeros((4, 3)))
    with pytest.raises(DataError, match="not paired points"):
        alignment.yaw_and_position(np.zeros((3, 2)), np.zeros((3, 2)))
