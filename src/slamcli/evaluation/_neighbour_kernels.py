# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.evaluation.neighbourhoods`."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _find(keys, key):
    """Return the first place in `keys` (U,) whose value is not below `key`."""
    low, high = 0, len(keys)
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def moments(
    points, looks, stamps, keys, starts, columns, queries, cells, radius, gap, side, near_sums, other_sums, nearest
):
    """Add up the neighbours of each query within `radius`: those of its own visit, and those of other visits.

    Parameters
    ----------
    points, looks, stamps
        float64 (P, 3), float64 (P, 3), unit vectors towards where each was seen from, and int64 (P,), in the order of their cells.
    keys, starts
        int64 (U,) and (U + 1,): the cells that have points (row * columns + column), and where each begins.
    columns
        Number of columns of the grid of cells, whose cells are as wide as the radius.
    queries, cells
        int64 (Q,) and (Q, 2): indices of points, and row and column of their cells.
    radius, gap
        Metres, and the time from which on a point is of another visit, nanoseconds.
    side
        Points whose direction of sight has a smaller cosine with the query's are left out: they are the other side of a thin wall.
    near_sums, other_sums
        float64 (Q, 10), out: number, sum of x, y, z relative to the query, sums of xx, xy, xz, yy, yz, zz.
    nearest
        float64 (Q,), out: distance to the nearest point of another visit, infinity where none is within the radius.
    """
    limit = radius * radius
    for q in range(len(queries)):
        own = queries[q]
        best = np.inf
        for row in range(cells[q, 0] - 1, cells[q, 0] + 2):
            first = row * columns + cells[q, 1] - 1
            place = _find(keys, first)
            while place < len(keys) and keys[place] <= first + 2:
                for i in range(starts[place], starts[place + 1]):
                    x, y, z = (
                        points[i, 0] - points[own, 0],
                        points[i, 1] - points[own, 1],
                        points[i, 2] - points[own, 2],
                    )
                    square = x * x + y * y + z * z
                    if square > limit:
                        continue
                    if looks[i, 0] * looks[own, 0] + looks[i, 1] * looks[own, 1] + looks[i, 2] * looks[own, 2] < side:
                        continue
                    other = abs(stamps[i] - stamps[own]) > gap
                    sums = other_sums if other else near_sums
                    sums[q, 0] += 1.0
                    sums[q, 1] += x
                    sums[q, 2] += y
                    sums[q, 3] += z
                    sums[q, 4] += x * x
                    sums[q, 5] += x * y
                    sums[q, 6] += x * z
                    sums[q, 7] += y * y
                    sums[q, 8] += y * z
                    sums[q, 9] += z * z
                    if other and square < best:
                        best = square
                place += 1
        nearest[q] = np.sqrt(best)
