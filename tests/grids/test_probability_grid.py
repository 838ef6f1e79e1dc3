# SPDX-License-Identifier: MIT
"""Probability grids: odds, rays, growth and cropping equal their naive twins."""

from __future__ import annotations

import itertools
import math

import naive_probability as naive
import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.grids import _probability_kernels as kernels
from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid, cost_of, odds_table, value_of

pytestmark = pytest.mark.kernels

NONE = np.empty((0, 2))
POSE = np.zeros(3)


def value_at(grid, x, y):
    """Stored value of the cell at a point; 0 outside."""
    i, j = (math.floor((v - o) / grid.resolution_m) for v, o in ((y, grid.origin[1]), (x, grid.origin[0])))
    inside = 0 <= i < grid.cells.shape[0] and 0 <= j < grid.cells.shape[1]
    return int(grid.cells[i, j]) if inside else 0


def probability_at(grid, x, y):
    return naive.probability_of(value_at(grid, x, y))


@pytest.mark.parametrize("observed", [0.55, 0.49, 0.7, 0.12, 0.999])
def test_the_odds_table_is_the_formula(observed):
    values = [0, 1, 2, 3, 16384, 32766, 32767, *np.random.default_rng(1).integers(1, 32768, 400).tolist()]
    table = odds_table(observed)
    assert table.shape == (32768,)
    assert np.abs(table[values].astype(int) - [naive.updated(value, observed) for value in values]).max() <= 1
    assert (np.diff(table[1:].astype(int)) >= 0).all()
    assert table.min() >= 1


def test_values_and_costs_go_into_each_other():
    values = np.arange(1, 32768, dtype=np.uint16)
    np.testing.assert_array_equal(value_of(1.0 - cost_of(values).astype(np.float64)), values)
    np.testing.assert_array_equal(value_of(np.array([0.0, 0.1, 0.5, 0.9, 1.0])), [32767, 32767, 16384, 1, 1])
    grid = ProbabilityGrid(np.array([[0, 1], [16384, 32767]], np.uint16), 1.0, (0.0, 0.0))
    np.testing.assert_allclose(grid.probabilities(), [[np.nan, 0.9], [0.5, 0.1]], atol=1e-6)


def test_one_beam_marks_its_end_and_frees_the_way():
    grid = OddsInserter().insert(ProbabilityGrid.empty(0.1, (0.0, 0.0)), POSE, np.array([0.05, 0.05]),
                                 np.array([[0.45, 0.05]]), NONE)  # fmt: skip
    row = [value_at(grid, 0.05 + 0.1 * k, 0.05) for k in range(-1, 6)]
    free, hit = naive.updated(0, 0.49), naive.updated(0, 0.55)
    assert row == [0, free, free, free, free, hit, 0]
    assert np.count_nonzero(grid.cells) == 5


def test_a_beam_without_return_frees_its_end_too():
    grid = ProbabilityGrid.empty(0.1, (0.0, 0.0))
    OddsInserter().insert(grid, POSE, np.array([0.05, 0.05]), NONE, np.array([[0.35, 0.05]]))
    assert [value_at(grid, 0.05 + 0.1 * k, 0.05) for k in range(5)] == [naive.updated(0, 0.49)] * 4 + [0]


def test_in_one_scan_a_cell_changes_once_and_hits_go_first():
    grid = ProbabilityGrid.empty(0.1, (0.0, 0.0))
    beams = np.array([[0.95, 0.05], [0.45, 0.05], [0.46, 0.06], [0.44, 0.04]])  # the first one crosses the others' ends
    OddsInserter().insert(grid, POSE, np.array([0.05, 0.05]), beams, beams)
    assert probability_at(grid, 0.45, 0.05) == pytest.approx(0.55, abs=1e-4)
    assert probability_at(grid, 0.95, 0.05) == pytest.approx(0.55, abs=1e-4)
    assert probability_at(grid, 0.25, 0.05) == pytest.approx(0.49, abs=1e-4)
    OddsInserter().insert(grid, POSE, np.array([0.05, 0.05]), beams, NONE)
    assert naive.odds(probability_at(grid, 0.45, 0.05)) == pytest.approx((0.55 / 0.45) ** 2, rel=1e-3)
    assert naive.odds(probability_at(grid, 0.25, 0.05)) == pytest.approx((0.49 / 0.51) ** 2, rel=1e-3)


def test_probabilities_stop_at_their_limits():
    grid, start, hit = ProbabilityGrid.empty(0.1, (0.0, 0.0)), np.array([0.05, 0.05]), np.array([[0.45, 0.05]])
    for _ in range(120):
        OddsInserter().insert(grid, POSE, start, hit, NONE)
    assert probability_at(grid, 0.45, 0.05) == pytest.approx(0.9)
    assert probability_at(grid, 0.25, 0.05) == pytest.approx(0.1)


@pytest.mark.parametrize("free_space", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_random_scans_equal_the_naive_twin(seed, free_space):
    rng = np.random.default_rng(seed)
    grid = ProbabilityGrid.empty(0.07, (0.3, -0.2), 160)
    inserter = OddsInserter(hit_probability=0.62, miss_probability=0.4, insert_free_space=free_space)
    expected = grid.cells
    for _ in range(4):
        pose, start = rng.normal(0, 0.4, 3), rng.normal(0, 0.2, 2)
        points, misses = rng.uniform(-3, 3, (25, 2)), rng.uniform(-3, 3, (9, 2))
        points[:6] = points[6]
        expected = naive.inserted(
            expected, grid.origin, grid.resolution_m, pose, start, points, misses, 0.62, 0.4, free_space
        )
        assert inserter.insert(grid, pose, start, points, misses) is grid
    differs = np.abs(grid.cells.astype(int) - expected)
    assert differs.max() <= 4  # the table is rounded, the formula too
    assert np.count_nonzero((grid.cells == 0) != (expected == 0)) == 0


@pytest.mark.parametrize("end", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (0.7, 0.7), (-0.7, 0.7), (0.0, 0.0)])
def test_beams_along_lines_and_through_corners_free_a_connected_way(end):
    """Where a beam runs along the line between cells either side is right, and one cell after the other must touch."""
    grid = ProbabilityGrid.empty(0.1, (0.0, 0.0))
    OddsInserter().insert(grid, POSE, np.zeros(2), np.array([end]), NONE)
    rows, columns = np.nonzero(grid.cells)
    steps = round(10 * (abs(end[0]) + abs(end[1]))) + 1
    assert steps - 1 <= len(rows) <= steps + 1
    order = np.argsort(np.hypot(rows - 50, columns - 50), kind="stable")
    for a, b in itertools.pairwise(order):
        assert max(abs(rows[a] - rows[b]), abs(columns[a] - columns[b])) == 1
    assert value_at(grid, end[0] + 1e-9, end[1] + 1e-9) == naive.updated(0, 0.55)


def test_the_scratch_is_large_enough():
    rng = np.random.default_rng(5)
    for _ in range(50):
        grid = ProbabilityGrid.empty(0.05, (0.0, 0.0), 400)
        start, points = rng.normal(0, 1, 2), rng.uniform(-5, 5, (int(rng.integers(0, 4)), 2))
        pose = np.array([0.0, 0.0, rng.uniform(-4, 4)])
        size = kernels.scratch_size(start, points, points, 20.0)
        table, changed = odds_table(0.55), np.empty(size, np.int64)
        used = kernels.add_scan(
            grid.cells, *grid.origin, 20.0, start, points, points, pose, table, table, True, changed
        )
        assert used == np.count_nonzero(grid.cells)
        assert len(set(changed[:used].tolist())) == used <= size


def test_a_grid_grows_and_keeps_what_it_knows():
    rng = np.random.default_rng(3)
    grid = ProbabilityGrid(rng.integers(1, 32768, (20, 30)).astype(np.uint16), 0.05, (1.0, -2.0))
    assert grid.with_room(np.array([1.1, -1.9]), np.array([2.3, -1.2])) is grid
    for low, high in (((0.2, -1.9), (1.5, -1.5)), ((1.2, -1.9), (4.5, 3.0)), ((-3.0, -5.0), (4.0, 1.0))):
        larger = grid.with_room(np.array(low), np.array(high))
        assert larger.cells.sum(dtype=np.int64) == grid.cells.sum(dtype=np.int64)
        for _ in range(60):
            x, y = rng.uniform([1.0, -2.0], [2.5, -1.0])
            assert value_at(larger, x, y) == value_at(grid, x, y)
        top = np.array(larger.origin) + 0.05 * np.array(larger.cells.shape[::-1])
        assert (np.array(larger.origin) <= np.array(low) - 0.05).all()
        assert (top >= np.array(high) + 0.05).all()


def test_points_far_outside_grow_the_grid():
    grid, points = ProbabilityGrid.empty(0.1, (0.0, 0.0), 10), np.array([[12.0, 3.0], [-4.0, -20.0]])
    larger = OddsInserter().insert(grid, np.array([1.0, 2.0, 0.5]), np.zeros(2), points, NONE)
    expected = naive.inserted(
        np.zeros(larger.cells.shape), larger.origin, 0.1, (1.0, 2.0, 0.5), np.zeros(2), points, NONE, 0.55, 0.49
    )
    np.testing.assert_array_equal(larger.cells, expected)
    assert np.count_nonzero(grid.cells) == 0


def test_a_grid_that_would_be_huge_is_refused():
    grid = ProbabilityGrid.empty(0.05, (0.0, 0.0))
    with pytest.raises(DataError, match=r"grow to \d+ x \d+ m.*grid_options_2d\.resolution=0\.05"):
        grid.with_room(np.zeros(2), np.array([4000.0, 4000.0]))


def test_cropping_leaves_what_is_known():
    cells = np.zeros((40, 50), np.uint16)
    cells[7, 12], cells[20, 9], cells[11, 33] = 5, 6, 7
    small = ProbabilityGrid(cells, 0.5, (-3.0, 8.0)).cropped()
    assert small.cells.shape == (14, 25)
    assert small.origin == (-3.0 + 9 * 0.5, 8.0 + 7 * 0.5)
    assert [value_at(small, -3 + 0.5 * j + 0.1, 8 + 0.5 * i + 0.1) for i, j in ((7, 12), (20, 9), (11, 33))] == [
        5,
        6,
        7,
    ]
    assert small.cells.base is None  # the large array is let go
    empty = ProbabilityGrid(np.zeros((9, 9), np.uint16), 0.5, (1.0, 2.0)).cropped()
    assert empty.cells.tolist() == [[0]]


def test_a_new_grid_lies_on_multiples_of_the_resolution_around_its_centre():
    grid = ProbabilityGrid.empty(0.05, (3.21, -7.77), 100)
    np.testing.assert_allclose(np.array(grid.origin) / 0.05, np.round(np.array(grid.origin) / 0.05), atol=1e-9)
    np.testing.assert_allclose(np.array(grid.origin) + 2.5, (3.21, -7.77), atol=0.026)
