# SPDX-License-Identifier: MIT
"""Pose of one camera from points: exact answers, noise, outliers, information, equivariance, degenerate input."""

from __future__ import annotations

import camera_scenes as scenes
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError
from slamcli.vision.pose_optimisation import optimise_pose

pytestmark = pytest.mark.kernels
CAMERA = scenes.CAMERA


def world(count=150, *, seed=1, noise=0.0, kind="mixed"):
    """True pose, points, pixels, right, sigmas."""
    rng = np.random.default_rng(seed)
    T = scenes.far_pose(seed)
    points = scenes.visible_points(T, count, rng)
    pixels, right = scenes.seen(T, points)
    sigmas = 1.2 ** rng.integers(0, 8, count).astype(float)
    pixels += noise * sigmas[:, None] * rng.normal(size=pixels.shape)
    right += noise * sigmas * rng.normal(size=count)
    if kind == "mono":
        right[:] = np.nan
    elif kind == "mixed":
        right[::2] = np.nan
    return T, points, pixels, right, sigmas


def away(T, angle=0.08, distance=0.15):
    return scenes.pose([angle, -angle / 2, angle / 3], [distance, -distance / 2, distance]) @ T


def difference(A, B):
    """Rotation (rad) and translation between two poses."""
    D = A @ np.linalg.inv(B)
    return np.linalg.norm(Rotation.from_matrix(D[:3, :3]).as_rotvec()), np.linalg.norm(D[:3, 3])


@pytest.mark.parametrize("kind", ["mono", "stereo", "mixed"])
def test_exact_data_gives_the_exact_pose(kind):
    T, *seen = world(kind=kind)
    found = optimise_pose(away(T), *seen, CAMERA)
    np.testing.assert_allclose(found.T_camera_map, T, atol=1e-9)
    assert found.num_inliers == 150
    assert found.chi2.max() < 1e-12


def test_the_minimum_is_that_of_a_naive_twin():
    T, points, pixels, right, sigmas = world(noise=0.5, seed=4)

    def residuals(step):
        pixel, column = scenes.seen(scenes.pose(step[:3], step[3:]) @ T, points)
        rows = np.column_stack([pixel - pixels, np.where(np.isnan(right), 0.0, column - right)])
        return (rows / sigmas[:, None]).ravel()

    naive = least_squares(residuals, np.zeros(6), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = optimise_pose(away(T), points, pixels, right, sigmas, CAMERA)
    assert found.inliers.all()
    np.testing.assert_allclose(found.T_camera_map, scenes.pose(naive.x[:3], naive.x[3:]) @ T, atol=1e-6)
    assert found.chi2.sum() == pytest.approx(2 * naive.cost, rel=1e-9)


def test_noise_gives_chi2_and_spread_as_expected():
    spread, chi2 = [], []
    for seed in range(20):
        T, *seen = world(seed=seed, noise=1.0, kind="stereo")
        found = optimise_pose(away(T), *seen, CAMERA)
        D = found.T_camera_map @ np.linalg.inv(T)
        step = np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])
        spread.append(step @ found.information @ step)
        chi2.append(found.chi2.mean())
    assert 2.85 < np.mean(chi2) < 3.1  # 3 residuals of variance 1, six unknowns
    assert 4.0 < np.mean(spread) < 9.5  # chi2 with 6 degrees of freedom, inliers cut at 95 %


def test_outliers_are_found_and_do_not_move_the_pose():
    T, points, pixels, right, sigmas = world(noise=0.5)
    rng = np.random.default_rng(5)
    wrong = rng.choice(150, 45, replace=False)
    pixels[wrong] += rng.uniform(25, 90, (45, 2)) * rng.choice([-1, 1], (45, 2)) * sigmas[wrong, None]
    found = optimise_pose(away(T, 0.03, 0.05), points, pixels, right, sigmas, CAMERA)
    good = np.delete(np.arange(150), wrong)
    alone = optimise_pose(T, points[good], pixels[good], right[good], sigmas[good], CAMERA)
    assert not found.inliers[wrong].any()
    assert found.inliers[good].mean() > 0.97
    assert max(difference(found.T_camera_map, alone.T_camera_map)) < 1e-5


def test_points_behind_the_camera_are_outliers():
    T, points, pixels, _, sigmas = world()
    behind = np.linalg.inv(T) @ np.diag([-1.0, -1, -1, 1]) @ T
    points[:10] = scenes.moved(behind, points[:10])  # mirrored at the centre: the same pixels
    found = optimise_pose(T, points, pixels, np.full(150, np.nan), sigmas, CAMERA)
    assert not found.inliers[:10].any()
    assert found.inliers[10:].all()
    assert np.isinf(found.chi2[:10]).all()
    np.testing.assert_allclose(found.T_camera_map, T, atol=1e-9)


def test_the_information_is_that_of_differences_of_the_residuals():
    T, points, pixels, right, sigmas = world(kind="mixed")

    def residuals(step):
        pixel, column = scenes.seen(scenes.pose(step[:3], step[3:]) @ T, points)
        rows = np.column_stack([pixel - pixels, np.where(np.isnan(right), 0.0, column - right)])
        return (rows / sigmas[:, None]).ravel()

    steps = 1e-6 * np.eye(6)
    jacobian = np.array([(residuals(s) - residuals(-s)) / 2e-6 for s in steps]).T
    found = optimise_pose(T, points, pixels, right, sigmas, CAMERA)
    np.testing.assert_allclose(found.information, jacobian.T @ jacobian, rtol=1e-6, atol=1e-3)


def test_moving_the_map_moves_the_pose():
    T, points, *seen = world(noise=1.0)
    G = scenes.far_pose(9)
    plain = optimise_pose(away(T), points, *seen, CAMERA)
    other = optimise_pose(away(T) @ np.linalg.inv(G), scenes.moved(G, points), *seen, CAMERA)
    np.testing.assert_allclose(other.T_camera_map @ G, plain.T_camera_map, atol=1e-7)
    np.testing.assert_array_equal(other.inliers, plain.inliers)


def test_too_few_points_and_degenerate_points_leave_a_finite_pose():
    T, points, pixels, right, sigmas = world()
    few = optimise_pose(T, points[:2], pixels[:2], right[:2], sigmas[:2], CAMERA)
    np.testing.assert_array_equal(few.T_camera_map, T)
    assert few.num_inliers == 0
    none = optimise_pose(T, points[:0], pixels[:0], right[:0], sigmas[:0], CAMERA)
    assert none.inliers.shape == (0,)
    same = optimise_pose(T, *(np.repeat(a[:1], 20, axis=0) for a in (points, pixels, right, sigmas)), CAMERA)
    np.testing.assert_allclose(same.T_camera_map, T, atol=1e-9)
    assert np.isfinite(same.information).all()


def test_all_points_behind_leave_the_pose():
    T, points, pixels, right, sigmas = world()
    turned = np.diag([-1.0, 1, -1, 1]) @ T
    found = optimise_pose(turned, points, pixels, right, sigmas, CAMERA)
    assert found.num_inliers == 0
    assert np.isfinite(found.T_camera_map).all()


def test_arrays_of_different_lengths_are_refused():
    T, points, pixels, right, sigmas = world()
    with pytest.raises(DataError, match=r"pixels \(N, 2\)"):
        optimise_pose(T, points, pixels[:5], right, sigmas, CAMERA)
