# SPDX-License-Identifier: MIT
"""Kernels of the exact distance field; see `slamcli.grids.distance`."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

_TWICE_OFF = 1.4143
"""Cells: a little more than the square root of two, twice half a diagonal."""


@njit(cache=True)
def column_pass(mask: Bools, far: int, out: Ints) -> None:
    """Write to `out` (H, W) int64 the distance in cells to the next true cell of the same column, `far` if none."""
    height, width = mask.shape
    for column in range(width):
        out[0, column] = 0 if mask[0, column] else far
    for row in range(1, height):
        for column in range(width):
            out[row, column] = 0 if mask[row, column] else min(far, out[row - 1, column] + 1)
    for row in range(height - 2, -1, -1):
        for column in range(width):
            below = out[row + 1, column] + 1
            out[row, column] = min(out[row, column], below)


@njit(cache=True)
def row_pass(columns: Ints, far: int, out: Ints) -> None:
    """Turn column distances (H, W) into squared distances to the next true cell: lower envelope of parabolas per row."""
    height, width = columns.shape
    apex = np.empty(width, dtype=np.int64)
    begin = np.empty(width, dtype=np.int64)
    for row in range(height):
        last = -1
        for column in range(width):
            value = columns[row, column]
            if value >= far:
                continue
            start = 0
            while last >= 0:
                other = apex[last]
                top = columns[row, other]
                # First column at which the new parabola is below the last one (integers, so the ceiling).
                numerator = column * column - other * other + value * value - top * top
                denominator = 2 * (column - other)
                start = max(0, -((-numerator) // denominator))
                if start > begin[last]:
                    break
                last -= 1
                start = 0
            if start < width:
                last += 1
                apex[last] = column
                begin[last] = start
        if last < 0:
            for column in range(width):
                out[row, column] = -1
            continue
        k = last
        for column in range(width - 1, -1, -1):
            while begin[k] > column:
                k -= 1
            other = apex[k]
            dx = column - other
            dy = columns[row, other]
            out[row, column] = dx * dx + dy * dy


@njit(cache=True)
def nearest_true(mask: Bools, row: float, column: float, max_rings: int) -> tuple[int, int]:
    """Return row, column of the true cell nearest to the point (`row`, `column`), fractions of cells; -1, -1 if none.

    Squares grow around the point until no unvisited cell can be nearer. Of equally near cells the first in row order
    of the smallest square wins.
    """
    height, width = mask.shape
    r0, c0 = int(np.floor(row + 0.5)), int(np.floor(column + 0.5))
    best, best_r, best_c = np.inf, -1, -1
    for ring in range(max_rings + 1):
        if (ring - 0.5) * (ring - 0.5) > best and ring > 0:
            break
        for r in range(max(0, r0 - ring), min(height - 1, r0 + ring) + 1):
            inner = abs(r - r0) < ring
            step = max(1, 2 * ring) if inner else 1
            for c in range(c0 - ring, c0 + ring + 1, step):
                if 0 <= c < width and mask[r, c]:
                    distance = (r - row) ** 2 + (c - column) ** 2
                    if distance < best:
                        best, best_r, best_c = distance, r, c
    return best_r, best_c


@njit(cache=True)
def least_square_distance(mask: Bools, rows: Floats, columns: Floats, cells: Ints, near: Floats) -> float:
    """Return the least distance in cells from points to a true cell's square.

    mask : bool (H, W); rows, columns : float64 (N,) points; cells : int64 (N, 2) the cells in which they lie; near : float64
    (N,), increasing, the distance from each of these cells' centres to the nearest true cell's.

    Notes
    -----
    A point is up to 0.71 cells off its cell's centre, and so is a square's edge. So no point is nearer than `near` less
    twice that, and what is nearer than the best so far has its centre within the best and twice that: only such rings are
    looked at, from `near` on, as no true cell is nearer.
    """
    height, width = mask.shape
    best = np.inf
    for i in range(len(rows)):
        if near[i] - _TWICE_OFF > np.sqrt(best):
            break
        r0, c0 = cells[i, 0], cells[i, 1]
        least = near[i] - 1e-6
        most = min(np.sqrt(best), near[i] + 0.5 * _TWICE_OFF) + _TWICE_OFF
        reach = int(most)
        for r in range(max(0, r0 - reach), min(height - 1, r0 + reach) + 1):
            high = (r - r0) * (r - r0)
            outer = int(np.sqrt(max(0.0, most * most - high)))
            inner = int(np.ceil(np.sqrt(max(0.0, least * least - high)))) if least > 0.0 else 0
            dr = max(0.0, abs(r - rows[i]) - 0.5)
            for side in (-1, 1):
                for across in range(inner, outer + 1):
                    c = c0 + side * across
                    if 0 <= c < width and mask[r, c]:
                        dc = max(0.0, abs(c - columns[i]) - 0.5)
                        best = min(best, dr * dr + dc * dc)
    return np.sqrt(best)
