# SPDX-License-Identifier: MIT
"""Thinning of point clouds by a grid of cubic (or square) cells (Hess et al., ICRA 2016, IV)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.registration import _voxel_kernels as kernels

Points = NDArray[Any]


def voxel_filter(points: Points, size: float) -> NDArray[np.int64]:
    """Return the rows of the first point in each cell, in the order of the cloud.

    Parameters
    ----------
    points
        float32 or float64 (N, 2) or (N, 3), metres; points that are not finite are left out.
    size
        Edge of a cell in metres; 0 keeps every finite point.

    Returns
    -------
    int64 (M,), increasing.

    Raises
    ------
    DataError
        If the shape is another, or `size` is negative or not a number.

    Notes
    -----
    Cells are centred on multiples of `size`. Cartographer draws a random point of each cell; the first one makes the result
    depend on the cloud only, and is the one that was measured first.
    """
    points = _checked(points)
    if not size >= 0.0:
        raise DataError(f"voxel filter: a cell of {size} m")
    if size == 0.0:
        return np.flatnonzero(np.isfinite(points).all(axis=1))
    kept = np.empty(len(points), dtype=np.int64)
    count = kernels.first_in_cell(points, np.arange(len(points)), float(size), kept)
    return kept[:count]


def adaptive_voxel_filter(
    points: Points, max_length: float, min_num_points: float, max_range: float
) -> NDArray[np.int64]:
    """Return the rows that the largest cells leave which still leave enough points.

    Points beyond `max_range` of the origin are dropped. If more than `min_num_points` are left, the cell is the largest
    one of at most `max_length` that leaves so many, found by halving (down to a hundredth) and then to a tenth of its size.

    Parameters
    ----------
    points
        float32 or float64 (N, 2) or (N, 3), metres, about the sensor; points that are not finite are left out.
    max_length, min_num_points, max_range
        As Cartographer's ``adaptive_voxel_filter`` names them; metres, a count, metres.

    Returns
    -------
    int64 (M,), increasing.

    Raises
    ------
    DataError
        If the shape of the points is another, or a length is not positive.
    """
    points = _checked(points)
    if not (max_length > 0.0 and max_range > 0.0):
        raise DataError(f"adaptive voxel filter: max_length {max_length} m, max_range {max_range} m must be positive")
    near = np.empty(len(points), dtype=np.int64)
    near = near[: kernels.within(points, float(max_range), near)]
    if len(near) <= min_num_points:
        return near
    rows: NDArray[np.int64] = kernels.largest_cells(points, near, float(max_length), float(min_num_points))
    return rows


def _checked(points: Points) -> Points:
    if points.ndim != 2 or points.shape[1] not in (2, 3) or points.dtype not in (np.float32, np.float64):
        raise DataError(f"voxel filter: points are {points.dtype} {points.shape}, not float (N, 2) or (N, 3)")
    return np.ascontiguousarray(points)


def warm() -> None:
    """Compile the kernels of this module."""
    for dtype in (np.float32, np.float64):
        for dimensions in (2, 3):
            voxel_filter(np.zeros((2, dimensions), dtype=dtype), 1.0)
            adaptive_voxel_filter(np.zeros((2, dimensions), dtype=dtype), 1.0, 1.0, 1.0)
