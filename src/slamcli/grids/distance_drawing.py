# SPDX-License-Identifier: MIT
"""What a map shows of signed distances of several submaps: their mean, and where it changes its sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.occupancy import OccupancyGrid
from slamcli.grids.tsdf_grid import TsdfGrid

_CUT_CELLS = 2.0
"""Distances beyond so many cells say free, and behind the surface nothing: the other side of a thin wall is another's."""


def drawn_distances(grid: TsdfGrid, cell_m: float) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Return the cells (H, W) that a map takes of a grid, 0 elsewhere, and distances in cells of the map by stored value."""
    table = grid.distance_table() / np.float32(cell_m)
    taken = (grid.weights > 1) & (table[grid.tsd] >= -_CUT_CELLS)
    return np.where(taken, grid.tsd, np.uint16(0)), np.minimum(table, np.float32(_CUT_CELLS))


def trinary_by_distance(distances: NDArray[np.float32]) -> NDArray[np.int8]:
    """Return int8 (H, W), occupied on the surface, free in front of it and unknown behind it, from distances in cells.

    On the surface are cells nearer to it than half a cell, and of two neighbours between which the sign changes the nearer
    one: where submaps differ by a cell, or beams pass close to a wall, the mean may jump by more than a cell. NaN is unknown.
    """
    surface = np.abs(distances) <= 0.5
    for values, marked in ((distances, surface), (distances.T, surface.T)):
        crossing = (values[:-1] < 0.0) & (values[1:] >= 0.0) | (values[:-1] >= 0.0) & (values[1:] < 0.0)
        first = np.abs(values[:-1]) <= np.abs(values[1:])
        marked[:-1] |= crossing & first
        marked[1:] |= crossing & ~first
    cells = np.full(distances.shape, OccupancyGrid.UNKNOWN, np.int8)
    cells[distances > 0.0] = OccupancyGrid.FREE
    cells[surface] = OccupancyGrid.OCCUPIED
    return cells
