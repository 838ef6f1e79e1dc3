# SPDX-License-Identifier: MIT
"""When the cells of a finished map became known: rays of a run, in the order of time, on the map that it ended with."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.grids import _seen_kernels as kernels
from slamcli.grids.occupancy import OccupancyGrid

_OCCUPIED = 65
_NEVER = 1 << 16
"""Above every occupancy: rays that nothing stops."""
_FARTHEST_M = 1e5


class FirstSeen:
    """Takes the rays of one moment after the other, and remembers for each known cell which was the first to go through it.

    Parameters
    ----------
    grid
        The finished map; cells that are unknown there stay so.
    """

    def __init__(self, grid: OccupancyGrid) -> None:
        self._grid = grid
        self._cells = np.ascontiguousarray(grid.cells)
        self._seen = np.full(grid.cells.shape, -1, dtype=np.int32)

    def add_rays(self, index: int, start_m: NDArray[np.float64], ends_m: NDArray[np.float64]) -> None:
        """Take rays of moment `index` from a point (2,) to where they ended (N, 2), metres, map frame.

        Raises
        ------
        DataError
            If a place is not finite, or farther than 100 km from the origin of the map.
        """
        self._mark(index, start_m, ends_m, _NEVER)

    def add_view(self, index: int, place_m: NDArray[np.float64], reach_m: float) -> None:
        """Take what can be seen all around a point (2,), metres, map frame: up to walls, no farther than `reach_m`.

        Neighbouring rays are a cell apart at their ends. What is unknown does not block the view: maps have holes.

        Raises
        ------
        DataError
            As `add_rays`.
        """
        count = max(8, math.ceil(2 * math.pi * reach_m / self._grid.resolution_m))
        angles = np.arange(count) * (2 * math.pi / count)
        ends = place_m + reach_m * np.column_stack([np.cos(angles), np.sin(angles)])
        self._mark(index, place_m, ends, _OCCUPIED)

    def result(self) -> NDArray[np.int32] | None:
        """Return int32 (H, W): the first moment of each known cell, -1 where the map is unknown; None if no ray met the map.

        Known cells that no ray went through (the tier cleared them with another pose, or drew more than the ray) have the
        moment of the nearest that one did, so that the map is whole at the end.
        """
        known = self._cells >= 0
        seen = known & (self._seen >= 0)
        if not seen.any():
            return None
        if np.array_equal(seen, known):
            return self._seen
        from scipy import ndimage

        nearest = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
        return np.where(known, self._seen[tuple(nearest)], np.int32(-1))

    def _mark(self, index: int, start_m: NDArray[np.float64], ends_m: NDArray[np.float64], stop_at: int) -> None:
        places = np.concatenate([np.reshape(start_m, (1, 2)), np.reshape(ends_m, (-1, 2))]).astype(np.float64)
        x, y, yaw = self._grid.origin
        if not (np.abs(places) < _FARTHEST_M).all():
            raise DataError(f"moment {index}: a ray is not finite, or ends more than 100 km from the map's origin")
        places -= (x, y)
        c, s = math.cos(yaw), math.sin(yaw)
        places = places @ np.array([[c, -s], [s, c]]) / self._grid.resolution_m
        kernels.mark_rays(places[0], places[1:], stop_at, self._cells, index, self._seen)


def warm() -> None:
    """Compile the kernels by calling them on tiny input."""
    seen = FirstSeen(OccupancyGrid(np.zeros((2, 2), dtype=np.int8), 1.0))
    seen.add_rays(0, np.zeros(2), np.ones((1, 2)))
