# SPDX-License-Identifier: MIT
"""Tiled maps against a naive twin that counts in one dictionary per map."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import DataError, EstimationError
from slamcli.grids.tiles import TiledMaps

pytestmark = pytest.mark.kernels

DELTA = 0.05


def naive_ray(x0, y0, x1, y1):
    """Cells (i, j) from start to end, both included, by Bresenham's error term."""
    j, i, je, ie = (math.floor(v / DELTA) for v in (x0, y0, x1, y1))
    dj, di = abs(je - j), abs(ie - i)
    error, cells = dj - di, [(i, j)]
    while (i, j) != (ie, je):
        double = 2 * error
        if double > -di:
            error, j = error - di, j + (1 if j < je else -1)
        if double < dj:
            error, i = error + dj, i + (1 if i < ie else -1)
        cells.append((i, j))
    return cells


def naive_add(counts, pose, start, ends, hit):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0, y0 = pose[0] + c * start[0, 0] - s * start[0, 1], pose[1] + s * start[0, 0] + c * start[0, 1]
    for (ex, ey), is_hit in zip(ends, hit, strict=True):
        x1, y1 = pose[0] + c * ex - s * ey, pose[1] + s * ex + c * ey
        for cell in naive_ray(x0, y0, x1, y1):
            entry = counts.setdefault(cell, [0, []])
            entry[0] += 1
        if is_hit:
            counts[cell][1].append((x1, y1))


def scan(rng, beams=40):
    angles = rng.uniform(-np.pi, np.pi, beams)
    ends = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.2, 3.0, (beams, 1))
    return np.full((beams, 2), 0.05), ends, rng.random(beams) < 0.8


def cell(maps, index, i, j):
    """The four numbers of one cell, addressed by its index from the map's zero."""
    x, y = maps.origin
    i, j = i - round(y / DELTA), j - round(x / DELTA)
    return maps.cells[maps.tables[index, i >> 5, j >> 5], i & 31, j & 31]


def assert_equal(maps, index, counts):
    tables = maps.tables[index]
    assert maps.cells[tables[tables > 0]][..., 0].sum() == sum(visits for visits, _ in counts.values())
    for (i, j), (visits, hits) in counts.items():
        found = cell(maps, index, i, j)
        assert (found[0], found[1]) == (visits, len(hits))
        if hits:
            mean = np.mean(hits, axis=0) - np.array([j, i]) * DELTA
            np.testing.assert_allclose(found[2:], mean, atol=2e-6)


def test_scans_are_counted_as_the_naive_twin_counts_them():
    rng = np.random.default_rng(1)
    maps = TiledMaps(2, DELTA, (-1.6, -1.6, 1.6, 1.6))
    counts = [{}, {}]
    for _ in range(3):
        start, ends, hit = scan(rng)
        poses = rng.normal(0, 0.5, (2, 3))
        maps.add_scan(poses, start, ends, hit)
        for k in range(2):
            naive_add(counts[k], poses[k], start, ends, hit)
    for k in range(2):
        assert_equal(maps, k, counts[k])


def test_maps_share_tiles_until_one_of_them_writes():
    rng = np.random.default_rng(2)
    maps = TiledMaps(3, DELTA, (-4.0, -4.0, 4.0, 4.0))
    start, ends, hit = scan(rng)
    maps.add_scan(np.zeros((3, 3)), start, ends, hit)
    counts = {}
    naive_add(counts, np.zeros(3), start, ends, hit)
    alone = maps.num_tiles // 3
    maps.resample(np.array([1, 1, 1]))
    assert maps.num_tiles == alone
    start, ends, hit = scan(rng)
    maps.add_scan(np.zeros((1, 3)), start, ends, hit, maps=np.array([2]))
    assert alone < maps.num_tiles <= 2 * alone + 4
    assert_equal(maps, 0, counts)
    assert_equal(maps, 1, counts)
    naive_add(counts, np.zeros(3), start, ends, hit)
    assert_equal(maps, 2, counts)
    maps.resample(np.array([0, 0, 0]))
    assert maps.num_tiles == alone


def test_the_extent_grows_and_nothing_moves():
    maps = TiledMaps(1, DELTA, (-1.0, -1.0, 1.0, 1.0))
    counts = {}
    for x in (0.013, -30.013, 45.013):
        pose, start, ends, hit = np.array([x, 2 * x, 0.3]), np.zeros((1, 2)), np.array([[1.0, 0.5]]), np.array([True])
        maps.add_scan(pose[None], start, ends, hit)
        naive_add(counts, pose, start, ends, hit)
    assert_equal(maps, 0, counts)


def test_occupancy():
    maps = TiledMaps(1, DELTA, (-1.0, -1.0, 1.0, 1.0))
    with pytest.raises(EstimationError, match="the map is empty"):
        maps.occupancy(0, 0.25, "map")
    for _ in range(3):
        maps.add_scan(np.zeros((1, 3)), np.full((1, 2), 0.01), np.array([[0.51, 0.01]]), np.array([True]))
    maps.add_scan(np.zeros((1, 3)), np.full((1, 2), 0.01), np.array([[0.91, 0.01]]), np.array([False]))
    grid = maps.occupancy(0, 0.25, "map", margin_cells=2)
    row, column = grid.map_to_cell([[0.51, 0.01]])[0]
    assert grid.cells[row, column] == 100
    assert grid.cells[row, column - 10] == 0
    assert grid.cells[row, column + 8] == 0
    assert grid.cells[row + 1, column] == -1
    assert (grid.cells == 100).sum() == 1
    assert (grid.cells == 0).sum() == 18


def test_a_pose_that_is_far_away_is_refused_before_memory_is_taken():
    maps = TiledMaps(1, DELTA, (-1.0, -1.0, 1.0, 1.0))
    with pytest.raises(DataError, match="the map would grow to"):
        maps.add_scan(np.array([[1e7, 0.0, 0.0]]), np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.array([True]))


def test_an_absurd_first_extent_is_only_a_first_extent():
    maps = TiledMaps(1, DELTA, (-1e5, -1e5, 1e5, 1e5))
    assert maps.tables.size < 100
    counts = {}
    pose, start, ends, hit = np.array([3.013, 4.013, 0.1]), np.zeros((1, 2)), np.array([[1.0, 0.5]]), np.array([True])
    maps.add_scan(pose[None], start, ends, hit)
    naive_add(counts, pose, start, ends, hit)
    assert_equal(maps, 0, counts)
