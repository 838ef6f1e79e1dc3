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


def naive_residuals(problem, poses, points, camera=scenes.CAMERA):
    """Whitened residuals of every observation, 0 for a right column that is not there."""
    k, j = problem.camera_index, problem.point_index
    local = np.einsum("nij,nj->ni", poses[k, :3, :3], points[j]) + poses[k, :3, 3]
    pixels = camera.project(local)
    column = np.where(np.isnan(problem.right), 0.0, pixels[:, 0] - camera.bf / local[:, 2] - problem.right)
    return np.column_stack([pixels - problem.pixels, column]) / problem.sigmas[:, None]


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
    with pytest.raises(DataError, match="right has numbers that are not finite"):
        dataclasses.replace(problem, right=np.where(np.arange(30) == 2, np.inf, problem.right))
    with pytest.raises(DataError, match="sigmas must be positive"):
        dataclasses.replace(problem, sigmas=np.where(np.arange(30) == 2, np.nan, problem.sigmas))


def test_noise_gives_chi2_as_expected_and_the_same_from_anywhere():
    scene = half_mono(scenes.scene(8, 150, noise=1.0, seen_by=6))
    near, far = (disturbed(scene, 1, seed=seed, distance=distance) for seed, distance in ((1, 0.01), (2, 0.04)))
    found = [adjust_bundle(p, iterations=40, robust=False, tolerance=1e-12) for p in (near, far)]
    residuals = 2 * len(near) + np.count_nonzero(~np.isnan(near.right))
    freedom = residuals - 6 * 7 - 3 * 150
    assert abs(2 * found[0].cost - freedom) < 4 * np.sqrt(2 * freedom)
    np.testing.assert_allclose(found[1].T_camera_map, found[0].T_camera_map, atol=1e-5)


def test_outliers_are_taken_out_between_the_rounds():
    scene = scenes.scene(8, 150, noise=0.5, seen_by=6)
    rng = np.random.default_rng(8)
    wrong = rng.choice(len(scene.pixels), 60, replace=False)
    scene.pixels[wrong] += rng.uniform(15, 60, (60, 2)) * rng.choice([-1, 1], (60, 2)) * scene.sigmas[wrong, None]
    found = adjust_in_rounds(disturbed(scene, 1))
    assert not found.inliers[wrong].any()
    assert np.delete(found.inliers, wrong).mean() > 0.99
    clean = np.delete(np.arange(len(scene.pixels)), wrong)
    alone = dataclasses.replace(
        scene,
        **{name: getattr(scene, name)[clean] for name in ("camera_index", "point_index", "pixels", "right", "sigmas")},
    )
    np.testing.assert_allclose(found.T_camera_map, adjust_in_rounds(disturbed(alone, 1)).T_camera_map, atol=1e-3)


def test_one_fixed_camera_leaves_the_scale_of_a_monocular_world_alone():
    scene = scenes.scene(6, 80, stereo=False)
    found = adjust_bundle(disturbed(scene, 1), iterations=30)
    assert found.cost < 1e-9
    centres = [-T[:3, :3].T @ T[:3, 3] for T in (*scene.poses[[0, 5]], *found.T_camera_map[[0, 5]])]
    scale = np.linalg.norm(centres[3] - centres[2]) / np.linalg.norm(centres[1] - centres[0])
    assert 0.9 < scale < 1.1
    back = (found.points - centres[2]) / scale + centres[0]
    np.testing.assert_allclose(back, scene.points, atol=1e-4)


def test_what_too_little_holds_survives():
    scene = scenes.scene(6, 40, stereo=False, noise=0.5)
    keep = (scene.point_index != 7) | (scene.camera_index == 2)  # point 7 is seen once
    keep &= scene.point_index != 8  # point 8 never
    keep &= (scene.camera_index != 5) | (scene.point_index < 2)  # camera 5 sees two points
    keep &= scene.camera_index != 4  # camera 4 nothing
    scene = dataclasses.replace(
        scene,
        **{name: getattr(scene, name)[keep] for name in ("camera_index", "point_index", "pixels", "right", "sigmas")},
    )
    problem = disturbed(scene, 2)
    found = adjust_bundle(problem, iterations=30)
    assert np.isfinite(found.T_camera_map).all()
    assert np.isfinite(found.points).all()
    np.testing.assert_array_equal(found.points[8], problem.points[8])
    np.testing.assert_allclose(found.T_camera_map[4], problem.T_camera_map[4], atol=1e-12)
    assert np.linalg.norm(found.points[7] - problem.points[7]) < 0.2
    assert found.inliers.mean() > 0.9


def test_a_point_behind_a_camera_does_not_hold_up_the_rest():
    scene = scenes.scene(6, 60)
    problem = disturbed(scene, 1)
    problem.points[3] = [0.0, 0.0, -30.0]
    found = adjust_bundle(problem, iterations=30)
    others = np.arange(60) != 3
    np.testing.assert_allclose(found.points[others], scene.points[others], atol=1e-6)
    assert not found.positive_depth[scene.point_index == 3].any()
    assert np.isinf(found.chi2[scene.point_index == 3]).all()


def test_fixed_points_and_fixed_cameras_stay():
    scene = scenes.scene(5, 40, noise=0.5)
    problem = disturbed(scene, 2)
    held = np.arange(40) % 3 == 0
    found = adjust_bundle(problem, fixed_points=held)
    np.testing.assert_array_equal(found.points[held], problem.points[held])
    np.testing.assert_array_equal(found.T_camera_map[:2], problem.T_camera_map[:2])
    assert np.abs(found.points[~held] - problem.points[~held]).min(axis=1).max() > 1e-4
    all_fixed = dataclasses.replace(problem, fixed=np.ones(5, bool))
    structure = adjust_bundle(all_fixed)
    np.testing.assert_array_equal(structure.T_camera_map, problem.T_camera_map)
    assert structure.cost < structure.cost_before
    with pytest.raises(DataError, match="fixed_points"):
        adjust_bundle(problem, fixed_points=held[:5])


def test_no_observation_changes_nothing():
    problem = disturbed(scenes.scene(3, 10), 1)
    none = np.zeros(0, np.int64)
    empty = dataclasses.replace(
        problem, camera_index=none, point_index=none, pixels=np.zeros((0, 2)), right=np.zeros(0), sigmas=np.zeros(0)
    )
    found = adjust_bundle(empty)
    np.testing.assert_array_equal(found.points, problem.points)
    np.testing.assert_array_equal(found.T_camera_map, problem.T_camera_map)


def test_moving_the_map_moves_the_answer():
    problem = disturbed(half_mono(scenes.scene(5, 50, noise=1.0)), 1)
    G = scenes.far_pose(4)
    other = dataclasses.replace(
        problem, T_camera_map=problem.T_camera_map @ np.linalg.inv(G), points=scenes.moved(G, problem.points)
    )
    plain, turned = (adjust_bundle(p, iterations=30, tolerance=1e-12) for p in (problem, other))
    np.testing.assert_allclose(turned.T_camera_map @ G, plain.T_camera_map, atol=1e-6)


def test_the_order_of_observations_and_double_ones_do_not_matter():
    problem = disturbed(half_mono(scenes.scene(5, 50, noise=1.0)), 1)
    shuffled = np.random.default_rng(1).permutation(np.tile(np.arange(len(problem)), 2))
    names = ("camera_index", "point_index", "pixels", "right", "sigmas")
    double = dataclasses.replace(problem, **{name: getattr(problem, name)[shuffled] for name in names})
    plain, other = (adjust_bundle(p, iterations=30, tolerance=1e-12) for p in (problem, double))
    assert other.cost == pytest.approx(2 * plain.cost, rel=1e-9)
    np.testing.assert_allclose(other.T_camera_map, plain.T_camera_map, atol=1e-6)
    np.testing.assert_allclose(other.chi2, plain.chi2[shuffled], atol=1e-3)
