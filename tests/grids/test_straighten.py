# SPDX-License-Identifier: MIT
"""Maps that lie askew, drawn along x and y."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.grids.straighten import straighten


def some_cells(seed=1):
    rng = np.random.default_rng(seed)
    cells = np.full((12, 17), -1, np.int8)
    cells[2:9, 3:14] = rng.choice(np.array([0, 100], np.int8), (7, 11))
    return cells


def test_a_straight_map_is_cut_to_what_is_known():
    found = straighten(OccupancyGrid(some_cells(), 0.5, (1.0, 2.0, 0.0)))
    assert found.origin == pytest.approx((1.0 + 2 * 0.5, 2.0 + 0.5, 0.0))
    np.testing.assert_array_equal(found.cells, some_cells()[1:10, 2:15])


@pytest.mark.parametrize(("yaw", "turns"), [(math.pi / 2, 1), (math.pi, 2), (-math.pi / 2, 3)])
def test_right_angles_lose_nothing(yaw, turns):
    grid = OccupancyGrid(some_cells(), 0.05, (0.31, -0.47, yaw))
    found = straighten(grid)
    assert found.origin[2] == 0.0
    np.testing.assert_array_equal(np.rot90(found.cells, turns), some_cells()[1:10, 2:15])
    rows, columns = np.nonzero(found.cells >= 0)
    centres = found.cell_to_map(np.column_stack([rows, columns]))
    cells = grid.map_to_cell(centres)
    np.testing.assert_array_equal(grid.cells[cells[:, 0], cells[:, 1]], found.cells[rows, columns])


def test_any_angle_shows_at_each_centre_what_was_there():
    grid = OccupancyGrid(some_cells(), 0.05, (0.31, -0.47, 0.7))
    found = straighten(grid)
    centres = found.cell_to_map(np.argwhere(np.ones_like(found.cells)))
    cells = grid.map_to_cell(centres)
    inside = grid.contains(cells)
    expected = np.full(len(cells), -1, np.int8)
    expected[inside] = grid.cells[cells[inside, 0], cells[inside, 1]]
    np.testing.assert_array_equal(found.cells.ravel(), expected)
    assert (found.cells >= 0).sum() == pytest.approx(77, abs=12)


def test_a_map_that_knows_nothing_stays():
    grid = OccupancyGrid(np.full((3, 4), -1, np.int8), 0.1, (1.0, 1.0, 0.0))
    assert straighten(grid).cells.shape == (3, 4)
