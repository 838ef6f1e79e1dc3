# SPDX-License-Identifier: MIT
"""Similarities of two sets of points among wrong matches, with and without scale; Horn's closed form equals Umeyama's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError, EstimationError
from slamcli.geometry.alignment import Similarity, umeyama
from slamcli.vision import _similarity_kernels as kernels
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.similarity_ransac import SidedPoints, estimate_similarity

pytestmark = pytest.mark.kernels

CAMERA = Pinhole(fx=520.0, fy=515.0, cx=318.0, cy=243.0, width=640, height=480)
S_1_2 = Similarity(Rotation.from_rotvec([0.05, -0.2, 0.1]).as_matrix(), np.array([0.4, -0.1, 0.2]), 1.7)


def sides(scale, count=120, wrong=0.4, seed=0, noise=0.5):
    """Points of two maps as two cameras see them, and which matches are wrong."""
    rng = np.random.default_rng(seed)
    first = CAMERA.back_project(rng.uniform(0, [640, 480], (count, 2)), rng.uniform(2, 6, count))
    second = (first - S_1_2.translation_m) @ S_1_2.rotation / scale
    swapped = rng.random(count) < wrong
    second[swapped] = second[rng.permutation(np.flatnonzero(swapped))]
    out = []
    for points in (first, second):
        sigmas = 1.2 ** rng.integers(0, 4, count)
        pixels = CAMERA.project(points) + noise * sigmas[:, None] * rng.normal(size=(count, 2))
        shaken = points * (1 + 0.004 * rng.normal(size=(count, 1)))
        out.append(SidedPoints(points_camera=shaken, pixels=pixels, sigmas=sigmas))
    return *out, swapped


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("fix_scale", [False, True])
def test_similarity_among_wrong_matches(fix_scale, seed):
    scale = 1.0 if fix_scale else S_1_2.scale
    first, second, wrong = sides(scale, seed=seed)
    got = estimate_similarity(first, second, CAMERA, fix_scale=fix_scale, seed=seed)
    assert got.S_1_2.scale == 1.0 if fix_scale else got.S_1_2.scale == pytest.approx(1.7, rel=0.01)
    turn = Rotation.from_matrix(got.S_1_2.rotation @ S_1_2.rotation.T).magnitude()
    assert np.degrees(turn) < 0.5
    assert np.linalg.norm(got.S_1_2.translation_m - S_1_2.translation_m) < 0.05
    assert got.inliers[~wrong].mean() > 0.85
    assert got.inliers[wrong].mean() < 0.1
    assert got.num_iterations < 150


def test_a_wrong_scale_is_no_inlier_where_the_scale_is_fixed():
    first, second, _ = sides(1.7, wrong=0.0)
    with pytest.raises(EstimationError, match="inliers of 120 matches, fewer than 60"):
        estimate_similarity(first, second, CAMERA, fix_scale=True, seed=0, min_inliers=60)


@pytest.mark.parametrize("fix_scale", [False, True])
@pytest.mark.parametrize("count", [3, 4, 50])
def test_horn_equals_umeyama(count, fix_scale):
    rng = np.random.default_rng(count)
    second = rng.normal(size=(count, 3))
    scale = 1.0 if fix_scale else 0.6
    first = scale * second @ S_1_2.rotation.T + S_1_2.translation_m
    pose = np.zeros((3, 5))
    assert kernels.horn(first, second, fix_scale, pose)
    twin = umeyama(second, first, with_scale=not fix_scale)
    assert np.allclose(pose[:, :3], twin.rotation)
    assert np.allclose(pose[:, 3], twin.translation_m)
    assert pose[0, 4] == pytest.approx(twin.scale)
    assert not kernels.horn(first[:2], second[:2], fix_scale, pose)
    assert not kernels.horn(np.ones((4, 3)), np.ones((4, 3)), fix_scale, pose)


def test_judging_equals_its_twin():
    first, second, _ = sides(1.7, wrong=0.2, noise=1.5)
    pose = np.zeros((3, 5))
    pose[:, :3], pose[:, 3], pose[0, 4] = S_1_2.rotation, S_1_2.translation_m, 1.7
    there = S_1_2.transform_points(second.points_camera)
    back = (first.points_camera - S_1_2.translation_m) @ S_1_2.rotation / 1.7
    chi2 = np.maximum(
        ((CAMERA.project(there) - first.pixels) ** 2).sum(axis=1) / first.sigmas**2,
        ((CAMERA.project(back) - second.pixels) ** 2).sum(axis=1) / second.sigmas**2,
    )
    chi2[(there[:, 2] <= 0) | (back[:, 2] <= 0)] = np.inf
    inliers = np.empty(120, bool)
    total = kernels.judge(
        pose, first.points_camera, second.points_camera, first.pixels, second.pixels, first.sigmas**-2,
        second.sigmas**-2, CAMERA.array, 9.21, inliers,
    )  # fmt: skip
    assert total == pytest.approx(np.minimum(chi2, 9.21).sum())
    assert inliers.tolist() == (chi2 <= 9.21).tolist()
    assert 10 < inliers.sum() < 110


def test_the_same_seed_gives_the_same_bytes():
    first, second, _ = sides(1.7)
    one, two = (estimate_similarity(first, second, CAMERA, fix_scale=False, seed=3) for _ in range(2))
    assert one.S_1_2.matrix.tobytes() == two.S_1_2.matrix.tobytes()


def test_what_has_no_answer_is_said():
    first, second, _ = sides(1.0, wrong=1.0)
    with pytest.raises(EstimationError, match="the best one has"):
        estimate_similarity(first, second, CAMERA, fix_scale=True, seed=0)
    few = sides(1.0, count=9)
    with pytest.raises(EstimationError, match="9 matches, fewer than 15"):
        estimate_similarity(few[0], few[1], CAMERA, fix_scale=True, seed=0)
    with pytest.raises(DataError, match="do not fit"):
        estimate_similarity(first, few[1], CAMERA, fix_scale=True, seed=0)
