# SPDX-License-Identifier: MIT
"""A focal length that colour and depth contradict is found in a map, and a right one left alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.orbslam3.focal_check import check_focal_lengths
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

TRUE = Pinhole(fx=500.0, fy=505.0, cx=320.0, cy=240.0, width=640, height=480, baseline_m=0.08, depth_weight=3.0)


def room(factor, keyframes=8, noise_px=0.3, turn=0.06):
    """Return the map that a camera makes which goes to the side and turns by `turn` at each keyframe, given `factor` times its focal length."""
    rng = np.random.default_rng(7)
    points = np.column_stack([rng.uniform(-2, 3, 300), rng.uniform(-1.5, 1.5, 300), rng.uniform(2, 5, 300)])
    given = replace(TRUE, fx=TRUE.fx * factor, fy=TRUE.fy * factor)
    sparse_map = SparseMap(given, 1.2 ** np.arange(8.0))
    for k in range(keyframes):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec([2 * turn * np.sin(2.0 * k), turn * (k - keyframes / 2), 0]).as_matrix()
        T[:3, 3] = -T[:3, :3] @ [0.15 * k, 0, 0.0 if turn == 0 else 0.1 * (k % 3)]
        at = points @ T[:3, :3].T + T[:3, 3]
        pixels = TRUE.project(at)
        seen = np.flatnonzero((pixels[:, 0] > 0) & (pixels[:, 0] < 640) & (pixels[:, 1] > 0) & (pixels[:, 1] < 480))
        noisy = pixels[seen] + rng.normal(0, noise_px, (len(seen), 2))
        depth = at[seen, 2] * (1 + rng.normal(0, 0.003, len(seen)))
        n = len(seen)
        features = Features(
            pixels=noisy, raw_pixels=noisy, octaves=np.zeros(n, dtype=np.int64), angles=np.zeros(n), responses=np.ones(n),
            descriptors=np.zeros((n, 32), dtype=np.uint8), sigmas=np.ones(n), right=noisy[:, 0] - given.bf / depth, depth=depth,
        )  # fmt: skip
        ids = np.full(n, -1, dtype=np.int64) if k == 0 else seen  # the points come after the first keyframe
        sparse_map.add_keyframe(
            Frame(number=k, stamp_ns=k, features=features, grid=None, points=ids, T_camera_map=T), k - 1
        )
        if k == 0:
            order = sparse_map.add_points(points, 0, np.zeros(300, dtype=np.int64))
            sparse_map.see(0, np.arange(sparse_map.seen.shape[1]), -1)
            sparse_map.see(0, np.arange(n), order[seen])
    return sparse_map


@pytest.mark.parametrize("factor", [1.05, 0.95])
def test_a_wrong_focal_length_is_found_and_told(factor):
    sparse_map = room(factor)
    before = sparse_map.T_camera_map.copy(), sparse_map.positions.copy()
    found = check_focal_lengths(sparse_map)
    assert found.contradicts
    assert found.best_px == pytest.approx((500.0, 505.0), rel=0.01)
    assert all(abs(np.subtract(found.best_px, (500.0, 505.0))) < 4 * np.array(found.sigmas_px))
    assert f"than its {500 * factor:.0f} and {505 * factor:.0f}: depth not registered to colour" in found.warning()
    assert "--camera FILE" in found.warning()
    assert found.figures()["contradicts"] is True
    np.testing.assert_array_equal(sparse_map.T_camera_map, before[0])  # the map stays as it is
    np.testing.assert_array_equal(sparse_map.positions, before[1])


def test_a_right_one_is_left_alone():
    found = check_focal_lengths(room(1.0))
    assert not found.contradicts
    assert found.best_px == pytest.approx((500.0, 505.0), rel=0.01)
    assert found.given_px == (500.0, 505.0)


def test_a_camera_that_only_shifts_sideways_cannot_tell():
    sparse_map = room(1.05, turn=0.0)
    found = check_focal_lengths(sparse_map)
    assert found.sigmas_px[0] > 3.0
    assert not found.contradicts


def test_little_is_not_judged():
    assert check_focal_lengths(room(1.05, keyframes=4)) is None
    without_depth = room(1.05)
    without_depth.right[:] = np.nan
    assert check_focal_lengths(without_depth) is None


def test_noise_is_no_contradiction():
    sparse_map = room(1.0, keyframes=5, noise_px=6.0)
    assert not check_focal_lengths(sparse_map).contradicts
