# SPDX-License-Identifier: MIT
"""Depth of key points from depth images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.vision.depth_lookup import with_depth
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=100.0, fy=100.0, cx=2.0, cy=2.0, width=5, height=4, baseline_m=0.1)


def features(pixels: list[tuple[float, float]]) -> Features:
    n = len(pixels)
    places = np.array(pixels, dtype=np.float64).reshape(n, 2)
    return Features(
        pixels=places + 10.0,
        octaves=np.zeros(n, np.int64),
        angles=np.zeros(n),
        responses=np.zeros(n),
        descriptors=np.zeros((n, 32), np.uint8),
        sigmas=np.ones(n),
        right=np.full(n, np.nan),
        depth=np.full(n, np.nan),
        raw_pixels=places,
    )


def test_the_nearest_pixel_of_the_raw_image_gives_the_depth() -> None:
    depth = np.zeros((4, 5), dtype=np.float32)
    depth[1, 2], depth[2, 2], depth[3, 4] = 2.0, np.nan, -1.0
    found = with_depth(
        features([(2.4, 1.4), (2.0, 2.0), (4.0, 3.0), (0.0, 0.0), (4.6, 1.0), (-3.0, 1.0)]), depth, CAMERA
    )
    np.testing.assert_array_equal(found.depth, [2.0, np.nan, np.nan, np.nan, np.nan, np.nan])
    # bf = 10: a disparity of 5 pixels, from the column of the ideal camera.
    np.testing.assert_array_equal(found.right[:1], [12.4 - 5.0])
    assert np.isnan(found.right[1:]).all()


def test_without_a_baseline_there_is_no_right_camera() -> None:
    found = with_depth(features([(1.0, 1.0)]), np.full((4, 5), 3.0, np.float32), replace(CAMERA, baseline_m=0.0))
    assert found.depth.tolist() == [3.0]
    assert np.isnan(found.right).all()
    assert len(with_depth(features([]), np.zeros((4, 5), np.float32), CAMERA)) == 0


def test_a_depth_image_of_another_shape_is_refused() -> None:
    with pytest.raises(DataError, match="depth image"):
        with_depth(features([(1.0, 1.0)]), np.zeros((4, 5, 3), np.float32), CAMERA)
