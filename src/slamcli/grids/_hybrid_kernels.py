# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.grids.hybrid_blocks`.

A block is 8 x 8 x 8 cells, a row of `cells` (uint16, B x 512, z fastest); blocks are found by a key of 20 bits for each of its
x, y, z in a hash table with linear probing. A cell's highest bit says that this scan has updated it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HALF = 1 << 19
MASK = (1 << 20) - 1
UPDATED = 1 << 15


@njit(cache=True, nogil=True, inline="always")
def _key(x, y, z):
    """The key of the block of a cell."""
    return (((x >> 3) + HALF) & MASK) << 40 | (((y >> 3) + HALF) & MASK) << 20 | (((z >> 3) + HALF) & MASK)


@njit(cache=True, nogil=True, inline="always")
def _slot(keys, key):
    """The slot of a block, or the free one where it belongs."""
    mixed = ((key & 0xFFFFFFFF) * 0x45D9F3B) ^ ((key >> 32) * 0x119DE1F3)
    mask = len(keys) - 1
    slot = (mixed ^ (mixed >> 29)) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True, inline="always")
def _place(x, y, z):
    return (x & 7) << 6 | (y & 7) << 3 | (z & 7)


@njit(cache=True, nogil=True, inline="always")
def _nearest(value):
    """Round half away from zero, as lround does."""
    return math.floor(value + 0.5) if value >= 0.0 else -math.floor(0.5 - value)


@njit(cache=True, nogil=True)
def insert_keys(keys, blocks, held):
    """Put block keys (their rows follow their order) into an empty table."""
    mask = len(keys) - 1
    for row in range(len(held)):
        mixed = ((held[row] & 0xFFFFFFFF) * 0x45D9F3B) ^ ((held[row] >> 32) * 0x119DE1F3)
        slot = (mixed ^ (mixed >> 29)) & mask
        while keys[slot] != -1:
            slot = (slot + 1) & mask
        keys[slot] = held[row]
        blocks[slot] = row


@njit(cache=True, nogil=True)
def insert_scan(origin, points, resolution, free_voxels, hits, misses, keys, blocks, held, cells, changed, used, count,
                num_hits):  # fmt: skip
    """Update the cells of points (N, 3) as hit, then the `free_voxels` cells before each of them as missed.

    Each cell is updated once. Returns (blocks in use, cells changed, of them hits or -1, done). Where room for blocks runs out
    it is not done; called again with more room and these numbers (at first: 0 and -1) it goes on, for what is updated is
    marked. Marks are taken off at the end.
    """
    n, room = len(points), min(len(held), len(keys) // 2)
    last_key, row = -1, 0
    for i in range(n):
        if used + 1 > room:
            return used, count, num_hits, False
        x, y, z = (
            _nearest(points[i, 0] / resolution),
            _nearest(points[i, 1] / resolution),
            _nearest(points[i, 2] / resolution),
        )
        key = _key(x, y, z)
        if key != last_key:  # neighbours in a scan mostly share their block
            slot = _slot(keys, key)
            if keys[slot] == -1:
                keys[slot], blocks[slot], held[used] = key, used, key
                cells[used] = 0
                used += 1
            last_key, row = key, blocks[slot]
        place = _place(x, y, z)
        if cells[row, place] < UPDATED:
            cells[row, place] = hits[cells[row, place]]
            changed[count] = row << 9 | place
            count += 1
    ox, oy, oz = _nearest(origin[0] / resolution), _nearest(origin[1] / resolution), _nearest(origin[2] / resolution)
    # Points in the same cell have the same ray of cells: one of each is enough, which is what `changed` begins with.
    if num_hits < 0:
        num_hits = count
    for i in range(num_hits):
        if used + free_voxels > room:
            return used, count, num_hits, False
        block, place = held[changed[i] >> 9], changed[i] & 511
        dx = (((block >> 40) - HALF) << 3 | place >> 6) - ox
        dy = ((((block >> 20) & MASK) - HALF) << 3 | (place >> 3) & 7) - oy
        dz = (((block & MASK) - HALF) << 3 | place & 7) - oz
        samples = max(abs(dx), abs(dy), abs(dz))
        for position in range(max(0, samples - free_voxels), samples):
            # Integer division rounds toward zero, so that rays of opposite directions are alike.
            x = ox + (1 if dx >= 0 else -1) * (abs(dx) * position // samples)
            y = oy + (1 if dy >= 0 else -1) * (abs(dy) * position // samples)
            z = oz + (1 if dz >= 0 else -1) * (abs(dz) * position // samples)
            key = _key(x, y, z)
            if key != last_key:
                slot = _slot(keys, key)
                if keys[slot] == -1:
                    keys[slot], blocks[slot], held[used] = key, used, key
                    cells[used] = 0
                    used += 1
                last_key, row = key, blocks[slot]
            place = _place(x, y, z)
            if cells[row, place] < UPDATED:
                cells[row, place] = misses[cells[row, place]]
                changed[count] = row << 9 | place
                count += 1
    for i in range(count):
        cells[changed[i] >> 9, changed[i] & 511] -= np.uint16(UPDATED)
    return used, count, num_hits, True


@njit(cache=True, nogil=True)
def set_cells(indices, values, keys, blocks, held, cells, used, first):
    """Set cells (N, 3) from the row `first` on to values; return the blocks in use and the row at which room ran out, or N."""
    room = min(len(held), len(keys) // 2)
    last_key, row = -1, 0
    for i in range(first, len(indices)):
        x, y, z = np.int64(indices[i, 0]), np.int64(indices[i, 1]), np.int64(indices[i, 2])
        key = _key(x, y, z)
        if key != last_key:
            slot = _slot(keys, key)
            if keys[slot] == -1:
                if used + 1 > room:
                    return used, i
                keys[slot], blocks[slot], held[used] = key, used, key
                cells[used] = 0
                used += 1
            last_key, row = key, blocks[slot]
        cells[row, _place(x, y, z)] = values[i]
    return used, len(indices)


@njit(cache=True, nogil=True)
def known_cells(held, cells, used, indices, values):
    """Write index and value of every known cell, block by block; return how many."""
    count = 0
    for row in range(used):
        x, y, z = (held[row] >> 40) - HALF, ((held[row] >> 20) & MASK) - HALF, (held[row] & MASK) - HALF
        for place in range(512):
            if cells[row, place] != 0:
                indices[count, 0] = x << 3 | place >> 6
                indices[count, 1] = y << 3 | (place >> 3) & 7
                indices[count, 2] = z << 3 | place & 7
                values[count] = cells[row, place]
                count += 1
    return count


@njit(cache=True, nogil=True)
def values_at(indices, keys, blocks, cells, out):
    """Write the values of cells (N, 3), 0 where unknown."""
    for i in range(len(indices)):
        x, y, z = indices[i, 0], indices[i, 1], indices[i, 2]
        slot = _slot(keys, _key(x, y, z))
        out[i] = cells[blocks[slot], _place(x, y, z)] if keys[slot] != -1 else 0


@njit(cache=True, nogil=True, inline="always")
def _probability(x, y, z, keys, blocks, cells):
    """The probability of a cell; 0.1 where unknown."""
    slot = _slot(keys, _key(x, y, z))
    if keys[slot] == -1:
        return 0.1
    value = cells[blocks[slot], _place(x, y, z)]
    return 0.1 if value == 0 else 0.1 + (value - 1) * (0.8 / 32766.0)


@njit(cache=True, nogil=True)
def interpolate(points, resolution, keys, blocks, cells, out, gradient):
    """Write probability and gradient (per metre) at points (N, 3), smoothly interpolated between cell centres."""
    p = np.empty((2, 2, 2))
    for i in range(len(points)):
        sx, sy, sz = points[i, 0] / resolution, points[i, 1] / resolution, points[i, 2] / resolution
        x, y, z = math.floor(sx), math.floor(sy), math.floor(sz)
        for a in range(2):
            for b in range(2):
                for c in range(2):
                    p[a, b, c] = _probability(x + a, y + b, z + c, keys, blocks, cells)
        sx, sy, sz = sx - x, sy - y, sz - z
        # Between two cells the value runs as 3 t^2 - 2 t^3, with no slope at the cells: smooth everywhere.
        u, v, w = sx * sx * (3 - 2 * sx), sy * sy * (3 - 2 * sy), sz * sz * (3 - 2 * sz)
        du, dv, dw = 6 * sx * (1 - sx) / resolution, 6 * sy * (1 - sy) / resolution, 6 * sz * (1 - sz) / resolution
        c00, c01 = p[0, 0, 0] + u * (p[1, 0, 0] - p[0, 0, 0]), p[0, 0, 1] + u * (p[1, 0, 1] - p[0, 0, 1])
        c10, c11 = p[0, 1, 0] + u * (p[1, 1, 0] - p[0, 1, 0]), p[0, 1, 1] + u * (p[1, 1, 1] - p[0, 1, 1])
        e0, e1 = c00 + v * (c10 - c00), c01 + v * (c11 - c01)
        out[i] = e0 + w * (e1 - e0)
        d0 = (p[1, 0, 0] - p[0, 0, 0]) + v * ((p[1, 1, 0] - p[0, 1, 0]) - (p[1, 0, 0] - p[0, 0, 0]))
        d1 = (p[1, 0, 1] - p[0, 0, 1]) + v * ((p[1, 1, 1] - p[0, 1, 1]) - (p[1, 0, 1] - p[0, 0, 1]))
        gradient[i, 0] = du * (d0 + w * (d1 - d0))
        gradient[i, 1] = dv * ((c10 - c00) + w * ((c11 - c01) - (c10 - c00)))
        gradient[i, 2] = dw * (e1 - e0)
