# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.grids.surfel_map`.

A voxel is a row of `sums` (count, sums of x y z, sums of xx xy xz yy yz zz, all about the voxel's centre) and of `planes`
(mean x y z, normal x y z, variance along the normal; variance negative where there is no plane). Its key holds the level in
the two lowest bits and 20 bits for each of x, y, z above them; keys are found in a hash table with linear probing.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HALF = 1 << 19
MASK = (1 << 20) - 1
FEWEST = 6


@njit(cache=True, nogil=True, inline="always")
def _key(x, y, z, size, level):
    i, j, k = math.floor(x / size), math.floor(y / size), math.floor(z / size)
    return (((((i + HALF) & MASK) << 20 | ((j + HALF) & MASK)) << 20 | ((k + HALF) & MASK)) << 2) | level


@njit(cache=True, nogil=True, inline="always")
def _slot(keys, key):
    """The slot that holds `key`, or the free one where it belongs."""
    mask = len(keys) - 1
    mixed = ((key & 0xFFFFFFFF) * 0x45D9F3B) ^ ((key >> 32) * 0x119DE1F3)
    slot = (mixed ^ (mixed >> 29)) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def insert_keys(keys, rows, held):
    """Put the keys `held` (row numbers follow their order) into an empty table."""
    for row in range(len(held)):
        slot = _slot(keys, held[row])
        keys[slot] = held[row]
        rows[slot] = row


@njit(cache=True, nogil=True)
def add_points(points, smallest, levels, capacity, keys, rows, held, sums, planes, fitted, used):
    """Add points (N, 3) to the voxels of all levels; a voxel that holds `capacity` points takes no more.

    Planes are fitted anew wherever the count has grown by half. The caller has made room for N new voxels of each level.
    Returns the number of voxels in use.
    """
    touched = np.empty(len(points) * levels, np.int64)
    count = 0
    for level in range(levels):
        size = smallest * (1 << level)
        for p in range(len(points)):
            x, y, z = float(points[p, 0]), float(points[p, 1]), float(points[p, 2])
            key = _key(x, y, z, size, level)
            slot = _slot(keys, key)
            if keys[slot] == -1:
                keys[slot] = key
                rows[slot] = used
                held[used] = key
                sums[used] = 0.0
                planes[used, 6] = -1.0
                fitted[used] = 0
                used += 1
            row = rows[slot]
            s = sums[row]
            if s[0] >= capacity:
                continue
            x -= (math.floor(x / size) + 0.5) * size
            y -= (math.floor(y / size) + 0.5) * size
            z -= (math.floor(z / size) + 0.5) * size
            s[0] += 1.0
            s[1] += x
            s[2] += y
            s[3] += z
            s[4] += x * x
            s[5] += x * y
            s[6] += x * z
            s[7] += y * y
            s[8] += y * z
            s[9] += z * z
            if s[0] >= FEWEST and (s[0] >= 1.5 * fitted[row] or s[0] == capacity):
                touched[count] = row
                count += 1
    for i in range(count):
        row = touched[i]
        if fitted[row] != sums[row, 0]:
            fitted[row] = np.int64(sums[row, 0])
            _fit(held[row], smallest, sums[row], planes[row])
    return used


@njit(cache=True, nogil=True)
def _fit(key, smallest, s, plane):
    """Fit a plane to a voxel's points: the mean, and the direction in which they are thinnest."""
    size = smallest * (1 << (key & 3))
    n = s[0]
    m = s[1:4] / n
    a = np.empty((3, 3))
    a[0, 0], a[0, 1], a[0, 2] = s[4] / n - m[0] * m[0], s[5] / n - m[0] * m[1], s[6] / n - m[0] * m[2]
    a[1, 1], a[1, 2], a[2, 2] = s[7] / n - m[1] * m[1], s[8] / n - m[1] * m[2], s[9] / n - m[2] * m[2]
    a[1, 0], a[2, 0], a[2, 1] = a[0, 1], a[0, 2], a[1, 2]
    v = np.eye(3)
    _diagonalise(a, v)
    low = 0
    for d in range(1, 3):
        if a[d, d] < a[low, low]:
            low = d
    other, third = a[(low + 1) % 3, (low + 1) % 3], a[(low + 2) % 3, (low + 2) % 3]
    thin, wide = max(a[low, low], 0.0) * n / (n - 3.0), min(other, third)
    plane[6] = -1.0
    # Thin against the voxel's size and against its own second extent: a line or a ball has no plane.
    if thin < 0.003 * size * size + 1e-4 and wide > 9.0 * thin and wide > 0.006 * size * size:
        plane[0] = m[0] + ((((key >> 42) & MASK) - HALF) + 0.5) * size
        plane[1] = m[1] + ((((key >> 22) & MASK) - HALF) + 0.5) * size
        plane[2] = m[2] + ((((key >> 2) & MASK) - HALF) + 0.5) * size
        plane[3], plane[4], plane[5] = v[0, low], v[1, low], v[2, low]
        plane[6] = thin


@njit(cache=True, nogil=True)
def _diagonalise(a, v):
    """Make a symmetric 3 x 3 matrix diagonal by Jacobi rotations; the columns of `v` become its eigenvectors."""
    for _ in range(12):
        off = a[0, 1] * a[0, 1] + a[0, 2] * a[0, 2] + a[1, 2] * a[1, 2]
        if off <= 1e-24 * (a[0, 0] * a[0, 0] + a[1, 1] * a[1, 1] + a[2, 2] * a[2, 2]):
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = v[k, p], v[k, q]
                    v[k, p], v[k, q] = c * x - s * y, s * x + c * y


@njit(cache=True, nogil=True)
def near_rows(held, used, smallest, x, y, z, reach, kept):
    """Write the rows of voxels within `reach` (along each axis) of a point into `kept`; return how many."""
    count = 0
    for row in range(used):
        key = held[row]
        size = smallest * (1 << (key & 3))
        dx = abs(((((key >> 42) & MASK) - HALF) + 0.5) * size - x)
        dy = abs(((((key >> 22) & MASK) - HALF) + 0.5) * size - y)
        dz = abs(((((key >> 2) & MASK) - HALF) + 0.5) * size - z)
        if dx <= reach and dy <= reach and dz <= reach:
            kept[count] = row
            count += 1
    return count
