# SPDX-License-Identifier: MIT
"""The occupancy grid that every tier ends with and every planner starts from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import DataError


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """Occupancy of square cells, as nav_msgs/OccupancyGrid holds it.

    ``cells[row, column]`` covers x from ``column`` to ``column + 1`` cells and y from ``row`` to ``row + 1`` cells from
    the origin, in the grid's own frame, whose pose in the map is `origin` (lower left corner and yaw).
    """

    cells: NDArray[np.int8]
    """int8 (H, W): 0 free to 100 occupied, -1 unknown; row 0 is the lowest y."""
    resolution_m: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y (metres) and yaw (radians) of the lower left corner of cell (0, 0) in the map."""
    frame_id: str = "map"

    UNKNOWN: ClassVar[int] = -1
    FREE: ClassVar[int] = 0
    OCCUPIED: ClassVar[int] = 100

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.dtype != np.int8:
            raise DataError(f"occupancy grid: cells are {self.cells.dtype} {self.cells.shape}, not int8 (H, W)")
        if not (np.isfinite(self.resolution_m) and self.resolution_m > 0):
            raise DataError(f"occupancy grid: resolution {self.resolution_m} m is not a positive number")
        if not np.isfinite(self.origin).all():
            raise DataError(f"occupancy grid: origin {self.origin} is not finite")

    @property
    def height(self) -> int:
        """Number of rows H."""
        return int(self.cells.shape[0])

    @property
    def width(self) -> int:
        """Number of columns W."""
        return int(self.cells.shape[1])

    def map_to_cell(self, points_map: ArrayLike) -> NDArray[np.int64]:
        """Return row and column (N, 2) of the cells that hold points (N, 2), metres, map frame; may lie outside."""
        points = np.asarray(points_map, dtype=np.float64).reshape(-1, 2) - np.asarray(self.origin[:2])
        c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
        local = points @ np.array([[c, -s], [s, c]])
        return np.floor(local[:, ::-1] / self.resolution_m).astype(np.int64)

    def cell_to_map(self, cells_rc: ArrayLike) -> NDArray[np.float64]:
        """Return the centres (N, 2), metres, map frame, of cells given as row and column (N, 2), fractions allowed."""
        local = (np.asarray(cells_rc, dtype=np.float64).reshape(-1, 2)[:, ::-1] + 0.5) * self.resolution_m
        c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
        return local @ np.array([[c, s], [-s, c]]) + np.asarray(self.origin[:2])

    def contains(self, cells_rc: ArrayLike) -> NDArray[np.bool_]:
        """Return whether cells (N, 2), row and column, lie on the grid."""
        rc = np.asarray(cells_rc).reshape(-1, 2)
        return (rc[:, 0] >= 0) & (rc[:, 1] >= 0) & (rc[:, 0] < self.height) & (rc[:, 1] < self.width)
