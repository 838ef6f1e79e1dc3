# SPDX-License-Identifier: MIT
"""Log odds of the plane, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.grids.odds_plane import OddsPlane, OddsSettings

NONE = np.zeros((0, 2))


def at(grid, x, y):
    column, row = (
        math.floor((v - o) / grid.resolution_m + 1e-9) for v, o in ((x, grid.origin[0]), (y, grid.origin[1]))
    )
    return int(grid.cells[row, column])


def test_a_grid_of_nothing_is_none():
    plane = OddsPlane(0.1, OddsSettings())
    plane.add(NONE, NONE)
    assert plane.grid("map") is None


def test_cells_lie_on_the_lattice_with_ten_around():
    plane = OddsPlane(0.5, OddsSettings())
    plane.add(np.array([[0.1, 0.1]]), np.array([[1.2, -0.3]]))
    grid = plane.grid("map")
    assert grid.cells.shape == (22, 23)
    assert grid.origin == (-5.0, -5.5, 0.0)
    assert (at(grid, 0.1, 0.1), at(grid, 1.2, -0.3), at(grid, 0.6, 0.1)) == (0, 100, -1)


def test_one_view_hits_and_misses_a_cell_once_and_the_hit_outweighs():
    plane = OddsPlane(1.0, OddsSettings())
    many = np.full((50, 2), 0.5)
    plane.add(many, many)
    plane.add(many, NONE)
    assert at(plane.grid("map"), 0.5, 0.5) == 100  # log odds -0.405 + 0.847 - 0.405 = 0.036
    plane.add(many, NONE)
    assert at(plane.grid("map"), 0.5, 0.5) == 0


def test_odds_are_limited_so_that_a_change_is_believed():
    plane = OddsPlane(1.0, OddsSettings())
    cell = np.array([[0.5, 0.5]])
    for _ in range(100):
        plane.add(NONE, cell)
    views = 0
    while at(plane.grid("map"), 0.5, 0.5) == 100:
        plane.add(cell, NONE)
        views += 1
    assert views == math.ceil(math.log(0.971 / 0.029) / math.log(0.6 / 0.4)) == 9


def test_without_a_threshold_the_last_view_counts():
    plane = OddsPlane(1.0, OddsSettings(threshold=0.0))
    cell = np.array([[0.5, 0.5]])
    for _ in range(5):
        plane.add(NONE, cell)
    plane.add(cell, NONE)
    assert at(plane.grid("map"), 0.5, 0.5) == 0


def test_the_order_of_views_does_not_matter_within_the_limits():
    rng = np.random.default_rng(0)
    views = [(rng.uniform(-2, 2, (30, 2)), rng.uniform(-2, 2, (10, 2))) for _ in range(3)]
    settings = OddsSettings(least=0.001, most=0.999)
    grids = []
    for order in ((0, 1, 2), (2, 0, 1)):
        plane = OddsPlane(0.25, settings)
        for k in order:
            plane.add(*views[k])
        grids.append(plane.grid("map"))
    np.testing.assert_array_equal(grids[0].cells, grids[1].cells)
    assert grids[0].origin == grids[1].origin


def test_a_cleared_square_is_free():
    plane = OddsPlane(1.0, OddsSettings())
    cells = np.array([[x + 0.5, y + 0.5] for x in range(-3, 4) for y in range(-3, 4)])
    for _ in range(9):
        plane.add(NONE, cells)
    plane.clear(np.array([0.5, 0.5]), 2.0)
    grid = plane.grid("map")
    assert int((grid.cells == 0).sum()) == 16  # from -1.5 up to before 2.5
    assert (at(grid, -1.5, 1.5), at(grid, 2.5, 0.5), at(grid, -2.5, 0.5)) == (0, 100, 100)


def test_lonely_obstacles_are_eroded():
    plane = OddsPlane(1.0, OddsSettings())
    around = np.array([[x + 0.5, y + 0.5] for x in range(3) for y in range(3) if (x, y) != (1, 1)])
    plane.add(around, np.array([[1.5, 1.5], [5.5, 5.5]]))
    assert at(plane.grid("map"), 1.5, 1.5) == 100
    grid = plane.grid("map", eroded=True)
    assert (at(grid, 1.5, 1.5), at(grid, 5.5, 5.5)) == (0, 100)


def test_a_map_beyond_all_measure_is_refused():
    plane = OddsPlane(0.05, OddsSettings())
    plane.add(np.array([[0.0, 0.0]]), NONE)
    with pytest.raises(DataError, match="poses or ranges are broken"):
        plane.add(np.array([[1e6, 1e6]]), NONE)
