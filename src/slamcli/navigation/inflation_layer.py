# SPDX-License-Identifier: MIT
"""Inflation that is computed anew only where obstacles came or went."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.distance import squared_distance
from slamcli.navigation import _master_kernels as kernels
from slamcli.navigation.cell_bounds import Extent
from slamcli.navigation.costmap import FREE, INSCRIBED, LETHAL, cost_by_squared_distance

Box = NDArray[np.int64]

_LARGEST_REACH = 160
"""Cells; beyond, one distance field of the whole costmap is less work than many large templates."""


class InflationLayer:
    """The layers below, their inflation, and both together, on the cells of a costmap.

    A cell's inflation is the greatest cost that any obstacle within reach gives it; as cost falls with distance, that is the one from
    the nearest obstacle, exactly as `slamcli.navigation.costmap.inflate` has it. So a new obstacle raises the cells around it, and
    where one has gone the cells around are raised anew by the obstacles that are left.

    Parameters
    ----------
    extent
        Where the costmap lies.
    inscribed_m
        Inscribed radius of the robot, metres.
    radius_m
        How far obstacles have a cost, metres; 0 for no inflation.
    factor
        cost_scaling_factor, 1/m.
    inflate_unknown
        Whether unknown cells take any cost, not only 253 and more.
    """

    def __init__(
        self, extent: Extent, inscribed_m: float, radius_m: float, factor: float, *, inflate_unknown: bool
    ) -> None:
        self._least = FREE + 1 if inflate_unknown else INSCRIBED
        self._description = (inscribed_m, radius_m, factor)
        self.place(extent)

    def place(self, extent: Extent) -> None:
        """Begin anew on an extent."""
        inscribed_m, radius_m, factor = self._description
        reach = math.ceil(radius_m / extent.resolution_m)
        reach = int(min(reach, math.ceil(math.hypot(*extent.shape))))
        self._reach = reach
        self._table = cost_by_squared_distance(reach, extent.resolution_m, inscribed_m, factor)
        self._template = _template(reach if reach <= _LARGEST_REACH else 0, self._table)
        self.base = np.zeros(extent.shape, dtype=np.uint8)
        self.decay = np.zeros(extent.shape, dtype=np.uint8)
        self.costs = np.zeros(extent.shape, dtype=np.uint8)
        tiles = (-(-extent.height // kernels.TILE), -(-extent.width // kernels.TILE))
        self._stale = np.zeros(tiles, dtype=np.uint8)
        self._lost = np.zeros(tiles, dtype=np.uint8)

    def advance(self, below: NDArray[np.uint8], box: Box, changed: Box) -> None:
        """Take over the layers below, uint8 (H, W), within a box; `changed` (4,) grows by the cells whose costs changed."""
        if box[0] < box[1] and self._reach > _LARGEST_REACH:
            self.recompute(below, changed)
        elif box[0] < box[1]:
            kernels.advance(
                below, box, self._template, self._least, self.base, self.decay, self.costs, self._stale, self._lost, changed
            )  # fmt: skip

    def recompute(self, below: NDArray[np.uint8], changed: Box) -> None:
        """Take over the layers below everywhere and inflate them from nothing."""
        self.base[...] = below
        if self._reach > _LARGEST_REACH:
            squared = squared_distance(below == LETHAL)
            near = (squared >= 0) & (squared <= self._reach**2)
            self.decay[...] = 0
            self.decay[near] = self._table[squared[near]]
        else:
            kernels.restart(self._template, self.base, self.decay)
        height, width = self.base.shape
        everything = np.array([0, height, 0, width], dtype=np.int64)
        kernels.mix(self.base, self.decay, self._least, everything, self.costs, changed)


def _template(reach: int, table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return uint8 (2R + 1, 2R + 1), the cost that an obstacle in its middle gives to the cells around."""
    along = np.arange(-reach, reach + 1, dtype=np.int64) ** 2
    squared = along[:, None] + along[None, :]
    template = np.zeros(squared.shape, dtype=np.uint8)
    template[squared <= reach * reach] = table[squared[squared <= reach * reach]]
    return template


def warm() -> None:
    """Compile the kernels of this module."""
    extent = Extent(np.zeros(2), 0.1, 4, 4)
    layer = InflationLayer(extent, 0.05, 0.2, 10.0, inflate_unknown=False)
    below = np.zeros(extent.shape, dtype=np.uint8)
    kernels.put_value(0, extent.everything(), below)
    for put in (kernels.put_all, kernels.put_known, kernels.put_maximum):
        put(layer.costs, extent.everything(), below)
    below[1, 1] = LETHAL
    layer.recompute(below, extent.nothing())
    layer.advance(np.zeros_like(below), extent.everything(), extent.nothing())
