# SPDX-License-Identifier: MIT
"""What a robot can get to, and how much of it a map knows: by hand, and against a naive twin."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.evaluation.reachable_area import ReachableArea
from slamcli.grids import OccupancyGrid


def grid_of(*rows, resolution=1.0, origin=(0.0, 0.0, 0.0)):
    """Return a grid of '.' free, '#' occupied and '?' unknown; the first row is the uppermost."""
    values = {".": 0, "#": 100, "?": -1}
    return OccupancyGrid(np.array([[values[c] for c in row] for row in rows[::-1]], np.int8), resolution, origin)


TRUTH = grid_of(
    "########",
    "#...#..#",
    "#...#..#",
    "#...#.##",
    "#####..#",
    "########",
)


def test_only_what_holds_together_with_the_start_counts():
    left, right = ReachableArea(TRUTH, np.array([1.5, 3.5])), ReachableArea(TRUTH, np.array([5.5, 3.5]))
    assert (left.area_m2, right.area_m2) == (9.0, 7.0)


def test_cells_that_touch_at_a_corner_do_not_hold_together():
    truth = grid_of(".#", "#.")
    assert ReachableArea(truth, np.array([0.5, 1.5])).area_m2 == 1.0


def test_share_by_hand():
    area = ReachableArea(
        TRUTH, np.array([1.5, 3.5])
    )  # x 1 to 4, y 2 to 5; a cell more on each side of a free one counts
    assert area.share(TRUTH) == 1.0
    known = OccupancyGrid(np.full((6, 8), -1, np.int8), 1.0)
    assert area.share(known) == 0.0
    known.cells[2, 1] = 0
    assert area.share(known) == pytest.approx(4 / 9)
    known.cells[2, 1] = 100
    assert area.share(known) == 0.0
    known.cells[2, 1] = 19  # free when it is saved and read again
    assert area.share(known) == pytest.approx(4 / 9)
    known.cells[2, 1] = 20
    assert area.share(known) == 0.0


def test_the_tolerance_is_a_tenth_of_a_metre():
    truth = grid_of("." * 10, resolution=0.05)
    area = ReachableArea(truth, np.array([0.01, 0.01]))
    known = OccupancyGrid(np.full((1, 10), -1, np.int8), 0.05)
    known.cells[0, 0] = 0
    assert area.share(known) == pytest.approx(0.3)  # the cell and two beside it


def test_a_map_elsewhere_turned_and_of_other_cells_equals_the_naive_twin():
    rng = np.random.default_rng(3)
    truth = OccupancyGrid(np.where(rng.random((30, 40)) < 0.2, 100, 0).astype(np.int8), 0.1, (-1.0, -2.0, 0.0))
    truth.cells[:3, :3] = 0
    known = OccupancyGrid(rng.choice(np.array([-1, -1, 0, 100], np.int8), (25, 50)), 0.08, (-0.5, -1.8, 0.4))
    area = ReachableArea(truth, np.array([-0.95, -1.95]))

    todo, found = [(0, 0)], {(0, 0)}
    while todo:
        r, c = todo.pop()
        for there in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
            if 0 <= there[0] < 30 and 0 <= there[1] < 40 and there not in found and truth.cells[there] == 0:
                found.add(there)
                todo.append(there)
    counted = 0
    for r, c in found:
        row, column = known.map_to_cell(truth.cell_to_map([[r, c]]))[0]
        near = [(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        inside = 0 <= row < 25 and 0 <= column < 50
        counted += inside and any(0 <= i < 25 and 0 <= j < 50 and known.cells[i, j] == 0 for i, j in near)
    assert area.area_m2 == pytest.approx(len(found) * 0.01)
    assert area.share(known) == pytest.approx(counted / len(found))


@pytest.mark.parametrize("start", [(0.5, 0.5), (-3.0, 1.0)])
def test_a_start_in_a_wall_or_outside_is_refused(start):
    with pytest.raises(ConfigError, match="in a wall or outside"):
        ReachableArea(TRUTH, np.array(start))
