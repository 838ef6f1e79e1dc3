# SPDX-License-Identifier: MIT
"""Self-calibration in bundle adjustment: exact answers from focal lengths 8 % off, a naive twin, what is kept, names."""

from __future__ import annotations

import dataclasses

import camera_scenes as scenes
import numpy as np
import pytest
from scipy.optimize import least_squares
from test_bundle_adjustment import disturbed, half_mono, naive_residuals

from slamcli.errors import DataError
from slamcli.vision.bundle_adjustment import adjust_bundle

pytestmark = pytest.mark.kernels
FOUR = ("fx", "fy", "cx", "cy")


def nominal(problem, share=1.08):
    """The problem with focal lengths that are off; baseline times focal length stays."""
    camera = problem.camera
    wrong = dataclasses.replace(
        camera, fx=camera.fx * share, fy=camera.fy * share, cx=camera.cx + 4, cy=camera.cy - 3,
        baseline_m=camera.baseline_m / share,
    )  # fmt: skip
    return dataclasses.replace(problem, camera=wrong)


@pytest.mark.parametrize(("fixed", "stereo"), [(1, True), (2, False)])
def test_a_camera_whose_focal_length_is_eight_percent_off_is_found(fixed, stereo):
    scene = scenes.scene(6, 30, stereo=stereo)
    found = adjust_bundle(nominal(disturbed(scene, fixed)), iterations=60, refine_intrinsics=FOUR, tolerance=1e-14)
    np.testing.assert_allclose(found.camera.array, scenes.CAMERA.array, rtol=1e-6)
    np.testing.assert_allclose(found.T_camera_map, scene.poses, atol=1e-6)
    np.testing.assert_allclose(found.points, scene.points, atol=1e-6)


def test_the_minimum_is_that_of_a_naive_twin():
    scene = half_mono(scenes.scene(4, 9, noise=1.0))
    problem = nominal(disturbed(scene, 2), 1.02)

    def unpacked(x):
        poses = problem.T_camera_map.copy()
        for step, k in zip(x[5:17].reshape(-1, 6), (2, 3), strict=True):
            poses[k] = scenes.pose(step[:3], step[3:]) @ poses[k]
        fx, fy, cx, cy, bf = problem.camera.array + 100 * x[:5]
        camera = dataclasses.replace(problem.camera, fx=fx, fy=fy, cx=cx, cy=cy, baseline_m=bf / fx)
        return camera, poses, problem.points + x[17:].reshape(-1, 3)

    def residuals(x):
        camera, poses, points = unpacked(x)
        return naive_residuals(problem, poses, points, camera).ravel()

    naive = least_squares(residuals, np.zeros(17 + 27), xtol=1e-12, ftol=1e-12)
    camera, poses, _ = unpacked(naive.x)
    found = adjust_bundle(problem, iterations=80, robust=False, tolerance=1e-13, refine_intrinsics=(*FOUR, "bf"))
    assert found.cost == pytest.approx(naive.cost, rel=1e-6)
    np.testing.assert_allclose(found.camera.array, camera.array, rtol=1e-3)
    np.testing.assert_allclose(found.T_camera_map, poses, atol=1e-3)
    covariance = np.linalg.inv(naive.jac.T @ naive.jac)
    np.testing.assert_allclose(found.intrinsics_sigmas, 100 * np.sqrt(np.diag(covariance)[:5]), rtol=1e-2)


def test_what_is_not_asked_for_stays():
    problem = nominal(disturbed(scenes.scene(6, 60, noise=0.5), 1))
    found = adjust_bundle(problem, iterations=20, refine_intrinsics=("fx", "fy"))
    np.testing.assert_array_equal(found.camera.array[2:4], problem.camera.array[2:4])
    assert found.camera.bf == pytest.approx(problem.camera.bf)
    assert found.camera.fx != problem.camera.fx
    assert np.array_equal(np.isfinite(found.intrinsics_sigmas), [True, True, False, False, False])
    assert adjust_bundle(problem, iterations=3).camera is problem.camera


def test_threads_do_not_change_a_byte():
    problem = nominal(disturbed(half_mono(scenes.scene(7, 90, noise=1.0, seen_by=4)), 1))
    one, two = (adjust_bundle(problem, threads=n, refine_intrinsics=FOUR) for n in (1, 2))
    assert one.camera.array.tobytes() == two.camera.array.tobytes()
    assert one.points.tobytes() == two.points.tobytes()


def test_a_name_that_is_none_is_refused():
    with pytest.raises(DataError, match="no intrinsic is called 'k1'; there are fx, fy, cx, cy, bf"):
        adjust_bundle(disturbed(scenes.scene(3, 10), 1), refine_intrinsics=("k1",))
