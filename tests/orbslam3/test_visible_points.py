# SPDX-License-Identifier: MIT
"""What a camera can see of a map."""

import numpy as np
import pytest

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.orbslam3.visible_points import visible_points
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


def test_ids_and_directions(sparse_map):
    """The kernel itself has its twin in tests/vision/test_point_projection.py."""
    ids = np.arange(0, 200, 2)
    facing, anywhere = (visible_points(sparse_map, ids, np.eye(4), any_direction=any_) for any_ in (False, True))
    assert 10 < len(facing.ids) < len(anywhere.ids)
    assert set(facing.ids) < set(anywhere.ids) < set(ids)
    assert facing.cosines.min() >= 0.5 > anywhere.cosines.min()
    x, y, z = sparse_map.positions[anywhere.ids].T
    np.testing.assert_allclose(
        anywhere.pixels, np.column_stack([CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy])
    )


def test_what_was_seen_is_seen_again_at_its_octave(sparse_map):
    seen = visible_points(sparse_map, np.arange(200), np.eye(4), any_direction=True)
    np.testing.assert_array_equal(seen.octaves, sparse_map.octaves[0, seen.ids])
