# SPDX-License-Identifier: MIT
"""Branch and bound finds what brute force finds, on grids, windows and depths of every kind."""

from __future__ import annotations

import math

import naive_grids as naive
import numpy as np
import pytest

from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid
from slamcli.registration import _branch_kernels as kernels
from slamcli.registration.branch_and_bound import PrecomputedGrids, byte_table
from slamcli.registration.grid_matching import angular_step

pytestmark = pytest.mark.kernels


def sparse_grid(rng, shape=(23, 31)):
    """Mostly unknown and free cells, some walls: scores differ from place to place."""
    cells = np.where(rng.random(shape) < 0.5, 0, rng.integers(20000, 32768, shape))
    walls = rng.random(shape) < 0.15
    cells[walls] = rng.integers(1, 9000, int(walls.sum()))
    return ProbabilityGrid(cells.astype(np.uint16), 0.1, (-1.0, 0.5))


def brute_force(grid, points, prior, linear_m, angular_rad):
    step = angular_step(grid.resolution_m, float(np.hypot(*points.T).max()))
    half, turns = math.ceil(linear_m / grid.resolution_m), math.ceil(angular_rad / step)
    total, poses = naive.best_sum(grid, points, prior, half, turns, step)
    return 0.1 + 0.8 * total / (255.0 * len(points)), poses


def test_bytes_are_probabilities_from_a_tenth_to_nine_tenths():
    grid = sparse_grid(np.random.default_rng(0))
    assert byte_table(grid)[[0, 1, 16000, 32767]].tolist() == [0, 255, 130, 0]
    np.testing.assert_array_equal(byte_table(grid)[grid.cells], naive.bytes_of(grid))


@pytest.mark.parametrize("shape", [(1, 1), (5, 9), (17, 4)])
@pytest.mark.parametrize("depth", [1, 2, 3, 4])
def test_levels_are_maxima_over_windows(shape, depth):
    grid = sparse_grid(np.random.default_rng(depth), shape)
    pad = 2 ** (depth - 1) - 1
    levels = np.empty((depth, shape[0] + pad, shape[1] + pad), np.uint8)
    kernels.precompute(grid.cells, byte_table(grid), levels)
    for h in range(depth):
        inner = 2**h - 1  # windows of this level begin at most so far before the grid
        np.testing.assert_array_equal(
            levels[h, pad - inner :, pad - inner :], naive.window_maxima(naive.bytes_of(grid), 2**h)
        )


@pytest.mark.parametrize("depth", [1, 2, 3, 5, 7])
@pytest.mark.parametrize("seed", range(5))
def test_equals_brute_force(seed, depth):
    rng = np.random.default_rng(seed)
    grid, points = sparse_grid(rng), rng.uniform(-0.9, 0.9, (9, 2))
    prior = np.array([rng.uniform(-1.2, 2.3), rng.uniform(0.2, 3.0), rng.uniform(-3, 3)])
    window = (rng.uniform(0.05, 0.7), rng.uniform(0.0, 0.2))
    best, poses = brute_force(grid, points, prior, *window)
    found = PrecomputedGrids(grid, depth).search(
        points, prior, linear_m=window[0], angular_rad=window[1], min_score=0.1
    )
    assert found is not None
    assert found[1] == pytest.approx(best, abs=1e-12)
    assert min(np.abs(found[0] - pose).max() for pose in poses) < 1e-9


@pytest.mark.parametrize("prior", [(-1.6, 0.0, 0.0), (2.6, 3.3, 1.0), (-1.2, 3.1, -2.0)])
def test_windows_that_leave_the_grid_equal_brute_force(prior):
    rng = np.random.default_rng(9)
    grid, points = sparse_grid(rng), rng.uniform(-0.8, 0.8, (6, 2))
    best, poses = brute_force(grid, points, np.array(prior), 1.0, 0.2)
    found = PrecomputedGrids(grid, 4).search(points, np.array(prior), linear_m=1.0, angular_rad=0.2, min_score=0.1)
    assert found is not None
    assert found[1] == pytest.approx(best, abs=1e-12)
    assert min(np.abs(found[0] - pose).max() for pose in poses) < 1e-9


def test_a_window_off_the_grid_has_nothing():
    rng = np.random.default_rng(9)
    grid, points = sparse_grid(rng), rng.uniform(-0.8, 0.8, (6, 2))
    for prior in ([50.0, 0.0, 0.0], [0.0, -50.0, 1.0], [-50.0, 50.0, 0.0]):
        assert (
            PrecomputedGrids(grid, 4).search(points, np.array(prior), linear_m=2.0, angular_rad=0.5, min_score=0.1)
            is None
        )


@pytest.mark.parametrize("depth", [1, 3])
def test_one_point(depth):
    rng = np.random.default_rng(4)
    grid, prior = sparse_grid(rng), np.array([0.4, 1.4, 0.3])
    for point in ([[0.0, 0.0]], [[0.7, -0.2]]):
        best, poses = brute_force(grid, np.array(point), prior, 0.5, 0.1)
        found = PrecomputedGrids(grid, depth).search(
            np.array(point), prior, linear_m=0.5, angular_rad=0.1, min_score=0.1
        )
        assert found is not None
        assert found[1] == pytest.approx(best, abs=1e-12)
        assert min(np.abs(found[0] - pose).max() for pose in poses) < 1e-9


def test_no_window_is_the_prior():
    rng = np.random.default_rng(4)
    grid, points, prior = sparse_grid(rng), rng.uniform(-0.5, 0.5, (5, 2)), np.array([0.4, 1.4, 0.3])
    found = PrecomputedGrids(grid, 7).search(points, prior, linear_m=0.0, angular_rad=0.0, min_score=0.0)
    assert found is not None
    np.testing.assert_array_equal(found[0], prior)
    assert found[1] == pytest.approx(brute_force(grid, points, prior, 0.0, 0.0)[0])


def test_a_score_must_be_over_the_least():
    rng = np.random.default_rng(6)
    grid, points, prior = sparse_grid(rng), rng.uniform(-0.5, 0.5, (8, 2)), np.array([0.4, 1.4, 0.3])
    searched = PrecomputedGrids(grid, 3)
    best, _ = brute_force(grid, points, prior, 0.4, 0.1)
    one = 0.8 / (255 * 8)
    assert searched.search(points, prior, linear_m=0.4, angular_rad=0.1, min_score=best - one) is not None
    assert searched.search(points, prior, linear_m=0.4, angular_rad=0.1, min_score=best + one) is None
    assert searched.search(points, prior, linear_m=0.4, angular_rad=0.1, min_score=0.9) is None


def corridor_points(pose, rng):
    """What a scanner at a pose sees of a fixed scene of wall pieces, in its own frame."""
    walls = [((0, 0), (3, 0)), ((3, 0), (3, 1.7)), ((0, 0), (0, 2.2)), ((0, 2.2), (1.1, 2.2)), ((1.9, 1.2), (2.4, 0.9))]
    scene = np.concatenate([np.linspace(a, b, 30) for a, b in walls]) + rng.normal(0, 0.005, (150, 2))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return (scene - pose[:2]) @ np.array([[c, -s], [s, c]])


@pytest.mark.parametrize("heading", [0.0, 1.9, -2.8])
def test_everywhere_finds_a_planted_scan(heading):
    rng = np.random.default_rng(12)
    seen_from, planted = np.array([1.0, 1.0, 0.0]), np.array([1.6, 0.6, heading])
    grid, inserter = ProbabilityGrid.empty(0.05, (1.0, 1.0)), OddsInserter()
    for _ in range(20):
        grid = inserter.insert(grid, seen_from, np.zeros(2), corridor_points(seen_from, rng), np.array([[0.2, 0.3]]))
    searched = PrecomputedGrids(grid.cropped(), 6)
    found = searched.search_everywhere(corridor_points(planted, rng)[::3], min_score=0.4)
    assert found is not None
    assert np.hypot(*(found[0][:2] - planted[:2])) < 0.1
    assert abs(math.remainder(found[0][2] - heading, math.tau)) < 0.04
    assert found[1] > 0.5
    assert searched.search_everywhere(corridor_points(planted, rng)[::3] * 1.7, min_score=0.65) is None
