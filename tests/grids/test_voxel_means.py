# SPDX-License-Identifier: MIT
"""Dense clouds: means per cell, the same whether points come at once or in parts."""

from __future__ import annotations

import numpy as np

from slamcli.grids import voxel_means
from slamcli.grids.voxel_means import VoxelMeans


def test_points_of_a_cell_become_their_mean():
    means = VoxelMeans(0.1)
    means.add(np.array([[0.01, 0.01, 0.01], [0.03, 0.05, 0.01], [-0.01, 0, 0], [np.nan, 0, 0], [1e9, 0, 0]]),
              np.array([[10, 20, 30], [30, 20, 10], [1, 2, 3], [0, 0, 0], [0, 0, 0]], np.uint8))  # fmt: skip
    points, colours = means.means()
    np.testing.assert_allclose(points, [[-0.01, 0, 0], [0.02, 0.03, 0.01]], atol=1e-7)
    np.testing.assert_array_equal(colours, [[1, 2, 3], [20, 20, 20]])
    points, _ = means.means(least=2)
    assert len(points) == 1


def test_parts_are_the_same_as_all_at_once_and_as_a_naive_dictionary(monkeypatch):
    rng = np.random.default_rng(3)
    points, colours = rng.uniform(-1, 1, (5000, 3)), rng.integers(0, 256, (5000, 3), dtype=np.uint8)
    whole = VoxelMeans(0.25)
    whole.add(points, colours)
    monkeypatch.setattr(voxel_means, "_MOST_PENDING", 700)
    parts = VoxelMeans(0.25)
    for rows in np.array_split(np.arange(5000), 13):
        parts.add(points[rows], colours[rows])
    for a, b in zip(whole.means(), parts.means(), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)
    cells: dict[tuple[int, ...], list[int]] = {}
    for i, cell in enumerate(np.floor(points / 0.25).astype(int).tolist()):
        cells.setdefault(tuple(cell), []).append(i)
    expected = [points[cells[key]].mean(axis=0) for key in sorted(cells)]
    np.testing.assert_allclose(whole.means()[0], expected, atol=1e-6)


def test_nothing_is_empty():
    points, colours = VoxelMeans(0.1).means()
    assert points.shape == colours.shape == (0, 3)
