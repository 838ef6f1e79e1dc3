# SPDX-License-Identifier: MIT
"""Disparities along rows, against a naive twin and a scene of known depth."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.vision import _row_kernels as kernels
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.row_matching import RowMatchSettings, match_rows

CAMERA = Pinhole(fx=100.0, fy=100.0, cx=80.0, cy=40.0, width=160, height=80, baseline_m=0.2)


def texture(shift: float) -> np.ndarray:
    u, v = np.meshgrid(np.arange(160) + shift, np.arange(80))
    waves = np.sin(0.7 * u + 0.3 * v) + np.sin(0.23 * u - 0.5 * v) + np.sin(0.11 * u * 1.7 + 0.05 * v)
    return np.rint(128 + 40 * waves).astype(np.uint8)


def naive_twin(left, right, columns, rows, half_width, half_height, least, most, squared):
    found = np.full(len(columns), np.nan)
    height, width = left.shape
    a, b = left.astype(float), right.astype(float)
    for i, (x, y) in enumerate(zip(columns, rows, strict=True)):
        last = min(most, x - half_width)
        if not (half_height <= y < height - half_height and half_width <= x < width - half_width) or last - least < 2:
            continue
        window = slice(y - half_height, y + half_height + 1)
        costs = []
        for d in range(least, last + 1):
            difference = (
                a[window, x - half_width : x + half_width + 1] - b[window, x - d - half_width : x - d + half_width + 1]
            )
            costs.append((difference**2).sum() if squared else np.abs(difference).sum())
        best = int(np.argmin(costs))
        if 0 < best < len(costs) - 1:
            before, here, after = costs[best - 1 : best + 2]
            bend = before + after - 2 * here
            found[i] = least + best + (0.5 * (before - after) / bend if bend > 0 else 0.0)
    return found


@pytest.mark.parametrize("squared", [True, False])
def test_the_kernel_and_its_twin_agree(squared: bool) -> None:
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 256, (2, 30, 60), dtype=np.uint8)
    columns, rows = rng.integers(0, 60, 40), rng.integers(0, 30, 40)
    args = (left, right, columns, rows, 4, 1, 1, 20, squared)
    np.testing.assert_allclose(kernels.block_match(*args), naive_twin(*args), atol=1e-12)


@pytest.mark.parametrize("refine", [True, False])
def test_a_shift_of_parts_of_a_pixel_is_found(refine: bool) -> None:
    pixels = np.array([[60.0, 20.0], [90.0, 40.0], [120.0, 60.0]])
    columns, depth = match_rows(
        texture(0.0), texture(7.3), pixels, CAMERA, RowMatchSettings(refine=refine, max_disparity=30.0)
    )
    np.testing.assert_allclose(pixels[:, 0] - columns, 7.3, atol=0.1)
    np.testing.assert_allclose(depth, 20.0 / 7.3, rtol=0.02)


def test_what_has_no_counterpart_has_no_depth() -> None:
    rng = np.random.default_rng(2)
    left, right = rng.integers(0, 256, (2, 80, 160), dtype=np.uint8)
    columns, depth = match_rows(left, right, np.array([[80.0, 40.0], [2.0, 40.0]]), CAMERA)
    assert np.isnan(columns).all()
    assert np.isnan(depth).all()


def test_images_of_two_sizes_and_a_camera_without_baseline_are_refused() -> None:
    image = texture(0.0)
    with pytest.raises(DataError, match="not of one size"):
        match_rows(image, image[:40], np.zeros((1, 2)), CAMERA)
    alone = Pinhole(fx=1.0, fy=1.0, cx=0.0, cy=0.0, width=160, height=80)
    with pytest.raises(DataError, match="no baseline"):
        match_rows(image, image, np.zeros((1, 2)), alone)
