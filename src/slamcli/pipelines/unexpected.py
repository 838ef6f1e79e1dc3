# SPDX-License-Identifier: MIT
"""Which beams of a scan end where the map has no wall."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.measurements import LaserScan
from slamcli.simulation.world import OCCUPIED_FROM

Array = NDArray[np.float64]

_WALL_M = 0.15
"""How far from a wall of the map a beam may end and still have met it."""


class WallMask:
    """Where the map explains what a scanner sees: within 0.15 m of its walls, and everywhere outside of what it knows."""

    def __init__(self, grid: OccupancyGrid) -> None:
        self._grid = grid
        reach = int(np.ceil(_WALL_M / grid.resolution_m))
        walls = grid.cells >= OCCUPIED_FROM
        near = ndimage.distance_transform_cdt(~walls, metric="chessboard") <= reach if walls.any() else walls
        self._explained = near | (grid.cells == OccupancyGrid.UNKNOWN)

    def unexpected(self, scan: LaserScan, T_map_laser: Array, T_odom_laser: Array) -> Array:
        """Return the end points (N, 2), metres, odom, of beams that the map does not explain, in the order of beams."""
        ranges = scan.ranges_m.astype(np.float64)
        valid = np.flatnonzero(np.isfinite(ranges) & (ranges > scan.range_min_m) & (ranges < scan.range_max_m))
        angles = scan.angle_min_rad + scan.angle_increment_rad * valid
        local = ranges[valid, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        cells = self._grid.map_to_cell(se2.transform_points(T_map_laser, local))
        inside = self._grid.contains(cells)
        free = np.zeros(len(cells), dtype=np.bool_)
        free[inside] = ~self._explained[cells[inside, 0], cells[inside, 1]]
        return se2.transform_points(T_odom_laser, local[free])
