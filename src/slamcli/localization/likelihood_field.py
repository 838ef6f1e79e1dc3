# SPDX-License-Identifier: MIT
"""A map as a particle filter looks things up in it: likelihood of a hit, room around each cell, free cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.grids.distance import squared_distance
from slamcli.localization.amcl_parameters import AmclParameters

OCCUPIED_FROM, _FREE_TO = 65, 19
"""What map_server takes as occupied and free; amcl itself knows 100 and 0 only, which these contain."""
_MOST_ROOM = 255
MOST_DISTANCE_M = 1.0
"""Walls farther from a reading than this do not pull a pose."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LocalizationMap:
    """What the sensor models and the drawing of random poses need of one map."""

    grid: OccupancyGrid
    frame: Array
    """float64 (4,): x, y and yaw of the grid's corner in the map, and cells per metre."""
    free: NDArray[np.int64]
    """int64 (F,), flat indices of the free cells."""
    field: NDArray[np.float32]
    """float32 (H, W), ``z_hit * exp(-d^2 / (2 sigma^2))`` with the distance d to the nearest occupied cell."""
    far: float
    """The same at the largest distance: what is off the map."""
    distances: NDArray[np.float32]
    """float32 (H, W), metres to the centre of the nearest occupied cell, at most `MOST_DISTANCE_M`."""
    half_wall_m: float
    """How far before the middle of its cell a wall's surface is taken to be."""
    room: NDArray[np.uint8]
    """uint8 (H, W), distance in whole cells to the nearest that is not free, for the beam model; (0, 0) for others."""

    @classmethod
    def of(cls, grid: OccupancyGrid, parameters: AmclParameters) -> LocalizationMap:
        """Return the tables of a map.

        Raises
        ------
        DataError
            If the map has no free or no occupied cell.
        """
        occupied, free = grid.cells >= OCCUPIED_FROM, (grid.cells >= 0) & (grid.cells <= _FREE_TO)
        for what, mask in (("free", free), ("occupied", occupied)):
            if not mask.any():
                raise DataError(
                    f"the map of {grid.width} x {grid.height} cells has no {what} cell: nobody can be localised in it"
                )
        by_rays = parameters.laser_model_type == "beam"
        squared = squared_distance(occupied)
        return cls(
            grid=grid,
            frame=np.array([*grid.origin, 1.0 / grid.resolution_m]),
            free=np.flatnonzero(free).astype(np.int64),
            field=_field(squared, grid.resolution_m, parameters),
            far=parameters.laser_z_hit * float(_gauss(np.array(parameters.laser_likelihood_max_dist), parameters)),
            distances=_capped(squared, grid.resolution_m, MOST_DISTANCE_M),
            half_wall_m=(0.5 - parameters.wall_depth) * grid.resolution_m,
            room=_room(~free) if by_rays else np.empty((0, 0), dtype=np.uint8),
        )

    def random_poses(self, num: int, rng: np.random.Generator) -> Array:
        """Return poses (num, 3) in the map's frame, uniform over the free cells and over all headings."""
        cells = self.free[rng.integers(len(self.free), size=num)]
        inside = rng.random((num, 3))
        rc = np.column_stack([cells // self.grid.width, cells % self.grid.width]) + inside[:, :2] - 0.5
        yaw = se2.wrap_angle(inside[:, 2] * 2.0 * math.pi)
        return np.column_stack([self.grid.cell_to_map(rc), yaw])

    def is_free(self, point_m: Array) -> bool:
        """Whether the cell under a point (2,), metres, map frame, is free."""
        row, column = self.grid.map_to_cell(point_m)[0]
        if not self.grid.contains([[row, column]])[0]:
            return False
        return bool(0 <= self.grid.cells[row, column] <= _FREE_TO)


def _gauss(distances_m: Array, parameters: AmclParameters) -> Array:
    return np.asarray(np.exp(-(distances_m**2) / (2.0 * parameters.laser_sigma_hit**2)))


def _field(squared: NDArray[np.int64], resolution_m: float, parameters: AmclParameters) -> NDArray[np.float32]:
    most = parameters.laser_likelihood_max_dist
    cells = math.ceil(most / resolution_m)
    distances = np.minimum(np.sqrt(np.arange(cells**2 + 1)) * resolution_m, most)
    values = (parameters.laser_z_hit * _gauss(distances, parameters)).astype(np.float32)
    return values[np.minimum(squared, cells**2)]


def _capped(squared: NDArray[np.int64], resolution_m: float, most_m: float) -> NDArray[np.float32]:
    cells = math.ceil(most_m / resolution_m)
    distances = np.minimum(np.sqrt(np.arange(cells**2 + 1)) * resolution_m, most_m).astype(np.float32)
    return distances[np.minimum(squared, cells**2)]


def _room(blocked: NDArray[np.bool_]) -> NDArray[np.uint8]:
    if not blocked.any():
        return np.full(blocked.shape, _MOST_ROOM, dtype=np.uint8)
    return np.minimum(np.sqrt(squared_distance(blocked)), _MOST_ROOM).astype(np.uint8)
