# SPDX-License-Identifier: MIT
"""An octree of occupancy, as OctoMap has it: sixteen levels, leaves of any of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.occupancy import OccupancyGrid

DEPTH = 16
REACH_CELLS = 1 << (DEPTH - 1)
"""Cells from the origin to each side that the tree holds."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Octree:
    """Leaves of the tree: cubes of known occupancy, none within another."""

    resolution_m: float
    """Edge of the smallest cubes."""
    indices: NDArray[np.int64]
    """int64 (N, 3), of the lowest of the smallest cubes in each leaf: it begins at that multiple of the resolution; x, y, z."""
    edges: NDArray[np.int64]
    """int64 (N,), edge of each leaf in smallest cubes: 1, 2, 4, ..."""
    log_odds: NDArray[np.float32]
    """float32 (N,), of being occupied."""
    ground: NDArray[np.bool_]
    """bool (N,), whether what occupies it is ground."""
    threshold: float = 0.0
    """Log odds from which a leaf is occupied."""

    def __len__(self) -> int:
        """Return the number of leaves."""
        return len(self.indices)

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Bool (N,)."""
        return self.log_odds >= self.threshold

    @property
    def centres_m(self) -> NDArray[np.float64]:
        """float64 (N, 3), metres, map frame."""
        return (self.indices + self.edges[:, None] / 2.0) * self.resolution_m

    def select(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> Octree:
        """Return some of the leaves."""
        return replace(
            self, indices=self.indices[rows], edges=self.edges[rows], log_odds=self.log_odds[rows], ground=self.ground[rows]
        )  # fmt: skip

    def within_reach(self) -> Octree:
        """Return the leaves that the tree's sixteen levels hold."""
        ends = self.indices + self.edges[:, None]
        inside = np.asarray(np.minimum(self.indices + REACH_CELLS, REACH_CELLS - ends).min(axis=1, initial=0) >= 0)
        return self.select(inside)

    def reached_from(self, start_m: NDArray[np.float64], depth: int) -> Octree:
        """Return the tree without free space that no way leads to (``GridGlobal/FloodFillDepth``).

        At `depth` (1 to 16), where a cell is free if all is that is known in it, free cells that do not hang together, face to
        face, with the one at `start_m` (3,), or one of the six beside it, are dropped.
        """
        shift = DEPTH - depth
        cells, inverse = np.unique(self.indices >> shift, axis=0, return_inverse=True)
        highest = np.full(len(cells), -np.inf)
        np.maximum.at(highest, inverse.ravel(), self.log_odds)
        free = highest < self.threshold
        reached = _connected(cells, free, np.floor(start_m / self.resolution_m).astype(np.int64) >> shift)
        return self.select((~free | reached)[inverse.ravel()])

    def projected(self, frame_id: str) -> OccupancyGrid | None:
        """Return the grid of the plane: occupied under obstacles, free where all else is known; None of an empty tree."""
        if not len(self):
            return None
        low = self.indices[:, :2].min(axis=0)
        high = (self.indices[:, :2] + self.edges[:, None]).max(axis=0)
        cells = np.full((high - low)[::-1], OccupancyGrid.UNKNOWN, dtype=np.int8)
        obstacle = self.occupied & ~self.ground
        for value, rows in ((OccupancyGrid.FREE, ~obstacle), (OccupancyGrid.OCCUPIED, obstacle)):
            for edge in np.unique(self.edges[rows]).tolist():
                at = self.indices[rows & (self.edges == edge), :2] - low
                for i in range(edge):
                    for j in range(edge):
                        cells[at[:, 1] + i, at[:, 0] + j] = value
        x, y = (float(value) for value in low * self.resolution_m)
        return OccupancyGrid(cells, self.resolution_m, (x, y, 0.0), frame_id)


def _connected(cells: NDArray[np.int64], free: NDArray[np.bool_], start: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which cells (N, 3), sorted, are free and hang together with the one at `start`."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    low, size = cells.min(axis=0) - 1, cells.max(axis=0) - cells.min(axis=0) + 3
    if not ((start >= low) & (start < low + size)).all():
        return np.zeros(len(cells), dtype=np.bool_)
    strides = np.array([size[1] * size[2], size[2], 1])
    numbers = (cells - low) @ strides
    rows = np.flatnonzero(free)
    firsts, seconds = [], []
    for stride in strides.tolist():
        at = np.minimum(np.searchsorted(numbers, numbers[rows] + stride), len(numbers) - 1)
        beside = (numbers[at] == numbers[rows] + stride) & free[at]
        firsts.append(rows[beside])
        seconds.append(at[beside])
    pairs = np.concatenate(firsts), np.concatenate(seconds)
    links = coo_matrix((np.ones(len(pairs[0]), dtype=np.int8), pairs), shape=(len(cells), len(cells)))
    labels = connected_components(links, directed=False)[1]
    begin = int((start - low) @ strides)
    for offset in (0, *strides.tolist(), *(-strides).tolist()):
        at = min(int(np.searchsorted(numbers, begin + offset)), len(numbers) - 1)
        if numbers[at] == begin + offset and free[at]:
            same: NDArray[np.bool_] = (labels == labels[at]) & free
            return same
    return np.zeros(len(cells), dtype=np.bool_)
