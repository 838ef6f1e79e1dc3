# SPDX-License-Identifier: MIT
"""The voxel filters equal naive twins and keep what they say."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.registration.voxel_filter import adaptive_voxel_filter, voxel_filter

pytestmark = pytest.mark.kernels


def naive_filter(points, size):
    seen, kept = set(), []
    for row, point in enumerate(np.asarray(points)):
        if not np.isfinite(point).all():
            continue
        cell = tuple(np.floor(point.astype(np.float64) / size + 0.5).astype(np.int64))
        if cell not in seen:
            seen.add(cell)
            kept.append(row)
    return kept


def naive_adaptive(points, max_length, min_num_points, max_range):
    near = [i for i, p in enumerate(points) if np.isfinite(p).all() and float(np.linalg.norm(p)) <= max_range]
    if len(near) <= min_num_points:
        return near

    def rows(size):
        return [near[i] for i in naive_filter(points[near], size)]

    kept, high = rows(max_length), max_length
    while len(kept) < min_num_points and high > 0.01 * max_length:
        low = high / 2
        kept = rows(low)
        if len(kept) >= min_num_points:
            while (high - low) / low > 0.1:
                middle = (low + high) / 2
                trial = rows(middle)
                if len(trial) >= min_num_points:
                    low, kept = middle, trial
                else:
                    high = middle
        high /= 2
    return kept


def cloud(dimensions, dtype, seed=3, n=400):
    points = np.random.default_rng(seed).normal(size=(n, dimensions)).astype(dtype) * 3
    points[7] = np.nan
    points[9, 0] = np.inf
    points[20:30] = points[40]
    return points


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_filters_equal_their_naive_twins(dimensions, dtype):
    points = cloud(dimensions, dtype)
    for size in (0.03, 0.5, 2.0):
        assert voxel_filter(points, size).tolist() == naive_filter(points, size)
    for least, reach in ((50, 10.0), (150, 5.0), (380, 9.0), (500, 9.0), (10, 0.5)):
        found = adaptive_voxel_filter(points, 2.0, least, reach)
        assert found.tolist() == naive_adaptive(points.astype(np.float64), 2.0, least, reach)
        assert found.dtype == np.int64


def test_size_zero_keeps_finite_points_and_nothing_comes_of_nothing():
    assert len(voxel_filter(cloud(3, np.float32), 0.0)) == 398
    assert voxel_filter(np.zeros((0, 3)), 0.5).tolist() == []
    assert adaptive_voxel_filter(np.full((4, 3), np.nan), 0.5, 2, 10.0).tolist() == []


def test_far_cells_are_not_confused():
    points = np.array([[0.0, 0, 0], [2.0**21, 0, 0], [2.0**42, 0, 0], [1e30, 0, 0]])
    assert voxel_filter(points, 1.0).tolist() == [0, 1, 2]


def test_wrong_input_is_refused():
    with pytest.raises(DataError, match=r"not float \(N, 2\)"):
        voxel_filter(np.zeros((4, 4)), 1.0)
    with pytest.raises(DataError, match="-1"):
        voxel_filter(np.zeros((4, 3)), -1.0)
    with pytest.raises(DataError, match="max_length nan"):
        adaptive_voxel_filter(np.zeros((4, 3)), float("nan"), 10, 10.0)
