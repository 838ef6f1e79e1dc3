# SPDX-License-Identifier: MIT
"""What a camera can see of a map, against a naive twin."""

import math

import numpy as np
import pytest

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.orbslam3.visible_points import visible_points  # its kernels: vision._projection_kernels
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=300.0, fy=310.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.1)
SCALES = 1.2 ** np.arange(8.0)


@pytest.fixture
def sparse_map():
    """200 points around one keyframe at the origin, with random viewing directions and distances."""
    rng = np.random.default_rng(3)
    n = 200
    features = Features(
        pixels=rng.uniform(0, 240, (n, 2)), raw_pixels=np.zeros((n, 2)), octaves=rng.integers(0, 8, n), angles=np.zeros(n),
        responses=np.ones(n), descriptors=rng.integers(0, 256, (n, 32), dtype=np.uint8), sigmas=np.ones(n), right=np.full(n, np.nan),
        depth=np.full(n, np.nan),
    )  # fmt: skip
    made = SparseMap(CAMERA, SCALES)
    grid = feature_grid(features, CAMERA)
    made.add_keyframe(Frame(number=0, stamp_ns=0, features=features, grid=grid, points=np.full(n, -1)), -1)
    ids = made.add_points(rng.uniform([-3, -3, -1], [3, 3, 6], (n, 3)), 0, np.arange(n))
    made.refresh_points(ids)
    made.normals[:] += rng.normal(0, 0.6, (n, 3))
    made.normals[:] /= np.linalg.norm(made.normals, axis=1)[:, None]
    return made


def naive(sparse_map, ids, T, least_cosine):
    """Return what the kernel should find, point by point."""
    found = []
    centre = -T[:3, :3].T @ T[:3, 3]
    for p in ids.tolist():
        x, y, z = T[:3, :3] @ sparse_map.positions[p] + T[:3, 3]
        if z <= 1e-6:
            continue
        u, v = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
        ray = sparse_map.positions[p] - centre
        distance = np.linalg.norm(ray)
        cosine = ray @ sparse_map.normals[p] / distance
        if not (0 <= u < 320 and 0 <= v < 240) or cosine < least_cosine:
            continue
        if distance > 1.2 * sparse_map.far[p] or distance < sparse_map.near[p] / 1.2:
            continue
        octave = min(max(math.ceil(math.log(sparse_map.far[p] / distance) / math.log(1.2) - 1e-9), 0), 7)
        found.append((p, u, v, u - CAMERA.bf / z, octave, cosine, z))
    return np.array(found)


@pytest.mark.parametrize("any_direction", [False, True])
def test_the_kernel_agrees_with_its_twin(sparse_map, any_direction):
    T = np.eye(4)
    T[:3, 3] = 0.3, -0.1, 0.4
    ids = np.arange(0, 200, 2)
    seen = visible_points(sparse_map, ids, T, any_direction=any_direction)
    expected = naive(sparse_map, ids, T, -2.0 if any_direction else 0.5)
    assert len(expected) > 10
    np.testing.assert_array_equal(seen.ids, expected[:, 0])
    np.testing.assert_allclose(seen.pixels, expected[:, 1:3])
    np.testing.assert_allclose(seen.right, expected[:, 3])
    np.testing.assert_array_equal(seen.octaves, expected[:, 4])
    np.testing.assert_allclose(seen.cosines, expected[:, 5])
    np.testing.assert_allclose(seen.depths, expected[:, 6])


def test_what_was_seen_is_seen_again_at_its_octave(sparse_map):
    seen = visible_points(sparse_map, np.arange(200), np.eye(4), any_direction=True)
    np.testing.assert_array_equal(seen.octaves, sparse_map.octaves[0, seen.ids])
