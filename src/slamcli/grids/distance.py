# SPDX-License-Identifier: MIT
"""Exact Euclidean distances on grids."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import DataError
from slamcli.grids import _distance_kernels as kernels


def squared_distance(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return int64 (H, W), the squared distance in cells from each cell's centre to the nearest true cell's centre.

    Cells are -1 where no true cell exists at all. Exact, in two passes and linear time.

    Raises
    ------
    DataError
        If `mask` is not a two-dimensional bool array.

    References
    ----------
    Meijster, Roerdink, Hesselink: A general algorithm for computing distance transforms in linear time, 2000.
    """
    if mask.ndim != 2 or mask.dtype != np.bool_:
        raise DataError(f"distance field: mask is {mask.dtype} {mask.shape}, not bool (H, W)")
    out = np.empty(mask.shape, dtype=np.int64)
    if mask.size == 0:
        return out
    far = int(sum(mask.shape)) + 1
    columns = np.empty(mask.shape, dtype=np.int64)
    kernels.column_pass(np.ascontiguousarray(mask), far, columns)
    kernels.row_pass(columns, far, out)
    return out


def nearest_cell(mask: NDArray[np.bool_], point_rc: tuple[float, float]) -> tuple[int, int] | None:
    """Return row and column of the true cell whose centre is nearest to a point, None if no cell is true.

    `point_rc` is in cells with centres at whole numbers and may lie outside the grid.
    """
    height, width = mask.shape
    row, column = point_rc
    if not (np.isfinite(row) and np.isfinite(column)):
        raise DataError(f"nearest cell: point {point_rc} is not finite")
    if max(abs(row), abs(column)) > 4 * (height + width):
        found = np.argwhere(mask)
        if not len(found):
            return None
        best = found[np.argmin(((found - np.array([row, column])) ** 2).sum(axis=1))]
        return int(best[0]), int(best[1])
    rings = int(max(abs(row), abs(column), abs(row - height), abs(column - width))) + 2
    r, c = kernels.nearest_true(np.ascontiguousarray(mask), float(row), float(column), rings)
    return None if r < 0 else (int(r), int(c))


def least_distance(mask: NDArray[np.bool_], squared: NDArray[np.int64], points_rc: ArrayLike) -> float:
    """Return the least distance in cells from points to the edge of a true cell; inf if no cell is true.

    Parameters
    ----------
    mask
        bool (H, W).
    squared
        What `squared_distance` gives for `mask`; it tells where to look closely.
    points_rc
        float64 (N, 2), row and column with centres at whole numbers, on the grid.
    """
    points = np.asarray(points_rc, dtype=np.float64).reshape(-1, 2)
    if not len(points) or squared.flat[0] < 0:
        return float("inf")
    cells = np.clip(np.rint(points).astype(np.int64), 0, np.array(mask.shape) - 1)
    near = np.sqrt(squared[cells[:, 0], cells[:, 1]].astype(np.float64))
    # A point is up to 0.71 cells off its cell's centre, and so is the obstacle's edge.
    close = np.flatnonzero(near <= near.min() + 3.0)
    close = close[np.argsort(near[close], kind="stable")]
    rows, columns = np.ascontiguousarray(points[close, 0]), np.ascontiguousarray(points[close, 1])
    return float(kernels.least_square_distance(np.ascontiguousarray(mask), rows, columns, cells[close], near[close]))


def warm() -> None:
    """Compile the kernels of this module."""
    mask = np.eye(3, dtype=np.bool_)
    least_distance(mask, squared_distance(mask), [[0.0, 1.0]])
    nearest_cell(mask, (0.0, 1.0))
