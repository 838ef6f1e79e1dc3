# SPDX-License-Identifier: MIT
"""Triangulation: exact points, the most likely point under noise, and each check refuses what it is there for."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from scipy.spatial.transform import Rotation

from slamcli.geometry import se3
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.triangulation import triangulate

pytestmark = pytest.mark.kernels

CAMERA = Pinhole(fx=500.0, fy=510.0, cx=320.0, cy=240.0, width=640, height=480, baseline_m=0.1)


def pose(rotation, translation):
    return se3.from_rotation_translation(Rotation.from_rotvec(rotation).as_matrix(), translation)


T_A = pose([0.1, -0.2, 0.3], [0.4, 0.1, -0.3])
T_B = pose([0.05, 0.1, 0.02], [-0.5, 0.1, 0.1]) @ T_A


def in_camera(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def seen(T, points):
    camera = in_camera(T, points)
    pixels = CAMERA.project(camera)
    return pixels, pixels[:, 0] - CAMERA.bf / camera[:, 2], camera[:, 2]


def scene(count=50, seed=0):
    rng = np.random.default_rng(seed)
    points_a = rng.uniform([-2, -1.5, 2], [2, 1.5, 8], (count, 3))
    return in_camera(se3.inverse(T_A), points_a)


def naive_errors(point, observations):
    """Weighted reprojection errors of one point: the twin of what the kernel minimises."""
    out = []
    for T, pixel, right, sigma in observations:
        x, y, z = T[:3, :3] @ point + T[:3, 3]
        u, v = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
        out += [(u - pixel[0]) / sigma, (v - pixel[1]) / sigma]
        if not np.isnan(right):
            out.append((u - CAMERA.bf / z - right) / sigma)
    return np.array(out)


def test_exact_pixels_give_exact_points():
    points = scene()
    a, b = seen(T_A, points), seen(T_B, points)
    distances = [np.linalg.norm(in_camera(T, points), axis=1) for T in (T_A, T_B)]
    got = triangulate(T_A, T_B, a[0], b[0], CAMERA, sigmas_a=1 / distances[0], sigmas_b=1 / distances[1])
    assert got.ok.all()
    assert np.allclose(got.points, points, atol=1e-9)


@pytest.mark.parametrize(("stereo_a", "stereo_b"), [(False, False), (True, False), (False, True), (True, True)])
def test_noisy_pixels_give_the_most_likely_point(stereo_a, stereo_b):
    points, rng = scene(20, 3), np.random.default_rng(5)
    sides = []
    for T, stereo in ((T_A, stereo_a), (T_B, stereo_b)):
        pixels, right, _ = seen(T, points)
        sigmas = rng.choice([1.0, 1.2, 1.44], len(points))
        noise = 0.4 * rng.normal(size=(len(points), 3)) * sigmas[:, None]
        sides.append((pixels + noise[:, :2], right + noise[:, 2] if stereo else np.full(len(points), np.nan), sigmas))
    a, b = sides
    got = triangulate(
        T_A, T_B, a[0], b[0], CAMERA, sigmas_a=a[2], sigmas_b=b[2], right_a=a[1], right_b=b[1], scale_factor=9.0
    )
    assert got.ok.sum() >= 18
    for i in np.flatnonzero(got.ok):
        observations = [(T_A, a[0][i], a[1][i], a[2][i]), (T_B, b[0][i], b[1][i], b[2][i])]
        best = scipy.optimize.least_squares(
            naive_errors, points[i], args=(observations,), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
        assert np.allclose(got.points[i], best.x, atol=2e-4)


def one(point_a, *, right=False, T_b=T_B, sigmas=(1.0, 1.0), shift=(0.0, 0.0), **options):
    point = in_camera(se3.inverse(T_A), np.atleast_2d(np.asarray(point_a, float)))
    (pixels_a, right_a, _), (pixels_b, _, _) = seen(T_A, point), seen(T_b, point)
    return triangulate(
        T_A, T_b, pixels_a, pixels_b + shift, CAMERA, sigmas_a=np.array([sigmas[0]]), sigmas_b=np.array([sigmas[1]]),
        right_a=right_a if right else None, **options,
    )  # fmt: skip


def test_a_distant_point_needs_a_depth():
    assert not one([0, 0, 60.0]).ok[0]  # 0.5 m of 60 m: cosine 0.99996
    assert np.isnan(one([0, 0, 60.0]).points).all()
    assert one([0, 0, 20.0]).ok[0]
    assert one([0, 0, 60.0], right=True).ok[0]
    assert one([0, 0, 60.0], max_cos_parallax=0.99999).ok[0]


def test_the_same_place_twice_gives_points_of_the_stereo_pair_only():
    assert not one([0.3, 0.2, 4.0], T_b=T_A).ok[0]
    got = one([0.3, 0.2, 4.0], T_b=T_A, right=True)
    assert got.ok[0]
    assert np.allclose(in_camera(T_A, got.points), [[0.3, 0.2, 4.0]])


def test_a_wrong_match_is_refused():
    assert one([0.3, 0.2, 4.0]).ok[0]
    assert not one([0.3, 0.2, 4.0], shift=(0.0, 6.0)).ok[0]  # 6 px off the epipolar line: chi2 about 9 on each side
    assert not one([0.3, 0.2, 4.0], shift=(200.0, 0.0)).ok[0]  # behind the cameras
    assert one([0.3, 0.2, 4.0], shift=(0.0, 6.0), sigmas=(2.0, 2.0)).ok[0]


def test_octaves_must_fit_the_distances():
    closer = pose([0, 0, 0], [0, 0, -6.0]) @ T_A  # 10 m from a, 4 m from b: scales differ by 2.5
    closer[0, 3] += 0.5
    assert one([1, 0, 10.0], T_b=closer, sigmas=(1.0, 2.5)).ok[0]
    assert not one([1, 0, 10.0], T_b=closer, sigmas=(1.0, 1.0)).ok[0]
    assert not one([1, 0, 10.0], T_b=closer, sigmas=(2.5, 1.0)).ok[0]


def test_no_pixels_and_nan():
    none = np.empty((0, 2))
    assert triangulate(T_A, T_B, none, none, CAMERA, sigmas_a=np.empty(0), sigmas_b=np.empty(0)).points.shape == (0, 3)
    nan = triangulate(
        T_A, T_B, np.full((1, 2), np.nan), np.ones((1, 2)), CAMERA, sigmas_a=np.ones(1), sigmas_b=np.ones(1)
    )
    assert not nan.ok[0]
