# SPDX-License-Identifier: MIT
"""Alignment with planes finds known motions, equals a naive twin, and falls back to its prior."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from slamcli.geometry import quaternion, se3
from slamcli.grids.surfel_map import SurfelMap
from slamcli.registration.surfel_matching import SurfelMatch, align_with_surfels
from slamcli.registration.voxel_filter import adaptive_voxel_filter, voxel_filter

pytestmark = pytest.mark.kernels


def corner(seed=0, n=2500):
    """Points (3n, 3) on a floor and two walls, seen from the origin."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-6, 6, (2, n))
    c = rng.uniform(-1, 3, n)
    noise = rng.normal(0, 0.01, (3, n))
    return np.concatenate(
        [
            np.column_stack([a, b, -1 + noise[0]]),
            np.column_stack([a, 6 + noise[1], c]),
            np.column_stack([6 + noise[2], b, c]),
        ]
    )


def pose(x, y, z, roll, pitch, yaw):
    return se3.from_position_quaternion([x, y, z], quaternion.from_roll_pitch_yaw(roll, pitch, yaw))


def naive_align(surfels, points, T, prior, sigmas, loose, settings):
    """Gauss-Newton with a lookup in a dict and matrices of numerical derivatives."""
    table = {}
    for row in range(len(surfels)):
        key = int(surfels._held[row])
        if surfels.planes[row, 6] >= 0:
            cell = tuple(((key >> s) & (2**20 - 1)) - 2**19 for s in (42, 22, 2))
            table[key & 3, cell] = surfels.planes[row]

    def expmap(w):
        angle = np.linalg.norm(w)
        K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        if angle < 1e-12:
            return np.eye(3) + K
        return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * K @ K

    R, t = T[:3, :3].copy(), T[:3, 3].copy()
    for _ in range(settings.max_iterations):
        H, g = np.diag(np.repeat(1 / np.square(sigmas), 3)), np.zeros(6)
        for p in points:
            x = R @ p + t
            plane = next(
                (
                    table[level, cell]
                    for level in reversed(range(surfels.levels))
                    if (level, cell := tuple(np.floor(x / (surfels.size_m * 2**level)).astype(int))) in table
                ),
                None,
            )
            if plane is None:
                continue
            n, r = plane[3:6], plane[3:6] @ (x - plane[:3])
            variance = plane[6] + settings.noise_m**2 + loose**2
            weight = (settings.scale**2 / (settings.scale**2 + r * r / variance)) ** 2 / variance
            J = np.concatenate([n, np.cross(p, R.T @ n)])
            H += weight * np.outer(J, J)
            g -= weight * r * J
        D = prior[:3, :3].T @ R
        angle = np.arccos(np.clip((np.trace(D) - 1) / 2, -1, 1))
        axis = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / 2
        turn = axis * (angle / np.sin(angle) if angle > 1e-9 else 1.0)
        g[:3] -= (t - prior[:3, 3]) / sigmas[0] ** 2
        g[3:] -= turn / sigmas[1] ** 2
        step = np.linalg.solve(H, g)
        t, R = t + step[:3], R @ expmap(step[3:])
        small = np.abs(step[:3]).sum() < 1e-4 and np.abs(step[3:]).sum() < 2e-5
        if small and loose < 0.02:
            break
        loose *= 0.25 if small else 0.6
    return se3.from_rotation_translation(R, t)


@pytest.fixture(scope="module")
def surfels():
    made = SurfelMap(0.5, 3)
    made.add(corner())
    return made


def test_alignment_equals_the_naive_twin(surfels):
    points = corner(5, 40)
    start = pose(0.1, -0.05, 0.05, 0.01, 0.02, -0.03)
    settings = SurfelMatch(max_iterations=4)
    found = align_with_surfels(surfels, points, start, start, (0.5, 0.1), 0.3, settings)
    expected = naive_align(surfels, points, start, start, (0.5, 0.1), 0.3, settings)
    np.testing.assert_allclose(found.T_map_cloud, expected, atol=1e-9)


def test_a_known_motion_is_found(surfels):
    true = pose(0.3, -0.2, 0.1, 0.02, -0.03, 0.08)
    seen = corner(3, 700) @ true[:3, :3] - true[:3, 3] @ true[:3, :3]
    found = align_with_surfels(surfels, seen, np.eye(4), np.eye(4), (10.0, 10.0), 0.5, SurfelMatch())
    off = se3.inverse(true) @ found.T_map_cloud
    assert np.linalg.norm(off[:3, 3]) < 0.003
    assert np.abs(off[:3, :3] - np.eye(3)).max() < 0.001
    assert found.agreement > 0.8
    assert found.overlap > 0.8
    assert np.linalg.eigvalsh(found.information).min() > 0


def test_an_open_direction_keeps_the_prior():
    floor = corner(4)[:2500]
    surfels = SurfelMap(0.5, 3)
    surfels.add(floor)
    prior = pose(0.4, 0.3, 0.05, 0.0, 0.0, 0.2)
    found = align_with_surfels(surfels, floor[::5], prior, prior, (0.5, 0.1), 0.3, SurfelMatch())
    np.testing.assert_allclose(found.T_map_cloud[:2, 3], prior[:2, 3], atol=0.2)  # of a deviation of 0.5
    assert abs(found.T_map_cloud[2, 3]) < 0.005, "the floor says the height"


def test_nothing_to_match_with_gives_the_prior_and_no_agreement(surfels):
    for points in (np.zeros((0, 3)), np.full((5, 3), 1e4)):
        found = align_with_surfels(surfels, points, np.eye(4), np.eye(4), (1.0, 1.0), 0.3, SurfelMatch())
        np.testing.assert_allclose(found.T_map_cloud, np.eye(4), atol=1e-12)
        assert found.agreement == found.overlap == 0.0


@pytest.mark.real_data
def test_the_pair_of_small_gicp_is_registered():
    data = (
        Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).resolve().parents[3] / "shared/data")) / "pointclouds"
    )
    if not (data / "small_gicp_target.ply").exists():
        pytest.skip(f"no {data}: set SLAMCLI_TEST_DATA")
    import open3d

    clouds = [
        np.asarray(open3d.io.read_point_cloud(str(data / f"small_gicp_{n}.ply")).points) for n in ("target", "source")
    ]
    target, source = (cloud[voxel_filter(cloud, 0.1)] for cloud in clouds)
    true = np.loadtxt(data / "small_gicp_T_target_source.txt")
    surfels = SurfelMap(0.4, 3)
    surfels.add(target)
    points = source[adaptive_voxel_filter(source, 1.0, 4000, 100.0)]
    found = align_with_surfels(surfels, points, np.eye(4), np.eye(4), (10.0, 10.0), 1.0, SurfelMatch())
    off = se3.inverse(true) @ found.T_map_cloud
    assert np.linalg.norm(off[:3, 3]) < 0.05
    assert np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1))) < 0.5
