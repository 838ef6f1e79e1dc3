# SPDX-License-Identifier: MIT
"""Similarity of two keyframes by reprojection: exact answers, a naive twin, outliers, fixed scale, bad input."""

from __future__ import annotations

import camera_scenes as scenes
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError, EstimationError
from slamcli.geometry.alignment import Similarity
from slamcli.vision.similarity_optimisation import optimise_similarity
from slamcli.vision.similarity_ransac import SidedPoints

pytestmark = pytest.mark.kernels
CAMERA = scenes.CAMERA


def pair(*, scale=1.4, count=80, noise=0.0, seed=0):
    """True S_1_2 and the matches of two cameras that look at the same points, the second in a map of another scale."""
    rng = np.random.default_rng(seed)
    first = CAMERA.back_project(rng.uniform((100, 80), (540, 400), (count, 2)), rng.uniform(2, 5, count))
    T_1_2 = scenes.pose([0.05, -0.1, 0.2], [0.3, -0.1, 0.2])
    S = Similarity(T_1_2[:3, :3], T_1_2[:3, 3], scale)
    second = (first - S.translation_m) @ S.rotation / scale
    sides = []
    for points in (first, second):
        sigmas = 1.2 ** rng.integers(0, 5, count).astype(float)
        pixels = CAMERA.project(points) + noise * sigmas[:, None] * rng.normal(size=(count, 2))
        off = points * (1 + 0.002 * noise * rng.normal(size=(count, 1)))
        sides.append(SidedPoints(points_camera=off, pixels=pixels, sigmas=sigmas))
    return S, *sides


def disturbed(S, step):
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    grown = np.exp(step[6])
    return Similarity(turn @ S.rotation, grown * turn @ S.translation_m + step[3:6], grown * S.scale)


def naive_residuals(S, side_1, side_2):
    """(N, 4): whitened errors in the first and in the second image."""
    forth = S.transform_points(side_2.points_camera)
    back = (side_1.points_camera - S.translation_m) @ S.rotation / S.scale
    e1 = (CAMERA.project(forth) - side_1.pixels) / side_1.sigmas[:, None]
    e2 = (CAMERA.project(back) - side_2.pixels) / side_2.sigmas[:, None]
    return np.column_stack([e1, e2])


AWAY = np.array([0.03, -0.02, 0.02, 0.05, -0.05, 0.08, 0.06])


@pytest.mark.parametrize("fix_scale", [False, True])
def test_exact_matches_give_the_exact_similarity(fix_scale):
    S, *sides = pair(scale=1.0 if fix_scale else 1.4)
    start = disturbed(S, np.where(np.arange(7) == 6, 0.0, AWAY) if fix_scale else AWAY)
    found = optimise_similarity(start, *sides, CAMERA, fix_scale=fix_scale, iterations=10)
    np.testing.assert_allclose(found.S_1_2.matrix, S.matrix, atol=1e-8)
    assert found.num_inliers == 80
    assert bool(found.S_1_2.scale == start.scale) == fix_scale
    assert bool(np.all(found.information[6] == 0)) == fix_scale


def test_the_minimum_and_the_information_are_those_of_a_naive_twin():
    S, *sides = pair(noise=0.5, seed=2)

    def residuals(step):
        return naive_residuals(disturbed(S, step), *sides).ravel()

    naive = least_squares(residuals, np.zeros(7), xtol=1e-14, ftol=1e-14)
    found = optimise_similarity(disturbed(S, AWAY), *sides, CAMERA, fix_scale=False, iterations=20)
    assert found.inliers.all()
    np.testing.assert_allclose(found.S_1_2.matrix, disturbed(S, naive.x).matrix, atol=1e-6)
    assert found.chi2.sum() == pytest.approx(2 * naive.cost, rel=1e-6)
    steps = 1e-6 * np.eye(7)
    ended = found.S_1_2
    jacobian = np.array(
        [
            (naive_residuals(disturbed(ended, s), *sides) - naive_residuals(disturbed(ended, -s), *sides)).ravel()
            / 2e-6
            for s in steps
        ]
    )
    np.testing.assert_allclose(found.information, jacobian @ jacobian.T, rtol=1e-5, atol=1e-2)


def test_outliers_are_taken_out():
    S, side_1, side_2 = pair(noise=0.5, seed=4)
    wrong = np.random.default_rng(1).choice(80, 20, replace=False)
    side_1.pixels[wrong] += 60.0
    side_2.points_camera[wrong[:3]] *= -1.0  # behind the camera
    found = optimise_similarity(disturbed(S, 0.3 * AWAY), side_1, side_2, CAMERA, fix_scale=False)
    assert not found.inliers[wrong].any()
    assert found.num_inliers >= 58
    assert np.isinf(found.chi2[wrong[:3], 0]).all()
    assert abs(found.S_1_2.scale - S.scale) < 0.01


def test_moving_both_frames_moves_the_similarity():
    """Exchanging the sides gives the inverse."""
    S, side_1, side_2 = pair(noise=0.5, seed=5)
    found = optimise_similarity(S, side_1, side_2, CAMERA, fix_scale=False, iterations=20)
    back = Similarity(S.rotation.T, -S.rotation.T @ S.translation_m / S.scale, 1 / S.scale)
    other = optimise_similarity(back, side_2, side_1, CAMERA, fix_scale=False, iterations=20)
    np.testing.assert_allclose(other.S_1_2.matrix @ found.S_1_2.matrix, np.eye(4), atol=1e-5)


def test_too_few_matches_and_wrong_shapes_are_said():
    S, side_1, side_2 = pair()
    far = Similarity(S.rotation, S.translation_m + np.array([5.0, 0, 0]), S.scale)
    with pytest.raises(EstimationError, match="of 80 matches agree with it, fewer than 81"):
        optimise_similarity(far, side_1, side_2, CAMERA, fix_scale=False, min_inliers=81)
    short = SidedPoints(points_camera=side_2.points_camera[:5], pixels=side_2.pixels[:5], sigmas=side_2.sigmas[:5])
    with pytest.raises(DataError, match=r"side_2 has points \(5, 3\)"):
        optimise_similarity(S, side_1, short, CAMERA, fix_scale=False)
