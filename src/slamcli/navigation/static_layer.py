# SPDX-License-Identifier: MIT
"""The static layer of a costmap: a map as it was built, or as it is being built."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.grids import OccupancyGrid
from slamcli.navigation import _master_kernels as master
from slamcli.navigation import _obstacle_kernels as kernels
from slamcli.navigation.cell_bounds import Extent
from slamcli.navigation.costmap import NO_INFORMATION, static_costs
from slamcli.navigation.costmap_parameters import CostmapParameters

_MOST_CELLS = 1 << 28


class StaticLayer:
    """A map's costs on its own extent."""

    def __init__(self, name: str, parameters: CostmapParameters, grid: OccupancyGrid) -> None:
        self.name = name
        self._parameters = parameters
        self.set_map(grid)

    def set_map(self, grid: OccupancyGrid) -> None:
        """Take another map."""
        self.extent, self.costs = upright_costs(grid, self._parameters)

    def put(self, box: NDArray[np.int64], out: NDArray[np.uint8]) -> None:
        """Put the map on the layers below within a box of its own extent."""
        if self._parameters.static_enabled:
            put = master.put_maximum if self._parameters.use_maximum else master.put_all
            put(self.costs, box, out)

    def put_sampled(
        self, pose: NDArray[np.float64], extent: Extent, box: NDArray[np.int64], out: NDArray[np.uint8]
    ) -> None:
        """Put the map on a window (H, W) that lies elsewhere: each of its cells takes the map's cell that holds its centre.

        `pose` float64 (3,) is that of the window's frame in the map's frame.
        """
        if self._parameters.static_enabled:
            kernels.sample(
                self.costs, self.extent.corner, self.extent.resolution_m, pose, extent.corner, extent.resolution_m,
                self._parameters.use_maximum, box, out,
            )  # fmt: skip

    def forget(self, cells: NDArray[np.bool_]) -> None:
        """Forget what is known of the cells that are true in `cells`, bool (H, W)."""
        self.costs[cells] = NO_INFORMATION


def upright_costs(grid: OccupancyGrid, parameters: CostmapParameters) -> tuple[Extent, NDArray[np.uint8]]:
    """Return the extent and the static costs (H, W) of a map in its frame, without rotation.

    A map whose origin has a yaw is put on an upright grid of the same resolution around it: each cell takes the one that holds its
    centre, and is unknown outside. A wall of one cell stays closed.

    Raises
    ------
    DataError
        If the upright grid would have more than 268 million cells.
    """
    costs = np.ascontiguousarray(static_costs(grid, parameters))
    x, y, yaw = grid.origin
    turn = math.remainder(yaw, 2.0 * math.pi)
    if abs(turn) < 1e-9:
        return Extent(np.array([x, y], dtype=np.float64), grid.resolution_m, *costs.shape), costs
    corners = grid.cell_to_map(np.array([[r, c] for r in (0, grid.height) for c in (0, grid.width)]) - 0.5)
    low, high = corners.min(axis=0), corners.max(axis=0)
    width, height = (math.ceil(v - 1e-6) for v in (high - low) / grid.resolution_m)
    if width * height > _MOST_CELLS:
        raise DataError(
            f"a map of {grid.width} x {grid.height} cells turned by {yaw:g} rad is too large to be set upright"
        )
    extent = Extent(low, grid.resolution_m, height, width)
    upright = np.full(extent.shape, NO_INFORMATION if parameters.track_unknown_space else 0, dtype=np.uint8)
    # The upright grid's frame as the turned one sees it.
    c, s = math.cos(turn), math.sin(turn)
    pose = np.array([-c * x - s * y, s * x - c * y, -turn])
    kernels.sample(
        costs, np.zeros(2), grid.resolution_m, pose, low, grid.resolution_m, False, extent.everything(), upright
    )
    return extent, upright
