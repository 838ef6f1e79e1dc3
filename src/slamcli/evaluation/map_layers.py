# SPDX-License-Identifier: MIT
"""A map as an evaluation sees it: walls as points, and which cells are free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slamcli.errors import EstimationError
from slamcli.grids import OccupancyGrid

OCCUPIED_FROM = 65
FREE_TO = 25

_FEW_FACING_FREE = 20
_FREE_POINTS = 10_000
_EIGHT = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True, slots=True, eq=False)
class MapLayers:
    """Walls and free space of a map."""

    grid: OccupancyGrid
    occupied: NDArray[np.bool_]
    """bool (H, W), occupancy of at least 65 %."""
    free: NDArray[np.bool_]
    """bool (H, W), occupancy of at most 25 %."""
    walls_m: NDArray[np.float64]
    """float64 (K, 2), centres of wall cells in the map's frame, metres."""
    free_m: NDArray[np.float64]
    """float64 (F, 2), centres of free cells in the map's frame, metres; at most 10,000, evenly thinned."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Cells that are free or occupied, bool (H, W)."""
        known: NDArray[np.bool_] = self.free | self.occupied
        return known


def map_layers(grid: OccupancyGrid, name: str) -> MapLayers:
    """Return the layers of a map.

    A wall is an occupied cell that touches (eight neighbours) a free cell: what stands inside of a solid block no robot can
    see. Where hardly any occupied cell touches a free one (a drawing of walls only), all of them are walls.

    Raises
    ------
    EstimationError
        If the map has no occupied cell.
    """
    occupied = grid.cells >= OCCUPIED_FROM
    free = (grid.cells >= 0) & (grid.cells <= FREE_TO)
    if not occupied.any():
        raise EstimationError(f"{name}: the map has no occupied cell to compare")
    facing = occupied & ndimage.binary_dilation(free, _EIGHT)
    walls = facing if facing.sum() >= _FEW_FACING_FREE else occupied
    return MapLayers(
        grid,
        occupied,
        free,
        grid.cell_to_map(np.argwhere(walls)),
        grid.cell_to_map(np.column_stack(np.unravel_index(_thinned(np.flatnonzero(free)), free.shape))),
    )


def _thinned(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    return indices[:: max(-(-len(indices) // _FREE_POINTS), 1)]
