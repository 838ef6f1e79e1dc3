# SPDX-License-Identifier: MIT
"""A sparse grid of space by log odds, and the octree that it is written as.

A. Hornung, K. M. Wurm, M. Bennewitz, C. Stachniss, W. Burgard, "OctoMap: an efficient probabilistic 3D mapping framework based on
octrees", Autonomous Robots 34, 2013, doi:10.1007/s10514-012-9321-0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.grids import _voxel_kernels as kernels
from slamcli.grids.octree import Octree
from slamcli.grids.odds_plane import OddsSettings
from slamcli.grids.voxel_rays import REACH_CELLS, numbers_of

FREE, GROUND, OBSTACLE = 0, 1, 2


class VoxelOdds:
    """The grid; cell (i, j, k) covers x from i to i + 1 times `cell_m` in the map, and y and z likewise.

    Memory is 4.5 KB per block of 8 x 8 x 8 cells that holds a known one.
    """

    def __init__(self, cell_m: float, settings: OddsSettings) -> None:
        self._cell, self._settings = cell_m, settings
        self._table, self._rows = np.full(1 << 10, -1, dtype=np.int64), np.zeros(1 << 10, dtype=np.int64)
        self._held = np.zeros(1 << 8, dtype=np.int64)
        self._odds = np.zeros((1 << 8, 512), dtype=np.float32)
        self._kinds = np.zeros((1 << 8, 512), dtype=np.int8)
        self._views = np.zeros((1 << 8, 512), dtype=np.int32)
        self._used, self._view = 0, -1

    def add(self, ground: NDArray[np.float64], obstacles: NDArray[np.float64], empty: NDArray[np.float64]) -> None:
        """Take one view: points (N, 3) of the ground and of obstacles, both occupied, and others in free cells; map frame, metres.

        However many points lie in a cell, it is hit once, or else missed once; ground that is hit as an obstacle too is one.

        Raises
        ------
        DataError
            If a point is farther than a million cells from the map's origin.
        """
        hit, miss, least, most = (np.float32(value) for value in self._settings.log_odds)
        self._view += 1
        for points, change, kind in ((obstacles, hit, OBSTACLE), (ground, hit, GROUND), (empty, miss, -1)):
            numbers, done = self._numbers(points), 0
            while done < len(numbers):
                self._used, done = kernels.update_cells(
                    numbers, change, least, most, kind, self._view, self._table, self._rows, self._held, self._odds, self._kinds,
                    self._views, self._used, done,
                )  # fmt: skip
                if done < len(numbers):
                    self._grow()

    def octree(self) -> Octree:
        """Return what is known, sorted."""
        used = self._used
        count = int(np.count_nonzero(~np.isnan(self._odds[:used])))
        indices, values = np.empty((count, 3), dtype=np.int64), np.empty(count, dtype=np.float32)
        kinds = np.empty(count, dtype=np.int8)
        kernels.known_cells(self._held[:used], self._odds[:used], self._kinds[:used], indices, values, kinds)
        order = np.lexsort((indices[:, 2], indices[:, 1], indices[:, 0]))
        threshold = self._settings.threshold or 0.5
        return Octree(
            resolution_m=self._cell, indices=indices[order], edges=np.ones(count, dtype=np.int64), log_odds=values[order],
            ground=kinds[order] == GROUND, threshold=float(np.log(threshold / (1.0 - threshold))) if threshold < 1.0 else np.inf,
        )  # fmt: skip

    def _numbers(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        cells = np.floor(points / self._cell)
        if len(cells) and np.abs(cells).max() >= REACH_CELLS - 1:
            raise DataError(
                f"a point lies {np.abs(points).max():.0f} m from the map's origin, too far for cells of {self._cell:g} m:"
                " poses or ranges are broken"
            )
        return numbers_of(cells.astype(np.int64))

    def _grow(self) -> None:
        rows = 2 * len(self._held)
        self._odds, self._kinds, self._views = (
            np.concatenate([cells, np.zeros_like(cells)]) for cells in (self._odds, self._kinds, self._views)
        )
        self._held = np.resize(self._held, rows)
        self._table, self._rows = np.full(4 * rows, -1, dtype=np.int64), np.zeros(4 * rows, dtype=np.int64)
        kernels.put_blocks(self._table, self._rows, self._held[: self._used])


def warm() -> None:
    """Compile the kernels of this module."""
    voxels = VoxelOdds(0.1, OddsSettings())
    voxels.add(np.zeros((1, 3)), np.ones((1, 3)), np.ones((1, 3)) / 2)
    voxels._grow()  # noqa: SLF001 - its kernel
    voxels.octree()
