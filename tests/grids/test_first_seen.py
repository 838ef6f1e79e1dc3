# SPDX-License-Identifier: MIT
"""When cells became known, by hand and against a naive twin."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.grids import OccupancyGrid
from slamcli.grids.first_seen import FirstSeen, warm

pytestmark = pytest.mark.kernels


def naive_seen(grid, moments):
    """Walk along every ray in tiny steps."""
    seen = np.full(grid.cells.shape, -1)
    for index, start, ends in moments:
        for end in ends:
            steps = start + np.linspace(0.0, 1.0, 4001)[:, None] * (end - start)
            rows, columns = grid.map_to_cell(steps).T
            inside = (rows >= 0) & (columns >= 0) & (rows < grid.height) & (columns < grid.width)
            for r, c in zip(rows[inside], columns[inside], strict=True):
                if grid.cells[r, c] >= 0 and seen[r, c] < 0:
                    seen[r, c] = index
    return seen


def corridor():
    """Return a row of five free cells, a wall, and what is behind it, 1 m each."""
    return OccupancyGrid(np.array([[0, 0, 0, 0, 0, 100, -1, 0]], dtype=np.int8), 1.0)


def test_cells_have_the_first_ray_that_went_through_them():
    seen = FirstSeen(corridor())
    seen.add_rays(3, np.array([0.5, 0.5]), np.array([[2.5, 0.5]]))
    seen.add_rays(7, np.array([1.5, 0.5]), np.array([[7.5, 0.5]]))
    assert seen.result().tolist() == [[3, 3, 3, 7, 7, 7, -1, 7]]


def test_a_view_ends_at_walls_and_what_nothing_saw_has_the_moment_of_its_neighbour():
    seen = FirstSeen(corridor())
    seen.add_view(2, np.array([1.5, 0.5]), 2.0)
    seen.add_view(5, np.array([3.5, 0.5]), 9.0)
    assert seen.result().tolist() == [[2, 2, 2, 2, 5, 5, -1, 5]]


def test_no_ray_on_the_map_is_no_result():
    seen = FirstSeen(corridor())
    seen.add_rays(0, np.array([20.0, 20.0]), np.array([[30.0, 20.0]]))
    assert seen.result() is None


@pytest.mark.parametrize("broken", [np.nan, np.inf, 1e9])
def test_broken_rays_are_refused(broken):
    with pytest.raises(DataError, match="moment 4: a ray"):
        FirstSeen(corridor()).add_rays(4, np.zeros(2), np.array([[broken, 0.0]]))


@pytest.mark.parametrize("seed", range(3))
def test_seen_cells_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([-1, 0, 100], dtype=np.int8), (30, 40))
    grid = OccupancyGrid(cells, 0.25, (-3.0, -2.0, 0.7))
    moments = [(i, rng.uniform(-2, 4, 2), rng.uniform(-5, 9, (6, 2))) for i in range(5)]
    seen = FirstSeen(grid)
    for moment in moments:
        seen.add_rays(*moment)
    expected = naive_seen(grid, moments)
    found = seen.result()
    at = expected >= 0
    # The walk misses cells whose corner a ray just cuts: there an earlier moment can stand, never a later one.
    assert (found[at] <= expected[at]).all()
    assert np.count_nonzero(found[at] != expected[at]) <= 4
    assert np.array_equal(found >= 0, cells >= 0)


def test_warm_compiles():
    warm()
