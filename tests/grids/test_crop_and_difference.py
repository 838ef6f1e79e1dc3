# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.grids import OccupancyGrid
from slamcli.grids.crop import box_of_bounds, crop, known_box
from slamcli.grids.difference import difference


def grid(yaw: float = 0.0) -> OccupancyGrid:
    cells = np.full((8, 10), -1, dtype=np.int8)
    cells[2:5, 3:9] = 0
    cells[3, 4] = 100
    return OccupancyGrid(cells, 0.5, (1.0, -2.0, yaw))


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_cropped_cells_stay_where_they_are(yaw: float) -> None:
    whole = grid(yaw)
    part = crop(whole, known_box(whole), margin=1)
    assert part.cells.shape == (5, 8)
    assert part.cells[2, 2] == 100
    np.testing.assert_allclose(part.cell_to_map([[2, 2]]), whole.cell_to_map([[3, 4]]), atol=1e-12)
    found = difference(whole, part)
    assert (found.num_changed, found.num_appeared, found.num_vanished) == (0, 0, 0)


def test_bounds_on_cell_edges_take_no_further_cell() -> None:
    assert box_of_bounds(grid(), (2.0, -1.5, 3.0, 0.0)) == (1, 2, 4, 4)
    with pytest.raises(DataError, match="does not meet"):
        crop(grid(), box_of_bounds(grid(), (100.0, 100.0, 101.0, 101.0)))


def test_all_unknown_has_no_box() -> None:
    assert known_box(OccupancyGrid(np.full((2, 2), -1, dtype=np.int8), 0.1)) is None


def test_counts_of_a_difference() -> None:
    first, cells = grid(), grid().cells.copy()
    cells[3, 4], cells[2, 3], cells[0, 0], cells[4, 8] = 0, 100, 0, -1
    found = difference(first, OccupancyGrid(cells, 0.5, (1.0, -2.0, 0.0)))
    assert found.num_changed == 2
    assert found.num_appeared == 1
    assert found.num_vanished == 1
    assert found.num_known_in_both == 17
    assert found.changed_share == pytest.approx(2 / 17)


def test_twice_the_resolution_of_the_same_place_is_no_change() -> None:
    first = grid()
    fine = OccupancyGrid(first.cells.repeat(2, axis=0).repeat(2, axis=1), 0.25, first.origin)
    assert difference(first, fine).num_changed == 0
    assert difference(fine, first).num_changed == 0
    assert difference(fine, first).num_known_in_both == 4 * 18


def test_known_cells_outside_have_appeared() -> None:
    whole = grid()
    part = crop(whole, (2, 3, 5, 5))
    found = difference(part, whole)
    assert found.num_appeared == 18 - 6
    assert difference(whole, part).num_vanished == 18 - 6
