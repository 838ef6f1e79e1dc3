# SPDX-License-Identifier: MIT
"""Maps whose cells lie askew, drawn anew along x and y: many readers of map.yaml ignore the yaw of its origin."""

from __future__ import annotations

import math

import numpy as np

from slamcli.grids.crop import crop, known_box
from slamcli.grids.occupancy import OccupancyGrid


def straighten(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the map with cells of the same size along x and y, each with the value at its centre, cut to what is known.

    A map that is turned by less than a hundredth of a cell over its length is only cut.
    """
    x, y, yaw = grid.origin
    if abs(math.sin(yaw)) * max(grid.height, grid.width) < 0.01 and math.cos(yaw) > 0.0:
        upright = OccupancyGrid(grid.cells, grid.resolution_m, (x, y, 0.0))
    else:
        upright = _redrawn(grid)
    box = known_box(upright)
    return upright if box is None else crop(upright, box, margin=1)


def _redrawn(grid: OccupancyGrid) -> OccupancyGrid:
    h, w, size = grid.height, grid.width, grid.resolution_m
    corners = grid.cell_to_map([[-0.5, -0.5], [-0.5, w - 0.5], [h - 0.5, -0.5], [h - 0.5, w - 0.5]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    width, height = (math.ceil(v - 1e-6) for v in ((high - low) / size).tolist())
    drawn = OccupancyGrid(
        np.full((height, width), OccupancyGrid.UNKNOWN, np.int8), size, (float(low[0]), float(low[1]), 0.0)
    )
    rows, columns = np.indices((height, width))
    cells = grid.map_to_cell(drawn.cell_to_map(np.column_stack([rows.ravel(), columns.ravel()])))
    inside = grid.contains(cells)
    drawn.cells.ravel()[inside] = grid.cells[cells[inside, 0], cells[inside, 1]]
    return drawn
