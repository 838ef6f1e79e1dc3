# SPDX-License-Identifier: MIT
"""Matching on probability grids: interpolation, derivatives, least squares and windows equal their naive twins."""

from __future__ import annotations

import math

import naive_grids as naive
import numpy as np
import pytest

from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid
from slamcli.registration import _grid_kernels as kernels
from slamcli.registration.grid_matching import (
    CorrelativeMatch,
    LeastSquaresMatch,
    angular_step,
    cost_table,
    match_correlative,
    match_least_squares,
    mean_probability,
    position_spread,
    probability_table,
)

pytestmark = pytest.mark.kernels


def random_grid(seed, shape=(14, 19)):
    rng = np.random.default_rng(seed)
    cells = rng.integers(1, 32768, shape).astype(np.uint16)
    cells[rng.random(shape) < 0.2] = 0
    return ProbabilityGrid(cells, 0.1, (-0.7, 0.4))


def room(count=240, seed=2):
    """Points on the walls of a room of 4 x 3 m with a niche, seen from its middle; walls lie in the middle of cells."""
    t = np.sort(np.random.default_rng(seed).uniform(0, 14, count))
    corners = np.array([(-2, -1.5), (2, -1.5), (2, 0.4), (1.4, 0.4), (1.4, 1.5), (-2, 1.5), (-2, -1.5)]) + 0.025
    lengths = np.concatenate([[0], np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1))])
    return np.column_stack([np.interp(t, lengths, corners[:, k]) for k in (0, 1)])


@pytest.fixture(scope="module")
def room_grid():
    grid, inserter = ProbabilityGrid.empty(0.05, (0.0, 0.0)), OddsInserter()
    for seed in range(30):
        grid = inserter.insert(grid, np.zeros(3), np.zeros(2), room(seed=seed), np.empty((0, 2)))
    return grid


def test_tables():
    assert cost_table()[[0, 1, 32767]].tolist() == pytest.approx([0.9, 0.1, 0.9])
    assert probability_table()[[0, 1, 32767]].tolist() == pytest.approx([0.1, 0.9, 0.1])


@pytest.mark.parametrize("seed", range(3))
def test_bicubic_values_and_derivatives(seed):
    grid = random_grid(seed)
    rng = np.random.default_rng(seed + 10)
    places = rng.uniform([-4, -4], [22, 17], (150, 2))
    places[:20] = np.round(places[:20])
    for u, v in places:
        value, du, dv = kernels.interpolate(grid.cells, cost_table(), u, v)
        x, y = grid.origin[0] + (u + 0.5) * 0.1, grid.origin[1] + (v + 0.5) * 0.1
        assert value == pytest.approx(naive.bicubic(grid, x, y), abs=2e-6)
        step = 1e-5
        across = (naive.bicubic(grid, x + step, y) - naive.bicubic(grid, x - step, y)) / (2 * step) * 0.1
        along = (naive.bicubic(grid, x, y + step) - naive.bicubic(grid, x, y - step)) / (2 * step) * 0.1
        assert (du, dv) == pytest.approx((across, along), abs=2e-4)


def test_interpolation_passes_through_the_cells_and_is_flat_far_outside():
    grid = random_grid(4)
    for i, j in ((0, 0), (5, 7), (13, 18)):
        value, _, _ = kernels.interpolate(grid.cells, cost_table(), float(j), float(i))
        assert value == pytest.approx(naive.costs(grid)[i, j], abs=1e-6)
    for u, v in ((-9.5, 3.0), (3.0, 500.5), (-1e12, 1e12)):
        assert kernels.interpolate(grid.cells, cost_table(), u, v) == pytest.approx((0.9, 0.0, 0.0))


def test_the_normal_equations_are_those_of_the_residuals():
    grid, settings = random_grid(5), LeastSquaresMatch(translation_weight=0.0, rotation_weight=0.0)
    rng = np.random.default_rng(6)
    points, pose = rng.uniform(-0.6, 0.6, (12, 2)), np.array([0.2, 1.1, 0.4])
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    weight = 1.0 / math.sqrt(12)
    cost = kernels._linearise(
        grid.cells,
        np.empty((0, 0), np.uint16),
        cost_table(),
        *grid.origin,
        10.0,
        points,
        pose,
        weight,
        hessian,
        gradient,
    )
    jacobian = np.empty((12, 3))
    for axis in range(3):
        step = np.eye(3)[axis] * 1e-6
        up, down = (naive.residuals(grid, points, pose + k * step, pose, settings)[:12] for k in (1, -1))
        jacobian[:, axis] = (up - down) / 2e-6
    r = naive.residuals(grid, points, pose, pose, settings)[:12]
    assert cost == pytest.approx(0.5 * r @ r, rel=1e-5)
    np.testing.assert_allclose(gradient, jacobian.T @ r, atol=1e-4)
    np.testing.assert_allclose(np.triu(hessian), np.triu(jacobian.T @ jacobian), atol=2e-3)


def test_solve_is_the_inverse_of_the_normal_equations():
    rng = np.random.default_rng(11)
    for _ in range(20):
        root = rng.normal(size=(3, 3))
        hessian, gradient = root @ root.T * 100 + np.eye(3), rng.normal(size=3)
        found = kernels._solve3(np.triu(hessian), gradient)
        np.testing.assert_allclose(found, np.linalg.solve(hessian, -gradient), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("shift", [(0.04, -0.03, 0.02), (-0.07, 0.05, -0.03), (0.0, 0.08, 0.04), (0.0, 0.0, 0.0)])
def test_least_squares_finds_known_shifts(room_grid, shift):
    settings = LeastSquaresMatch(translation_weight=0.1, rotation_weight=0.1)
    pose, cost = match_least_squares(room_grid, room(seed=77), np.array(shift), np.array(shift), settings)
    assert np.hypot(pose[0], pose[1]) < 0.006
    assert abs(pose[2]) < 0.003
    at_start = naive.residuals(room_grid, room(seed=77), shift, shift, settings)
    assert cost <= 0.5 * at_start @ at_start + 1e-9


@pytest.mark.parametrize("weights", [(1.0, 10.0, 40.0), (20.0, 10.0, 1.0), (5.0, 0.5, 0.5)])
def test_least_squares_ends_where_scipy_does(room_grid, weights):
    settings = LeastSquaresMatch(
        occupied_space_weight=weights[0], translation_weight=weights[1], rotation_weight=weights[2]
    )
    points, prior = room(80, seed=5), np.array([0.03, -0.02, 0.015])
    pose, cost = match_least_squares(room_grid, points, prior, prior, settings)
    expected, total = naive.matched(room_grid, points, prior, prior, settings)
    np.testing.assert_allclose(pose, expected, atol=2e-4)
    r = naive.residuals(room_grid, points, pose, prior, settings)
    assert cost == pytest.approx(0.5 * r[:80] @ r[:80], rel=1e-4)
    assert 0.5 * r @ r == pytest.approx(total, rel=1e-4)


def test_without_information_the_prior_holds():
    empty, points = ProbabilityGrid.empty(0.05, (0.0, 0.0)), room(30)
    prior, start = np.array([0.1, 0.2, 0.3]), np.array([0.15, 0.1, 0.2])
    np.testing.assert_allclose(
        match_least_squares(empty, points, start, prior, LeastSquaresMatch())[0], prior, atol=1e-6
    )
    nothing = np.empty((0, 2))
    pose, cost = match_least_squares(empty, nothing, start, prior, LeastSquaresMatch())
    np.testing.assert_allclose(pose, prior, atol=1e-6)
    assert cost == 0.0


def test_no_iterations_leave_the_start(room_grid):
    start = np.array([0.05, 0.0, 0.0])
    pose, _ = match_least_squares(room_grid, room(), start, np.zeros(3), LeastSquaresMatch(max_num_iterations=0))
    np.testing.assert_array_equal(pose, start)


def test_mean_probability(room_grid):
    rng = np.random.default_rng(8)
    for pose in rng.normal(0, [2.0, 2.0, 1.0], (20, 3)):
        found = mean_probability(room_grid, room(50), pose)
        assert found == pytest.approx(naive.mean_probability(room_grid, room(50), pose), abs=1e-6)
    assert mean_probability(room_grid, room(50), np.zeros(3)) > 0.8
    assert mean_probability(room_grid, room(50), np.array([90.0, 0.0, 0.0])) == pytest.approx(0.1)
    assert mean_probability(room_grid, np.empty((0, 2)), np.zeros(3)) == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_the_window_equals_brute_force(seed):
    grid, rng = random_grid(seed), np.random.default_rng(seed)
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


def test_the_window_finds_a_large_shift(room_grid):
    prior = np.array([0.22, -0.16, 0.21])
    window = CorrelativeMatch(linear_search_window_m=0.3, angular_search_window_rad=0.3)
    pose, score = match_correlative(room_grid, room(80, seed=3), prior, window)
    assert np.hypot(pose[0], pose[1]) < 0.08
    assert abs(pose[2]) < 0.03
    assert score > 0.6


def test_without_points_the_window_stays_at_the_prior(room_grid):
    prior = np.array([0.22, -0.16, 0.21])
    pose, score = match_correlative(room_grid, np.empty((0, 2)), prior, CorrelativeMatch())
    np.testing.assert_array_equal(pose, prior)
    assert score == 0.0


@pytest.mark.parametrize("farthest", [0.01, 0.3, 5.0, 80.0])
def test_an_angular_step_moves_the_farthest_point_by_at_most_a_cell(farthest):
    step = angular_step(0.05, farthest)
    chord = 2 * farthest * math.sin(step / 2)
    assert chord <= 0.05
    assert chord > 0.045 or farthest < 0.15


@pytest.mark.parametrize("seed", range(3))
def test_the_spread_equals_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    grid, points, pose = random_grid(seed, (40, 40)), rng.uniform(-0.8, 0.8, (9, 2)), np.array([1.2, 2.3, 0.4])
    expected = naive.position_spread(grid, points, pose, 3, 2, 0.02)
    np.testing.assert_allclose(position_spread(grid, points, pose, 0.55), expected, rtol=1e-4)


def test_a_corridor_spreads_along_itself_and_a_room_does_not(room_grid):
    grid, along = ProbabilityGrid.empty(0.05, (0.0, 0.0), 300), np.linspace(-6, 6, 600)
    walls = np.concatenate([np.column_stack([along, np.full(600, y)]) for y in (-1.025, 1.025)])
    for _ in range(20):
        OddsInserter().insert(grid, np.zeros(3), np.zeros(2), walls, np.empty((0, 2)))
    seen = walls[np.abs(walls[:, 0]) < 2.0]
    corridor, closed = (position_spread(g, p, np.zeros(3), 2.0) for g, p in ((grid, seen), (room_grid, room())))
    assert math.sqrt(corridor[0, 0]) > 1.0
    assert math.sqrt(corridor[1, 1]) < 0.1
    assert math.sqrt(np.linalg.eigvalsh(closed)[1]) < 0.1
