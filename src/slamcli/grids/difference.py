# SPDX-License-Identifier: MIT
"""Where two grids differ, each cell of one against the place that it covers in the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.occupancy import OccupancyGrid

STATES = ("free", "occupied", "unknown")
_ROWS_AT_ONCE = 256
_OUTSIDE = 3


@dataclass(frozen=True, slots=True, eq=False)
class GridDifference:
    """Counts of cells by what they are in the first and in the second grid."""

    counts: NDArray[np.int64]
    """int64 (3, 4): state in the first grid against state in the second (free, occupied, unknown, outside)."""
    states: NDArray[np.uint8]
    """uint8 (H, W): 4 * state in the first + state in the second, cells of the first grid."""
    known_outside: int
    """Known cells of the second grid that lie outside the first."""

    @property
    def num_changed(self) -> int:
        """Cells that are free in one grid and occupied in the other."""
        return int(self.counts[0, 1] + self.counts[1, 0])

    @property
    def num_known_in_both(self) -> int:
        """Cells that are free or occupied in both."""
        return int(self.counts[:2, :2].sum())

    @property
    def num_appeared(self) -> int:
        """Cells that are known in the second grid only, those outside the first included."""
        return int(self.counts[2, :2].sum()) + self.known_outside

    @property
    def num_vanished(self) -> int:
        """Cells that are known in the first grid only."""
        return int(self.counts[:2, 2:].sum())

    @property
    def changed_share(self) -> float:
        """Changed cells over those known in both; 0 where none are."""
        return self.num_changed / max(self.num_known_in_both, 1)


def difference(first: OccupancyGrid, second: OccupancyGrid) -> GridDifference:
    """Return where `second` differs from `first`.

    Grids are aligned by origin (with yaw) and resolution: the centre of each cell of `first` is looked up in `second`.
    Occupancy up to 25 is free, from 65 on occupied, all else unknown.
    """
    mine, theirs = states(first.cells), states(second.cells)
    found = np.full(mine.shape, _OUTSIDE, dtype=np.uint8)
    columns = np.arange(first.width)
    for begin in range(0, first.height, _ROWS_AT_ONCE):
        rows = np.arange(begin, min(begin + _ROWS_AT_ONCE, first.height))
        at = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
        there = _cells_of(second, first.cell_to_map(at))
        inside = second.contains(there)
        values = np.full(len(at), _OUTSIDE, dtype=np.uint8)
        values[inside] = theirs[there[inside, 0], there[inside, 1]]
        found[rows] = values.reshape(len(rows), -1)
    both = mine * np.uint8(4) + found
    counts = np.bincount(both.ravel(), minlength=12).reshape(3, 4)
    known = np.argwhere(theirs < 2)
    outside = ~first.contains(_cells_of(first, second.cell_to_map(known)))
    return GridDifference(counts, both, int(outside.sum()))


def _cells_of(grid: OccupancyGrid, points_map: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return row and column (N, 2); centres that rounding has put on an edge go up."""
    nudge = 1e-6 * grid.resolution_m
    c, s = np.cos(grid.origin[2]), np.sin(grid.origin[2])
    return grid.map_to_cell(points_map + nudge * np.array([c - s, s + c]))


def states(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return uint8 (H, W): 0 free, 1 occupied, 2 unknown."""
    found = np.full(cells.shape, 2, dtype=np.uint8)
    found[(cells >= 0) & (cells <= 25)] = 0
    found[cells >= 65] = 1
    return found
