# SPDX-License-Identifier: MIT
"""Part of a grid."""

from __future__ import annotations

import math

import numpy as np

from slamcli.errors import DataError
from slamcli.grids.occupancy import OccupancyGrid

Box = tuple[int, int, int, int]
"""First row, first column, row and column past the last."""


def known_box(grid: OccupancyGrid) -> Box | None:
    """Return the smallest box that holds every known cell; None if all are unknown."""
    known = grid.cells != OccupancyGrid.UNKNOWN
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return None
    return int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1


def box_of_bounds(grid: OccupancyGrid, bounds: tuple[float, float, float, float]) -> Box:
    """Return the smallest box of cells that covers min x, min y, max x, max y (metres, map frame)."""
    x0, y0, x1, y1 = bounds
    dx = np.array([x0, x1, x1, x0]) - grid.origin[0]
    dy = np.array([y0, y0, y1, y1]) - grid.origin[1]
    c, s = math.cos(grid.origin[2]), math.sin(grid.origin[2])
    columns, rows = (c * dx + s * dy) / grid.resolution_m, (c * dy - s * dx) / grid.resolution_m
    hair = 1e-6  # bounds on a cell's edge do not take in the next cell through rounding
    return (
        math.floor(rows.min() + hair),
        math.floor(columns.min() + hair),
        math.ceil(rows.max() - hair),
        math.ceil(columns.max() - hair),
    )


def crop(grid: OccupancyGrid, box: Box, margin: int = 0) -> OccupancyGrid:
    """Return the part of `grid` in `box`, widened by `margin` cells, as far as the grid goes.

    Raises
    ------
    DataError
        If the box does not meet the grid.
    """
    r0, c0 = max(0, box[0] - margin), max(0, box[1] - margin)
    r1, c1 = min(grid.height, box[2] + margin), min(grid.width, box[3] + margin)
    if r0 >= r1 or c0 >= c1:
        raise DataError("the part to crop to does not meet the map")
    x, y = (float(v) for v in grid.cell_to_map([[r0 - 0.5, c0 - 0.5]])[0])
    cells = np.ascontiguousarray(grid.cells[r0:r1, c0:c1])
    return OccupancyGrid(cells, grid.resolution_m, (x, y, grid.origin[2]), grid.frame_id)
