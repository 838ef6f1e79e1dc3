# SPDX-License-Identifier: MIT
"""Planar poses, quaternions and rigid transforms: group laws, round trips, and equality with scipy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.geometry import quaternion, se2, se3

RNG = np.random.default_rng(21)
POSES = RNG.uniform(-4, 4, (3, 50, 3))
QUATS = quaternion.normalise(RNG.normal(size=(2, 60, 4)))


def test_wrapped_angles_are_in_the_half_open_circle():
    angles = np.concatenate([RNG.uniform(-50, 50, 200), np.arange(-4, 5) * np.pi])
    wrapped = se2.wrap_angle(angles)
    assert (wrapped > -np.pi).all()
    assert (wrapped <= np.pi).all()
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-12)


def assert_same(a, b):
    np.testing.assert_allclose(a[..., :2], b[..., :2], atol=1e-12)
    np.testing.assert_allclose(se2.wrap_angle(a[..., 2] - b[..., 2]), 0.0, atol=1e-12)


def test_planar_group_laws():
    a, b, c = POSES
    assert_same(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))
    assert_same(se2.compose(a, se2.inverse(a)), np.zeros_like(a))
    assert_same(se2.compose(a, se2.between(a, b)), np.column_stack([b[:, :2], se2.wrap_angle(b[:, 2])]))
    points = RNG.normal(size=(5, 2))
    both = se2.transform_points(se2.compose(a[0], b[0]), points)
    np.testing.assert_allclose(both, se2.transform_points(a[0], se2.transform_points(b[0], points)), atol=1e-12)


def test_planar_poses_and_transforms_agree():
    a, b, _ = POSES
    np.testing.assert_allclose(se3.from_se2(se2.compose(a, b)), se3.from_se2(a) @ se3.from_se2(b), atol=1e-12)
    np.testing.assert_allclose(se3.inverse(se3.from_se2(a)), se3.from_se2(se2.inverse(a)), atol=1e-12)
    assert_same(se3.to_se2(se3.from_se2(a)), a)


def test_quaternions_equal_scipys():
    a, b = (Rotation.from_quat(q) for q in QUATS)
    vectors = RNG.normal(size=(60, 3))
    np.testing.assert_allclose(quaternion.to_matrix(QUATS[0]), a.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(quaternion.rotate(QUATS[0], vectors), a.apply(vectors), atol=1e-12)
    product = quaternion.to_matrix(quaternion.multiply(*QUATS))
    np.testing.assert_allclose(product, (a * b).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(quaternion.to_matrix(quaternion.conjugate(QUATS[0])), a.inv().as_matrix(), atol=1e-12)
    angles = RNG.uniform(-1.5, 1.5, (60, 3))
    rpy = quaternion.from_roll_pitch_yaw(*angles.T)
    np.testing.assert_allclose(quaternion.to_matrix(rpy), Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(quaternion.to_roll_pitch_yaw(rpy), angles, atol=1e-9)
    np.testing.assert_allclose(quaternion.yaw(rpy), angles[:, 2], atol=1e-9)
    np.testing.assert_allclose(quaternion.from_yaw(0.7), quaternion.from_roll_pitch_yaw(0.0, 0.0, 0.7), atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi - 1e-9, np.pi])
def test_quaternions_of_matrices_at_every_angle(angle):
    axes = np.vstack([np.eye(3), -np.eye(3), RNG.normal(size=(10, 3))])
    matrices = Rotation.from_rotvec(angle * axes / np.linalg.norm(axes, axis=1)[:, None]).as_matrix()
    quats = quaternion.from_matrix(matrices)
    assert (quats[:, 3] >= 0).all()
    np.testing.assert_allclose(quaternion.to_matrix(quats), matrices, atol=1e-9)


def test_slerp_goes_the_shorter_way_at_constant_speed():
    a, b = QUATS
    for fraction in (0.0, 0.25, 0.5, 1.0):
        between = quaternion.slerp(a, b, np.full(60, fraction))
        whole = (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude()
        part = (Rotation.from_quat(a).inv() * Rotation.from_quat(between)).magnitude()
        np.testing.assert_allclose(part, fraction * whole, atol=1e-7)
    np.testing.assert_allclose(quaternion.slerp(a[0], a[0], 0.3), a[0], atol=1e-12)
    np.testing.assert_allclose(np.abs((quaternion.slerp(a[0], -a[0], 0.3) * a[0]).sum()), 1.0, atol=1e-12)


def test_an_unset_quaternion_is_no_rotation():
    assert quaternion.normalise(np.zeros(4)).tolist() == [0.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(quaternion.normalise([0.0, 0.0, 0.0, 5.0]), [0.0, 0.0, 0.0, 1.0])


def test_transforms_round_trip():
    T = se3.from_position_quaternion(RNG.normal(size=(60, 3)), QUATS[0])
    np.testing.assert_allclose(T @ se3.inverse(T), np.broadcast_to(np.eye(4), T.shape), atol=1e-12)
    position, quats = se3.to_position_quaternion(T)
    np.testing.assert_allclose(se3.from_position_quaternion(position, quats), T, atol=1e-12)
    np.testing.assert_allclose(se3.from_rotation_translation(T[:, :3, :3], T[:, :3, 3]), T)


def test_steps_lead_back_to_the_poses_they_were_taken_from():
    poses = np.array([[1.0, -2.0, 3.0], [1.5, -2.0, -3.1], [0.5, 0.25, 0.1], [0.5, 0.25, 2.0]])
    steps = se2.between(poses[:-1], poses[1:])
    np.testing.assert_allclose(se2.integrate(poses[0], steps), poses, atol=1e-12)
    np.testing.assert_array_equal(se2.integrate(poses[0], np.zeros((0, 3))), poses[:1])


def test_single_planar_poses_are_those_of_arrays_to_the_bit():
    rng = np.random.default_rng(3)
    first, second = rng.normal(0, 10, (2, 4000, 3))
    special = np.array([0.0, -0.0, np.pi, -np.pi, 3 * np.pi, 1e6, -1e-300])
    first[:700, 2], second[:700, 2] = rng.choice(special, 700), rng.choice(special, 700)
    for one, many in (
        ([se2.compose(a, b) for a, b in zip(first, second, strict=True)], se2.compose(first, second)),
        ([se2.inverse(a) for a in first], se2.inverse(first)),
    ):
        assert np.array_equal(np.array(one).view(np.int64), many.view(np.int64))
