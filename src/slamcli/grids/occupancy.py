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
        points = np.asarray(points_map, dtype=np.float64).reshape(-1, 2)
        x, y = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        if self.origin[2] != 0.0:
            c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
            x, y = c * x + s * y, c * y - s * x
        cells = np.empty(points.shape, dtype=np.int64)
        for column, local in enumerate((y, x)):
            local /= self.resolution_m
            cells[:, column] = np.floor(local, out=local)
        return cells

    def cell_to_map(self, cells_rc: ArrayLike) -> NDArray[np.float64]:
        """Return the centres (N, 2), metres, map frame, of cells given as row and column (N, 2), fractions allowed."""
        cells = np.asarray(cells_rc).reshape(-1, 2)
        x, y = (np.add(cells[:, column], 0.5, dtype=np.float64) * self.resolution_m for column in (1, 0))
        if self.origin[2] != 0.0:
            c, s = np.cos(self.origin[2]), np.sin(self.origin[2])
            x, y = c * x - s * y, s * x + c * y
        points = np.empty(cells.shape)
        np.add(x, self.origin[0], out=points[:, 0])
        np.add(y, self.origin[1], out=points[:, 1])
        return points

    def contains(self, cells_rc: ArrayLike) -> NDArray[np.bool_]:
        """Return whether cells (N, 2), row and column, lie on the grid."""
        rc = np.asarray(cells_rc).reshape(-1, 2)
        return (rc[:, 0] >= 0) & (rc[:, 1] >= 0) & (rc[:, 0] < self.height) & (rc[:, 1] < self.width)
