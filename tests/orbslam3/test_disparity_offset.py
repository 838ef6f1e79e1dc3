# SPDX-License-Identifier: MIT
"""An error that all disparities share is found in a map that drove forward, and taken out."""

import numpy as np
import pytest

from slamcli.orbslam3.disparity_offset import apply_offset, find_disparity_offset
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=700.0, fy=700.0, cx=600.0, cy=180.0, width=1200, height=360, baseline_m=0.5)


def drive(offset_px, noise_px=0.2, keyframes=8):
    """Return the map of a drive along a street, whose disparities are too small by an offset."""
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-8, 8, 400), rng.uniform(-2, 1.5, 400), rng.uniform(4, 40, 400)])
    sparse_map = SparseMap(CAMERA, 1.2 ** np.arange(8.0))
    for k in range(keyframes):
        T = np.eye(4)
        T[2, 3] = -2.0 * k
        at = points + T[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = CAMERA.project(at)
        seen = np.flatnonzero(
            (at[:, 2] > 2) & (pixels[:, 0] > 0) & (pixels[:, 0] < 1200) & (pixels[:, 1] > 0) & (pixels[:, 1] < 360)
        )
        n = len(seen)
        noisy = pixels[seen] + rng.normal(0, noise_px, (n, 2))
        right = pixels[seen, 0] - CAMERA.bf / at[seen, 2] + rng.normal(0, noise_px, n) + offset_px
        features = Features(
            pixels=noisy, raw_pixels=noisy, octaves=np.zeros(n, dtype=np.int64), angles=np.zeros(n), responses=np.ones(n),
            descriptors=np.zeros((n, 32), dtype=np.uint8), sigmas=np.ones(n), right=right, depth=CAMERA.bf / (noisy[:, 0] - right),
        )  # fmt: skip
        ids = np.full(n, -1, dtype=np.int64) if k == 0 else seen
        sparse_map.add_keyframe(
            Frame(number=k, stamp_ns=k, features=features, grid=None, points=ids, T_camera_map=T), k - 1
        )
        if k == 0:
            order = sparse_map.add_points(points, 0, np.zeros(400, dtype=np.int64))
            sparse_map.see(0, np.arange(sparse_map.seen.shape[1]), -1)
            sparse_map.see(0, np.arange(n), order[seen])
    return sparse_map


@pytest.mark.parametrize("offset_px", [0.15, -0.1])
def test_the_offset_is_found(offset_px):
    found = find_disparity_offset(drive(offset_px))
    assert found.sigmas > 5
    assert abs(found.offset_px - offset_px) < 3.0 * abs(found.offset_px) / found.sigmas
    quiet = find_disparity_offset(drive(offset_px, noise_px=0.02))
    assert quiet.offset_px == pytest.approx(offset_px, abs=0.003)


def test_what_is_right_stays():
    assert find_disparity_offset(drive(0.0)) is None
    assert find_disparity_offset(drive(0.15, keyframes=4)) is None  # too little to tell


def test_disparities_and_depths_follow():
    sparse_map = drive(0.15)
    depth = sparse_map.depth[2, :20].copy()
    apply_offset(sparse_map, 0.15)
    np.testing.assert_allclose(CAMERA.bf / sparse_map.depth[2, :20] - CAMERA.bf / depth, 0.15, atol=1e-9)
    assert find_disparity_offset(sparse_map) is None
