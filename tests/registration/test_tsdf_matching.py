# SPDX-License-Identifier: MIT
"""Matching on signed distances: interpolation, derivatives, least squares, windows and branch and bound equal their twins."""

from __future__ import annotations

import math

import naive_grids as naive
import numpy as np
import pytest

from slamcli.grids.tsdf_grid import TsdfGrid, TsdfInserter
from slamcli.registration import _grid_kernels as kernels
from slamcli.registration.branch_and_bound import PrecomputedGrids
from slamcli.registration.grid_matching import (
    CorrelativeMatch,
    LeastSquaresMatch,
    angular_step,
    match_correlative,
    match_least_squares,
    mean_probability,
)

pytestmark = pytest.mark.kernels


def random_grid(seed, shape=(14, 19), unknown=0.1):
    rng = np.random.default_rng(seed)
    tsd, weights = rng.integers(1, 32768, (2, *shape)).astype(np.uint16)
    missing = rng.random(shape) < unknown
    tsd[missing], weights[missing] = 0, 0
    weights[0, 3] = 1  # known, but without weight
    return TsdfGrid(tsd, weights, 0.1, (-0.7, 0.4), 0.45, 10.0)


def room(count=240, seed=2):
    """Points on the walls of a room of 4 x 3 m with a niche, seen from its middle."""
    t = np.sort(np.random.default_rng(seed).uniform(0, 14, count))
    corners = np.array([(-2, -1.5), (2, -1.5), (2, 0.4), (1.4, 0.4), (1.4, 1.5), (-2, 1.5), (-2, -1.5)])
    lengths = np.concatenate([[0], np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1))])
    return np.column_stack([np.interp(t, lengths, corners[:, k]) for k in (0, 1)])


@pytest.fixture(scope="module")
def room_grid():
    grid, inserter = TsdfGrid.empty(0.05, (0.0, 0.0), 0.3, 10.0), TsdfInserter()
    for seed in range(20):
        grid = inserter.insert(grid, np.zeros(3), np.zeros(2), room(seed=seed), np.empty((0, 2)))
    return grid.cropped()


def table(cut=0.45):
    return np.concatenate([[cut], np.linspace(-cut, cut, 32767)]).astype(np.float32)


@pytest.mark.parametrize("seed", range(3))
def test_bilinear_values_and_derivatives(seed):
    grid = random_grid(seed)
    places = np.random.default_rng(seed + 10).uniform([-3, -3], [21, 16], (200, 2))
    for u, v in places:
        found = kernels.interpolate_distance(grid.tsd, grid.weights, table(), u, v)
        x, y = grid.origin[0] + (u + 0.5) * 0.1, grid.origin[1] + (v + 0.5) * 0.1
        np.testing.assert_allclose((found[0], found[3]), naive.bilinear(grid, x, y), atol=1e-4)
        for axis in (0, 1):
            step = np.eye(2)[axis] * 1e-7
            ahead, behind = (np.array(naive.bilinear(grid, x + k * step[0], y + k * step[1])) for k in (1, -1))
            expected = (ahead - behind) / 2e-7 * 0.1
            np.testing.assert_allclose((found[1 + axis], found[4 + axis]), expected, atol=0.2, rtol=1e-3)


def test_the_normal_equations_are_those_of_the_residuals():
    grid = random_grid(5, unknown=0.0)
    rng = np.random.default_rng(6)
    points, pose = rng.uniform(-0.9, 0.9, (12, 2)), np.array([0.2, 1.1, 0.4])
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    weight = 3.0 / math.sqrt(12)
    cost = kernels._linearise(
        grid.tsd, grid.weights, table(), *grid.origin, 10.0, points, pose, weight, hessian, gradient
    )
    jacobian = np.empty((12, 3))
    for axis in range(3):
        step = np.eye(3)[axis] * 1e-7
        up, down = (naive.grid_residuals(grid, points, pose + k * step, 3.0) for k in (1, -1))
        jacobian[:, axis] = (up - down) / 2e-7
    r = naive.grid_residuals(grid, points, pose, 3.0)
    assert cost == pytest.approx(0.5 * r @ r, rel=1e-4)
    np.testing.assert_allclose(gradient, jacobian.T @ r, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(np.triu(hessian), np.triu(jacobian.T @ jacobian), rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("shift", [(0.04, -0.03, 0.02), (-0.12, 0.09, -0.05), (0.0, 0.15, 0.04), (0.0, 0.0, 0.0)])
def test_least_squares_finds_known_shifts(room_grid, shift):
    settings = LeastSquaresMatch(translation_weight=0.01, rotation_weight=0.01)
    pose, cost = match_least_squares(room_grid, room(seed=77), np.array(shift), np.array(shift), settings)
    assert np.hypot(pose[0], pose[1]) < 0.008
    assert abs(pose[2]) < 0.004
    assert cost < 1e-3


@pytest.mark.parametrize("weights", [(1.0, 10.0, 40.0), (100.0, 10.0, 40.0), (20.0, 0.5, 0.5)])
def test_least_squares_ends_where_scipy_does(room_grid, weights):
    settings = LeastSquaresMatch(
        occupied_space_weight=weights[0], translation_weight=weights[1], rotation_weight=weights[2]
    )
    points, prior = room(80, seed=5), np.array([0.03, -0.02, 0.015])
    pose, cost = match_least_squares(room_grid, points, prior, prior, settings)
    expected, total = naive.matched(room_grid, points, prior, prior, settings)
    np.testing.assert_allclose(pose, expected, atol=2e-3)  # the distances have bends
    r = naive.residuals(room_grid, points, pose, prior, settings)
    assert cost == pytest.approx(0.5 * r[:80] @ r[:80], rel=1e-3)
    assert 0.5 * r @ r <= 1.02 * total


def test_where_nothing_is_known_the_start_is_kept(room_grid):
    start, far = np.array([90.0, 0.0, 0.3]), np.array([90.5, 0.0, 0.3])
    pose, cost = match_least_squares(room_grid, room(30), start, far, LeastSquaresMatch())
    np.testing.assert_array_equal(pose, start)
    assert cost == math.inf
    pose, _ = match_least_squares(room_grid, np.empty((0, 2)), start, far, LeastSquaresMatch())
    np.testing.assert_array_equal(pose, start)


def test_mean_score(room_grid):
    for pose in np.random.default_rng(8).normal(0, [1.0, 1.0, 1.0], (20, 3)):
        found = mean_probability(room_grid, room(50), pose)
        assert found == pytest.approx(naive.mean_probability(room_grid, room(50), pose), abs=1e-6)
    assert mean_probability(room_grid, room(50), np.zeros(3)) > 0.7
    assert mean_probability(room_grid, room(50), np.array([90.0, 0.0, 0.0])) == pytest.approx(0.1)


@pytest.mark.parametrize("seed", range(3))
def test_the_window_equals_brute_force(seed):
    grid, rng = random_grid(seed, unknown=0.4), np.random.default_rng(seed)
    points, prior = rng.uniform(-0.8, 0.8, (7, 2)), np.array([0.2, 1.0, 0.5])
    window = CorrelativeMatch(
        linear_search_window_m=0.25, angular_search_window_rad=0.4, translation_delta_cost_weight=1.3,
        rotation_delta_cost_weight=0.7,
    )  # fmt: skip
    pose, score = match_correlative(grid, points, prior, window)
    step = angular_step(0.1, float(np.hypot(*points.T).max()))
    best, where = naive.best_in_window(grid, points, prior, 3, math.ceil(0.4 / step), step, (1.3, 0.7))
    assert score == pytest.approx(best, abs=1e-6)
    np.testing.assert_allclose(pose, where, atol=1e-9)


@pytest.mark.parametrize("depth", [1, 3, 6])
@pytest.mark.parametrize("seed", range(3))
def test_branch_and_bound_equals_brute_force(seed, depth):
    grid, rng = random_grid(seed, (23, 31), unknown=0.5), np.random.default_rng(seed)
    points, prior = rng.uniform(-0.9, 0.9, (9, 2)), np.array([rng.uniform(-1, 1.5), rng.uniform(0.4, 2.5), 0.7])
    step = angular_step(0.1, float(np.hypot(*points.T).max()))
    total, poses = naive.best_sum(grid, points, prior, 6, math.ceil(0.15 / step), step)
    found = PrecomputedGrids(grid, depth).search(points, prior, linear_m=0.6, angular_rad=0.15, min_score=0.1)
    assert found is not None
    assert found[1] == pytest.approx(0.1 + 0.8 * total / (255.0 * 9), abs=1e-12)
    assert min(np.abs(found[0] - pose).max() for pose in poses) < 1e-9


def test_branch_and_bound_finds_a_planted_scan(room_grid):
    planted = np.array([0.6, -0.4, 2.1])
    c, s = math.cos(planted[2]), math.sin(planted[2])
    seen = (room(120, seed=9) - planted[:2]) @ np.array([[c, -s], [s, c]])
    found = PrecomputedGrids(room_grid, 6).search_everywhere(seen, min_score=0.6)
    assert found is not None
    assert np.hypot(*(found[0][:2] - planted[:2])) < 0.08
    assert abs(math.remainder(found[0][2] - planted[2], math.tau)) < 0.04
    assert found[1] == pytest.approx(mean_probability(room_grid, seen, found[0]), abs=0.02)
