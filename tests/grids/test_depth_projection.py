# SPDX-License-Identifier: MIT
"""Grids and floors from depth, against what was put there and against a naive twin of the drawing."""

import math

import numpy as np
import pytest

from slamcli.grids import _depth_kernels as kernels
from slamcli.grids.depth_projection import DepthGridSettings, DepthView, depth_grid
from slamcli.grids.floor import find_floor


def room(rng, n=4000):
    """Points of a floor at z 0.2 and of a wall at x 2, seen from (0, 0, 1)."""
    floor = np.column_stack([rng.uniform(0.2, 2.0, n), rng.uniform(-1, 1, n), np.full(n, 0.2)])
    wall = np.column_stack([np.full(n, 2.02), rng.uniform(-1, 1, n), rng.uniform(0.2, 2.0, n)])
    return np.concatenate([floor, wall])


def test_the_wall_is_occupied_the_floor_free_and_the_rest_unknown():
    points = room(np.random.default_rng(1))
    view = DepthView(points=points, camera=np.array([0.0, 0.0, 1.0]))
    grid = depth_grid([view, view], 0.2, DepthGridSettings(resolution_m=0.1))
    values = {
        p: grid.cells[tuple(grid.map_to_cell([p])[0])] for p in ((2.05, 0.05), (1.0, 0.05), (2.15, 0.05), (0.55, -0.95))
    }
    assert values == {(2.05, 0.05): 100, (1.0, 0.05): 0, (2.15, 0.05): -1, (0.55, -0.95): 0}


def test_what_is_above_the_band_is_not_in_the_way():
    points = np.array([[1.0, y, 2.5] for y in np.linspace(-0.2, 0.2, 50)])
    grid = depth_grid([DepthView(points=points, camera=np.zeros(3))], 0.0, DepthGridSettings())
    assert (grid.cells == 100).sum() == 0
    assert grid.cells[tuple(grid.map_to_cell([[0.5, 0.01]])[0])] == 0


def test_nothing_seen_is_no_grid():
    assert depth_grid([DepthView(points=np.empty((0, 3)), camera=np.zeros(3))], 0.0, DepthGridSettings()) is None


def naive_view(points, camera, low, high, reach, resolution, x_min, y_min, shape, num_directions):
    hits, misses = np.zeros(shape, dtype=int), np.zeros(shape, dtype=int)
    nearest, clear = [math.inf] * num_directions, [0.0] * num_directions
    for x, y, z in points:
        distance = math.hypot(x - camera[0], y - camera[1])
        turn = (math.atan2(y - camera[1], x - camera[0]) + math.pi) / (2 * math.pi) * num_directions
        d = min(int(turn), num_directions - 1)
        clear[d] = max(clear[d], min(distance, reach))
        if low <= z <= high and distance <= reach:
            nearest[d] = min(nearest[d], distance)
            i, j = math.floor((y - y_min) / resolution), math.floor((x - x_min) / resolution)
            if 0 <= i < shape[0] and 0 <= j < shape[1]:
                hits[i, j] += 1
    for d in range(num_directions):
        angle = (d + 0.5) / num_directions * 2 * math.pi - math.pi
        steps = max(int(min(clear[d], nearest[d] - resolution) / (0.5 * resolution)), 0)
        cells = [
            (math.floor((camera[1] + math.sin(angle) * k * 0.5 * resolution - y_min) / resolution),
             math.floor((camera[0] + math.cos(angle) * k * 0.5 * resolution - x_min) / resolution))
            for k in range(steps)
        ]  # fmt: skip
        for k, (i, j) in enumerate(cells):
            if (k == 0 or cells[k - 1] != (i, j)) and 0 <= i < shape[0] and 0 <= j < shape[1]:
                misses[i, j] += 1
    return hits, misses


def test_the_kernel_draws_what_its_twin_draws():
    rng = np.random.default_rng(2)
    points = rng.uniform([-3, -3, -1], [3, 3, 2], (500, 3))
    hits, misses = np.zeros((40, 50), dtype=np.int64), np.zeros((40, 50), dtype=np.int64)
    arguments = (0.1, 1.2, 2.5, 0.1, -2.5, -2.0)
    kernels.draw_view(points, 0.05, 0.02, *arguments, hits, misses, np.empty(72), np.empty(72))
    expected = naive_view(points, (0.05, 0.02), *arguments, (40, 50), 72)
    np.testing.assert_array_equal(hits, expected[0])
    np.testing.assert_array_equal(misses, expected[1])
    normals = rng.normal(size=(3, 3))
    counts = kernels.count_near(points, normals, np.array([0.0, 0.1, 5.0]), 0.2)
    apart = [points @ n - o for n, o in zip(normals, (0, 0.1, 5), strict=True)]
    assert counts.tolist() == [[int((np.abs(d) <= 0.2).sum()), int((d < -0.6).sum())] for d in apart]


def test_the_floor_is_found_under_a_tilted_camera():
    rng = np.random.default_rng(3)
    points = room(rng) + rng.normal(0, 0.005, (8000, 3))
    tilt = 0.5
    R = np.array([[math.cos(tilt), 0, math.sin(tilt)], [0, 1, 0], [-math.sin(tilt), 0, math.cos(tilt)]])
    found = find_floor(points @ R.T, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(found.normal, R[:, 2], atol=0.01)
    assert found.height_m == pytest.approx(0.2, abs=0.01)
    assert found.share == pytest.approx(0.5, abs=0.03)


def test_a_table_over_a_floor_is_no_floor():
    rng = np.random.default_rng(4)
    table = np.column_stack([rng.uniform(0, 1, (3000, 2)), np.full(3000, 0.7)])
    floor = np.column_stack([rng.uniform(0, 3, (1000, 2)), np.zeros(1000)])
    assert find_floor(np.concatenate([table, floor]), np.array([0, 0, 1.0])).height_m == pytest.approx(0.0, abs=1e-6)
    assert find_floor(rng.normal(size=(500, 3)), np.array([0, 0, 1.0])) is None


def test_a_floor_that_is_a_small_part_of_what_is_seen():
    rng = np.random.default_rng(5)
    floor = np.column_stack([rng.uniform(0, 1.5, 800), rng.uniform(0, 1.0, 800), rng.normal(0, 0.004, 800)])
    wall = np.column_stack([rng.uniform(0, 4, 4000), np.full(4000, 1.2), rng.uniform(0.3, 2.5, 4000)])
    things = rng.uniform([0, 0, 0.6], [4, 1.2, 2.0], (4000, 3))
    up = np.array([0.3, 0.2, 1.0])
    for seed in range(4):
        found = find_floor(np.concatenate([floor, wall, things]), up, seed=seed)
        assert found.normal[2] > 0.999
        assert found.height_m == pytest.approx(0.0, abs=0.01)
        assert found.share == pytest.approx(800 / 8800, rel=0.1)
