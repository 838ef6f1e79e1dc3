# SPDX-License-Identifier: MIT
"""How much of what a robot can get to a map knows: the figure by which exploration is judged."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slamcli.errors import ConfigError
from slamcli.grids import OccupancyGrid

_TOLERANCE_M = 0.1
_MOST_POINTS = 400_000
_FREE_BELOW = 20
"""Cells below are free when the map is saved and read again (map_saver's free_thresh of 0.196)."""


def free_cells(grid: OccupancyGrid) -> NDArray[np.bool_]:
    """Return which cells (H, W) of a map are free."""
    free: NDArray[np.bool_] = (grid.cells >= OccupancyGrid.FREE) & (grid.cells < _FREE_BELOW)
    return free


class ReachableArea:
    """The free cells of a true map that hold together with the start over their sides.

    Cells between which and the start only the robot's body does not fit are among them: a scanner may look in, and what it does
    not see counts against the robot.

    Parameters
    ----------
    truth
        Free, occupied and unknown cells as they are; whatever is not free is a wall.
    start
        float64 (2,) or more: x and y where the robot begins, metres, in the frame of the map.
    tolerance_m
        A cell counts as known if a cell of the map that is free comes so near to it, in x and in y: cells of two
        grids do not lie on one another, and walls are a cell or two off. Never less than the map's own cells.

    Raises
    ------
    ConfigError
        If the start is not in a free cell.
    """

    def __init__(self, truth: OccupancyGrid, start: NDArray[np.float64], tolerance_m: float = _TOLERANCE_M) -> None:
        areas, _ = ndimage.label(free_cells(truth))
        cell = truth.map_to_cell(np.asarray(start, dtype=np.float64)[:2])
        here = int(areas[cell[0, 0], cell[0, 1]]) if truth.contains(cell)[0] else 0
        if here == 0:
            raise ConfigError(f"start {start[0]:g},{start[1]:g} lies in a wall or outside the world")
        cells = np.argwhere(areas == here)
        self.area_m2 = len(cells) * truth.resolution_m**2
        """Size of all cells together."""
        every = math.ceil(len(cells) / _MOST_POINTS)
        self._points: NDArray[np.float64] = truth.cell_to_map(cells[::every])
        self._tolerance_m = tolerance_m

    def share(self, grid: OccupancyGrid) -> float:
        """Return which part of the cells a map in the same frame knows as free, 0 to 1 (of large areas a regular sample)."""
        reach = max(1, round(self._tolerance_m / grid.resolution_m))
        free = ndimage.binary_dilation(free_cells(grid), np.ones((3, 3), np.bool_), iterations=reach)
        cells = grid.map_to_cell(self._points)
        inside = grid.contains(cells)
        return float(free[cells[inside, 0], cells[inside, 1]].sum()) / len(self._points)
