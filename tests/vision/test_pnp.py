# SPDX-License-Identifier: MIT
"""Pose from points without a guess: all solutions of three points, outliers, degenerate input, the same bytes twice."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se3
from slamcli.vision import _pnp_kernels as kernels
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.pnp import estimate_pose_pnp
from slamcli.vision.sampling import draw_samples

pytestmark = pytest.mark.kernels

CAMERA = Pinhole(fx=520.0, fy=515.0, cx=318.0, cy=243.0, width=640, height=480, baseline_m=0.08)


def random_pose(rng):
    return se3.from_rotation_translation(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3) * 3)


def scene(rng, count):
    """A pose and points of the map that it sees."""
    T = random_pose(rng)
    points_camera = CAMERA.back_project(rng.uniform(0, [640, 480], (count, 2)), rng.uniform(1, 8, count))
    inverse = se3.inverse(T)
    return T, points_camera @ inverse[:3, :3].T + inverse[:3, 3], points_camera


def grunert(rays, points):
    """Distances along three rays by Grunert's quartic (Haralick et al., IJCV 13(3), 1994): the twin of the kernel."""
    a, b, c = (np.linalg.norm(points[i] - points[j]) for i, j in ((1, 2), (0, 2), (0, 1)))
    ca, cb, cc = rays[1] @ rays[2], rays[0] @ rays[2], rays[0] @ rays[1]
    p, q, r = (a * a - c * c) / b**2, (a * a + c * c) / b**2, (b * b - c * c) / b**2
    s = (b * b - a * a) / b**2
    quartic = [
        (p - 1) ** 2 - 4 * c * c / b**2 * ca**2,
        4 * (p * (1 - p) * cb - (1 - q) * ca * cc + 2 * c * c / b**2 * ca**2 * cb),
        2 * (p**2 - 1 + 2 * p**2 * cb**2 + 2 * r * ca**2 - 4 * q * ca * cb * cc + 2 * s * cc**2),
        4 * (-p * (1 + p) * cb + 2 * a * a / b**2 * cc**2 * cb - (1 - q) * ca * cc),
        (1 + p) ** 2 - 4 * a * a / b**2 * cc**2,
    ]
    found = []
    for v in np.roots(quartic):
        if abs(v.imag) > 1e-6 or v.real <= 0:
            continue
        v = v.real
        u = ((-1 + p) * v**2 - 2 * p * cb * v + 1 + p) / (2 * (cc - v * ca))
        if u > 0:
            s1 = np.sqrt(b * b / (1 + v * v - 2 * v * cb))
            found.append(s1 * np.array([1, u, v]))
    return found


@pytest.mark.parametrize("seed", range(40))
def test_three_points_give_all_solutions(seed):
    rng = np.random.default_rng(seed)
    T, points, points_camera = scene(rng, 3)
    distances = np.linalg.norm(points_camera, axis=1)
    rays = points_camera / distances[:, None]
    poses = np.empty((4, 3, 4))
    count = kernels.p3p(rays, points, poses)
    found = [np.linalg.norm(points @ pose[:, :3].T + pose[:, 3], axis=1) for pose in poses[:count]]
    assert min(np.abs(pose - T[:3]).max() for pose in poses[:count]) < 1e-7
    wanted = grunert(rays, points)
    assert count >= len(wanted) - 1  # a double root may be lost to rounding in either
    for pose in poses[:count]:
        moved = points @ pose[:, :3].T + pose[:, 3]
        assert np.allclose(np.cross(moved, rays), 0, atol=1e-6)
        assert np.allclose(pose[:, :3] @ pose[:, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:, :3]) > 0
    for one in found:
        assert min(np.abs(one - other).max() for other in wanted) < 1e-5


def test_three_points_on_a_line_have_no_pose():
    points = np.array([[0.0, 0, 4], [1, 0, 4], [2, 0, 4]])
    rays = points / np.linalg.norm(points, axis=1)[:, None]
    assert kernels.p3p(rays, points, np.empty((4, 3, 4))) == 0


@pytest.mark.parametrize("outliers", [0.0, 0.3, 0.5, 0.7])
def test_pose_among_outliers(outliers):
    rng = np.random.default_rng(7)
    for seed in range(5):
        T, points, points_camera = scene(rng, 300)
        sigmas = 1.2 ** rng.integers(0, 8, 300)
        pixels = CAMERA.project(points_camera) + 0.5 * rng.normal(size=(300, 2)) * sigmas[:, None]
        wrong = rng.random(300) < outliers
        pixels[wrong] = rng.uniform(0, [640, 480], (wrong.sum(), 2))
        got = estimate_pose_pnp(points, pixels, sigmas, CAMERA, seed=seed)
        difference = got.T_camera_map @ se3.inverse(T)
        assert np.linalg.norm(difference[:3, 3]) < 0.02
        assert np.linalg.norm(Rotation.from_matrix(difference[:3, :3]).as_rotvec()) < 0.004
        assert got.inliers[~wrong].mean() > 0.99
        assert got.inliers[wrong].mean() < 0.05 if wrong.any() else True
        assert got.num_iterations < {0.0: 10, 0.3: 40, 0.5: 120, 0.7: 301}[outliers]


def test_depth_helps():
    rng, mono, stereo = np.random.default_rng(3), [], []
    for seed in range(10):
        T, points, points_camera = scene(rng, 15)
        pixels = CAMERA.project(points_camera) + rng.normal(size=(15, 2))
        right = CAMERA.project(points_camera)[:, 0] - CAMERA.bf / points_camera[:, 2] + 0.05 * rng.normal(size=15)
        for errors, column in ((mono, None), (stereo, right)):
            got = estimate_pose_pnp(points, pixels, np.ones(15), CAMERA, seed=seed, right=column)
            errors.append(np.linalg.norm((got.T_camera_map @ se3.inverse(T))[:3, 3]))
    assert np.mean(stereo) < np.mean(mono)


def test_the_same_seed_gives_the_same_bytes():
    T, points, points_camera = scene(np.random.default_rng(1), 60)
    pixels = CAMERA.project(points_camera) + np.random.default_rng(2).normal(size=(60, 2))
    first, second = (estimate_pose_pnp(points, pixels, np.ones(60), CAMERA, seed=5) for _ in range(2))
    assert first.T_camera_map.tobytes() == second.T_camera_map.tobytes()
    assert np.linalg.norm((first.T_camera_map @ se3.inverse(T))[:3, 3]) < 0.05


def test_what_has_no_pose_is_said():
    rng = np.random.default_rng(0)
    with pytest.raises(EstimationError, match="5 matches, fewer than 10"):
        estimate_pose_pnp(rng.normal(size=(5, 3)), rng.normal(size=(5, 2)), np.ones(5), CAMERA, seed=0)
    points = rng.uniform([-3, -3, 2], [3, 3, 9], (80, 3))
    with pytest.raises(EstimationError, match="inliers of 80 matches"):
        estimate_pose_pnp(points, rng.uniform(0, [640, 480], (80, 2)), np.ones(80), CAMERA, seed=0, min_inliers=15)
    line = np.column_stack([np.linspace(0, 1, 30), np.zeros(30), np.full(30, 3.0)])
    with pytest.raises(EstimationError):
        estimate_pose_pnp(line, CAMERA.project(line), np.ones(30), CAMERA, seed=0)
    with pytest.raises(DataError, match="do not fit"):
        estimate_pose_pnp(line, CAMERA.project(line)[:5], np.ones(30), CAMERA, seed=0)


def test_samples_are_different_and_evenly_spread():
    samples = draw_samples(9, 4, 9000, 3)
    assert all(len(set(row)) == 4 for row in samples.tolist())
    shares = np.array([np.bincount(column, minlength=9) for column in samples.T]) / 9000
    assert np.abs(shares - 1 / 9).max() < 0.015
    assert draw_samples(3, 3, 5, 0).min() == 0
