# SPDX-License-Identifier: MIT
"""Kernels for lines across cells; see `slamcli.navigation.path_shape`."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]


@njit(cache=True)
def line_cost(
    levels: Bytes, blocked: Bools, weight: Floats, stride: int, r0: float, c0: float, r1: float, c1: float
) -> float:
    """Return the sum over a line's cells of length inside times weight; inf if it touches a blocked cell.

    levels : uint8 (N,) flat with a border of one cell; points in rows and columns of that grid, centres at whole
    numbers. Where the line passes exactly through a corner, both cells beside it count as touched.
    """
    row, column = int(np.floor(r0 + 0.5)), int(np.floor(c0 + 0.5))
    last_row, last_column = int(np.floor(r1 + 0.5)), int(np.floor(c1 + 0.5))
    dr, dc = r1 - r0, c1 - c0
    length = np.sqrt(dr * dr + dc * dc)
    if blocked[levels[row * stride + column]]:
        return np.inf
    step_r = 1 if dr > 0 else -1
    step_c = 1 if dc > 0 else -1
    next_r = (row + 0.5 * step_r - r0) / dr if dr != 0.0 else np.inf
    next_c = (column + 0.5 * step_c - c0) / dc if dc != 0.0 else np.inf
    delta_r = abs(1.0 / dr) if dr != 0.0 else np.inf
    delta_c = abs(1.0 / dc) if dc != 0.0 else np.inf
    left = abs(last_row - row) + abs(last_column - column)
    at, total = 0.0, 0.0
    while left > 0:
        here = weight[levels[row * stride + column]]
        to_r = row != last_row
        to_c = column != last_column
        if to_r and to_c and abs(next_r - next_c) < 1e-9:
            if blocked[levels[(row + step_r) * stride + column]] or blocked[levels[row * stride + column + step_c]]:
                return np.inf
            total += (next_r - at) * here
            at = next_r
            row, column = row + step_r, column + step_c
            next_r, next_c = next_r + delta_r, next_c + delta_c
            left -= 2
        elif to_r and (next_r < next_c or not to_c):
            total += (next_r - at) * here
            at = next_r
            row, next_r = row + step_r, next_r + delta_r
            left -= 1
        else:
            total += (next_c - at) * here
            at = next_c
            column, next_c = column + step_c, next_c + delta_c
            left -= 1
        if blocked[levels[row * stride + column]]:
            return np.inf
    total += (1.0 - at) * weight[levels[row * stride + column]]
    return total * length


@njit(cache=True)
def path_cost(levels: Bytes, blocked: Bools, weight: Floats, stride: int, points: Floats) -> float:
    """Return the sum of `line_cost` along points (N, 2)."""
    total = 0.0
    for i in range(len(points) - 1):
        total += line_cost(
            levels, blocked, weight, stride, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        )
    return total


@njit(cache=True)
def shortcut(levels: Bytes, blocked: Bools, weight: Floats, stride: int, points: Floats, keep: Bools) -> None:
    """Mark in `keep` (N,) bool the points that remain when stretches become lines that are free and cost no more."""
    count = len(points)
    along = np.zeros(count)
    for i in range(count - 1):
        along[i + 1] = along[i] + line_cost(
            levels, blocked, weight, stride, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        )
    keep[:] = False
    i = 0
    keep[0] = True
    while i < count - 1:
        reach = i + 1
        for j in range(i + 2, count):
            line = line_cost(levels, blocked, weight, stride, points[i, 0], points[i, 1], points[j, 0], points[j, 1])
            if line > along[j] - along[i] + 1e-9:
                break
            reach = j
        i = reach
        keep[i] = True
