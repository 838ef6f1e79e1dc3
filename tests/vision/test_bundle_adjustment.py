# SPDX-License-Identifier: MIT
"""Bundle adjustment: exact answers, a naive twin, noise, outliers, gauges, what is held badly, threads, bad input."""

from __future__ import annotations

import dataclasses

import camera_scenes as scenes
import numpy as np
import pytest
from scipy.optimize import least_squares

from slamcli.errors import DataError
from slamcli.vision.bundle_adjustment import adjust_bundle, adjust_in_rounds
from slamcli.vision.bundle_problem import BundleProblem

pytestmark = pytest.mark.kernels


def disturbed(scene, fixed, *, seed=3, angle=0.01, distance=0.02):
    """The scene as a problem whose first cameras stand right and fixed; all else is disturbed."""
    rng = np.random.default_rng(seed)
    poses = scene.poses.copy()
    for i in range(fixed, len(poses)):
        poses[i] = scenes.pose(rng.normal(size=3) * angle, rng.normal(size=3) * distance) @ poses[i]
    return BundleProblem(
        T_camera_map=poses, fixed=np.arange(len(poses)) < fixed,
        points=scene.points + distance * rng.normal(size=scene.points.shape), camera_index=scene.camera_index,
        point_index=scene.point_index, pixels=scene.pixels, right=scene.right, sigmas=scene.sigmas, camera=scenes.CAMERA,
    )  # fmt: skip


def half_mono(scene):
    """The same scene with every third observation by the left camera alone."""
    right = scene.right.copy()
    right[::3] = np.nan
    return dataclasses.replace(scene, right=right)


def naive_residuals(problem, poses, points):
    """Whitened residuals of every observation, 0 for a right column that is not there."""
    rows = []
    for n, (k, j) in enumerate(zip(problem.camera_index, problem.point_index, strict=True)):
        pixel, column = scenes.seen(poses[k], points[j][None])
        e = np.append(pixel[0] - problem.pixels[n], column[0] - problem.right[n])
        rows.append(np.nan_to_num(e) / problem.sigmas[n])
    return np.array(rows)


def naive_minimum(problem):
    """Poses and points by scipy with numeric derivatives, squared loss."""
    free = np.flatnonzero(~problem.fixed)

    def unpacked(x):
        poses = problem.T_camera_map.copy()
        for step, k in zip(x[: 6 * len(free)].reshape(-1, 6), free, strict=True):
            poses[k] = scenes.pose(step[:3], step[3:]) @ poses[k]
        return poses, problem.points + x[6 * len(free) :].reshape(-1, 3)

    size = 6 * len(free) + 3 * len(problem.points)
    found = least_squares(
        lambda x: naive_residuals(problem, *unpacked(x)).ravel(), np.zeros(size), xtol=1e-12, ftol=1e-12
    )
    return *unpacked(found.x), found.cost


@pytest.mark.parametrize(("fixed", "stereo"), [(1, True), (2, False)])
def test_exact_data_gives_the_exact_answer(fixed, stereo):
    scene = scenes.scene(6, 60, seen_by=4, stereo=stereo)
    found = adjust_bundle(disturbed(scene, fixed), iterations=25)
    np.testing.assert_allclose(found.T_camera_map, scene.poses, atol=1e-8)
    np.testing.assert_allclose(found.points, scene.points, atol=1e-8)
    assert found.inliers.all()
    assert found.cost < 1e-12


def test_the_minimum_is_that_of_a_naive_twin():
    scene = half_mono(scenes.scene(4, 15, noise=1.0))
    problem = disturbed(scene, 1)
    poses, points, cost = naive_minimum(problem)
    found = adjust_bundle(problem, iterations=40, robust=False, tolerance=1e-12)
    assert found.cost == pytest.approx(cost, rel=1e-7)
    np.testing.assert_allclose(found.T_camera_map, poses, atol=1e-4)
    np.testing.assert_allclose(found.points, points, atol=1e-4)
    np.testing.assert_allclose(found.chi2, np.sum(naive_residuals(problem, poses, points) ** 2, axis=1), atol=1e-2)


def test_threads_do_not_change_a_byte():
    problem = disturbed(half_mono(scenes.scene(7, 90, noise=1.0, seen_by=4)), 1)
    one, two = (adjust_in_rounds(problem, threads=n) for n in (1, 2))
    assert one.T_camera_map.tobytes() == two.T_camera_map.tobytes()
    assert one.points.tobytes() == two.points.tobytes()


def test_wrong_indices_and_shapes_are_named():
    problem = disturbed(scenes.scene(3, 10), 1)
    wrong = problem.camera_index.copy()
    wrong[4] = 3
    with pytest.raises(DataError, match=r"camera_index\[4\] is 3, but there are 3"):
        dataclasses.replace(problem, camera_index=wrong)
    with pytest.raises(DataError, match="pixels is"):
        dataclasses.replace(problem, pixels=problem.pixels[:3])
