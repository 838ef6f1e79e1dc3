# SPDX-License-Identifier: MIT
"""Which points a camera can see, against a naive twin."""

import math

import numpy as np
import pytest

from slamcli.vision.pinhole import Pinhole
from slamcli.vision.point_projection import PointAppearance, project_visible

CAMERA = Pinhole(fx=300.0, fy=310.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.1)
SCALES = 1.2 ** np.arange(8.0)


@pytest.fixture
def points():
    """200 points around the origin, with noisy viewing directions and ranges at which they can be recognised."""
    rng = np.random.default_rng(3)
    positions = rng.uniform([-3, -3, -1], [3, 3, 6], (200, 3))
    normals = positions / np.linalg.norm(positions, axis=1)[:, None] + rng.normal(0, 0.6, (200, 3))
    far = np.linalg.norm(positions, axis=1) * rng.uniform(0.7, 4.0, 200)
    return PointAppearance(positions, normals / np.linalg.norm(normals, axis=1)[:, None], far / SCALES[-1], far)


def naive(points, ids, T, least_cosine):
    """Return what the kernel should find, point by point."""
    found = []
    centre = -T[:3, :3].T @ T[:3, 3]
    for row, p in enumerate(ids.tolist()):
        x, y, z = T[:3, :3] @ points.positions[p] + T[:3, 3]
        if z <= 1e-6:
            continue
        u, v = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
        ray = points.positions[p] - centre
        distance = np.linalg.norm(ray)
        cosine = ray @ points.normals[p] / distance
        if not (0 <= u < 320 and 0 <= v < 240) or cosine < least_cosine:
            continue
        if distance > 1.2 * points.far[p] or distance < points.near[p] / 1.2:
            continue
        octave = min(max(math.ceil(math.log(points.far[p] / distance) / math.log(1.2) - 1e-9), 0), 7)
        found.append((row, u, v, u - CAMERA.bf / z, octave, cosine, z))
    return np.array(found)


@pytest.mark.kernels
@pytest.mark.parametrize("least_cosine", [-2.0, 0.5, 0.9])
def test_the_kernel_agrees_with_its_twin(points, least_cosine):
    T = np.eye(4)
    T[:3, :3] = [[0.96, 0.0, -0.28], [0.0, 1.0, 0.0], [0.28, 0.0, 0.96]]
    T[:3, 3] = 0.3, -0.1, 0.4
    ids = np.arange(198, -1, -2)
    seen = project_visible(points, ids, T, CAMERA, SCALES, least_cosine=least_cosine)
    expected = naive(points, ids, T, least_cosine)
    assert 5 < len(expected) < 60
    np.testing.assert_array_equal(seen.rows, ids[expected[:, 0].astype(np.int64)])
    np.testing.assert_allclose(seen.pixels, expected[:, 1:3])
    np.testing.assert_allclose(seen.right, expected[:, 3])
    np.testing.assert_array_equal(seen.octaves, expected[:, 4])
    np.testing.assert_allclose(seen.cosines, expected[:, 5])
    np.testing.assert_allclose(seen.depths, expected[:, 6])


def test_one_level_of_the_pyramid_is_the_only_octave(points):
    seen = project_visible(points, np.arange(200), np.eye(4), CAMERA, SCALES[:1])
    assert len(seen.rows) > 5
    assert not seen.octaves.any()


def test_nothing_in_view_is_no_rows(points):
    assert len(project_visible(points, np.empty(0, np.int64), np.eye(4), CAMERA, SCALES).rows) == 0
