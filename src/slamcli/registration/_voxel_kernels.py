# SPDX-License-Identifier: MIT
"""Compiled loops that thin point clouds; see `slamcli.registration.voxel_filter`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def first_in_cell(points, rows, size, kept):
    """Write those of `rows` that come first in their cubic cell into `kept`, in their order, and return how many.

    A hash table with linear probing holds the cells as rows of `cells`, so that no two cells are ever confused. Points
    that are not finite, or further than 2**62 cells away, are left out.
    """
    n, dimensions = len(rows), points.shape[1]
    slots = 16
    while slots < 2 * n:
        slots *= 2
    mask = slots - 1
    table = np.full(slots, -1, np.int64)
    cells = np.empty((n, 3), np.int64)
    count = 0
    for i in range(n):
        inside = True
        for d in range(3):
            scaled = points[rows[i], d] / size if d < dimensions else 0.0
            if not abs(scaled) < 4.6e18:
                inside = False
                break
            cells[count, d] = math.floor(scaled + 0.5)
        if not inside:
            continue
        x, y, z = cells[count, 0], cells[count, 1], cells[count, 2]
        mixed = ((x & 0x7FFFFFFF) * 73856093) ^ ((y & 0x7FFFFFFF) * 19349663) ^ ((z & 0x7FFFFFFF) * 83492791)
        mixed ^= mixed >> 32
        slot = (mixed ^ (mixed >> 17)) & mask
        while table[slot] >= 0:
            other = table[slot]
            if cells[other, 0] == x and cells[other, 1] == y and cells[other, 2] == z:
                break
            slot = (slot + 1) & mask
        if table[slot] < 0:
            table[slot] = count
            kept[count] = rows[i]
            count += 1
    return count


@njit(cache=True, nogil=True)
def within(points, max_range, kept):
    """Write the rows of the points that lie no further than `max_range` from the origin into `kept`; return how many."""
    count = 0
    for i in range(len(points)):
        squares = 0.0
        for d in range(points.shape[1]):
            squares += float(points[i, d]) * float(points[i, d])
        if squares <= max_range * max_range:
            kept[count] = i
            count += 1
    return count


@njit(cache=True, nogil=True)
def largest_cells(points, rows, max_length, min_num_points):
    """Return the rows that the largest cells leave which leave at least `min_num_points`; see `adaptive_voxel_filter`."""
    best = np.empty(len(rows), np.int64)
    trial = np.empty(len(rows), np.int64)
    found = first_in_cell(points, rows, max_length, best)
    if found >= min_num_points:
        return best[:found].copy()
    high = max_length
    while high > 0.01 * max_length:
        low = high / 2.0
        found = first_in_cell(points, rows, low, best)
        if found >= min_num_points:
            while (high - low) / low > 0.1:
                middle = (low + high) / 2.0
                tried = first_in_cell(points, rows, middle, trial)
                if tried >= min_num_points:
                    low = middle
                    best, trial = trial, best
                    found = tried
                else:
                    high = middle
            break
        high /= 2.0
    return best[:found].copy()
