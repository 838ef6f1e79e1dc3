# SPDX-License-Identifier: MIT
"""A map of small planes: the points in each voxel, at several sizes of voxels, summed up as a plane where they lie in one.

References
----------
C. Yuan, W. Xu, X. Liu, X. Hong, F. Zhang, "Efficient and probabilistic adaptive voxel mapping for accurate online LiDAR
odometry", IEEE RA-L 2022, doi:10.1109/LRA.2022.3187250 (planes in voxels of several sizes); M. Magnusson, "The
three-dimensional normal-distributions transform", 2009 (sums of points and of their products).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import _surfel_kernels as kernels

LEVELS_MAX = 4


class SurfelMap:
    """Planes of voxels with edges ``size``, ``2 size`` ... ``2**(levels-1) size`` metres.

    A voxel takes `capacity` points and no more: what was seen first stays, so that a map that is matched against does not
    creep with the matches. The map covers half a million voxels to each side of the origin.
    """

    def __init__(self, size_m: float, levels: int = 3, capacity: int = 100) -> None:
        if not (size_m > 0.0 and 1 <= levels <= LEVELS_MAX and capacity >= kernels.FEWEST):
            raise ValueError(f"surfel map: size {size_m} m, {levels} levels, {capacity} points per voxel")
        self.size_m, self.levels, self.capacity = float(size_m), levels, capacity
        self.keys = np.full(1 << 12, -1, dtype=np.int64)
        self.rows = np.zeros(1 << 12, dtype=np.int64)
        self.planes = np.zeros((1 << 11, 7))
        """float64 (R, 7): mean, normal, variance along it (negative: no plane), by row."""
        self._held = np.zeros(1 << 11, dtype=np.int64)
        self._sums = np.zeros((1 << 11, 10))
        self._fitted = np.zeros(1 << 11, dtype=np.int64)
        self._used = 0

    def __len__(self) -> int:
        """Number of voxels of all levels."""
        return self._used

    def add(self, points_m: NDArray[np.float64]) -> None:
        """Add finite points float64 (N, 3), metres, in the frame of the map."""
        points_m = np.ascontiguousarray(points_m, dtype=np.float64)
        self._reserve(self._used + len(points_m) * self.levels)
        self._used = kernels.add_points(
            points_m, self.size_m, self.levels, self.capacity, self.keys, self.rows, self._held, self._sums, self.planes,
            self._fitted, self._used,
        )  # fmt: skip

    def forget_beyond(self, centre_m: NDArray[np.float64], reach_m: float) -> None:
        """Drop the voxels that lie further than `reach_m` from a point, along any axis."""
        kept = np.empty(self._used, dtype=np.int64)
        count = kernels.near_rows(
            self._held, self._used, self.size_m, float(centre_m[0]), float(centre_m[1]), float(centre_m[2]), reach_m, kept
        )  # fmt: skip
        if count == self._used:
            return
        kept = kept[:count]
        for array in (self._held, self._sums, self.planes, self._fitted):
            array[:count] = array[kept]
        self._used = count
        self._rehash(len(self.keys))

    def _reserve(self, voxels: int) -> None:
        """Make room for `voxels` rows; the table stays at most half full."""
        if voxels > len(self._held):
            rows = max(2 * len(self._held), voxels)
            self._held = np.resize(self._held, rows)
            self._fitted = np.resize(self._fitted, rows)
            self._sums = _grown(self._sums, self._used, rows)
            self.planes = _grown(self.planes, self._used, rows)
        if 2 * voxels > len(self.keys):
            self._rehash(1 << int(2 * voxels - 1).bit_length())

    def _rehash(self, slots: int) -> None:
        self.keys = np.full(slots, -1, dtype=np.int64)
        self.rows = np.zeros(slots, dtype=np.int64)
        kernels.insert_keys(self.keys, self.rows, self._held[: self._used])


def _grown(array: NDArray[np.float64], used: int, rows: int) -> NDArray[np.float64]:
    grown = np.zeros((rows, array.shape[1]))
    grown[:used] = array[:used]
    return grown


def warm() -> None:
    """Compile the kernels of this module."""
    surfels = SurfelMap(1.0, 1)
    surfels.add(np.zeros((1, 3)))
    surfels.forget_beyond(np.full(3, 50.0), 1.0)
