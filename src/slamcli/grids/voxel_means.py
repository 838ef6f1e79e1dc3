# SPDX-License-Identifier: MIT
"""Dense clouds thinned while they grow: what falls into one cell becomes its mean."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MOST_PENDING = 400_000
"""Points that wait to be thinned: bounds memory."""
_BITS = 21
_HALF = 1 << (_BITS - 1)


class VoxelMeans:
    """Means of positions and colours in cubic cells; memory grows with what is seen, not with how often.

    Parameters
    ----------
    size_m
        Edge of a cell. Points more than a million cells from the origin are left out.
    """

    def __init__(self, size_m: float) -> None:
        self._size = size_m
        self._keys = np.empty(0, dtype=np.int64)
        self._sums = np.empty((0, 7))
        self._pending: list[NDArray[np.float64]] = []
        self._num_pending = 0

    def add(self, points_m: NDArray[np.float64], colours: NDArray[np.uint8]) -> None:
        """Take points (N, 3) with their colours (N, 3); those that are not finite are left out."""
        rows = np.column_stack([points_m, colours, np.ones(len(points_m))])
        self._pending.append(rows[(np.abs(points_m) < (_HALF - 1) * self._size).all(axis=1)])
        self._num_pending += len(rows)
        if self._num_pending > _MOST_PENDING:
            self._merge()

    def means(self, least: int = 1) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Return points float32 (M, 3) and colours uint8 (M, 3) of the cells that hold `least` points or more, in the order of the cells."""
        self._merge()
        kept = self._sums[self._sums[:, 6] >= least]
        means = kept[:, :6] / kept[:, 6:]
        return means[:, :3].astype(np.float32), np.rint(means[:, 3:]).astype(np.uint8)

    def _merge(self) -> None:
        if not self._pending:
            return
        fresh = np.concatenate(self._pending)
        cells = np.floor(fresh[:, :3] / self._size).astype(np.int64) + _HALF
        keys = (cells[:, 0] << (2 * _BITS)) | (cells[:, 1] << _BITS) | cells[:, 2]
        self._keys, inverse = np.unique(np.concatenate([self._keys, keys]), return_inverse=True)
        rows = np.concatenate([self._sums, fresh])
        self._sums = np.column_stack(
            [np.bincount(inverse, weights=rows[:, i], minlength=len(self._keys)) for i in range(rows.shape[1])]
        )
        self._pending, self._num_pending = [], 0


def means_of_cells(points: NDArray[np.float64], size_m: float) -> NDArray[np.float64]:
    """Return the mean of the points (N, D) in each cell of edge `size_m`, in the order of the cells."""
    if len(points) == 0:
        return points
    cells = np.floor(points / size_m).astype(np.int64)
    cells -= cells.min(axis=0)
    key = np.zeros(len(points), dtype=np.int64)
    for axis in range(points.shape[1]):
        key = key * (int(cells[:, axis].max()) + 1) + cells[:, axis]
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse, weights=points[:, axis]) for axis in range(points.shape[1])]
    means: NDArray[np.float64] = np.column_stack(sums) / counts[:, None]
    return means
