# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.grids.voxel_rays` and `slamcli.grids.voxel_odds`.

Cells are numbered ``x + HALF << 42 | y + HALF << 21 | z + HALF``, each of x, y, z from -HALF to HALF - 1. Tables are hash tables
with linear probing, empty where -1, their length a power of two.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HALF = 1 << 20
MASK = (1 << 21) - 1


@njit(cache=True, nogil=True, inline="always")
def _number(x, y, z):
    return (x + HALF) << 42 | (y + HALF) << 21 | (z + HALF)


@njit(cache=True, nogil=True, inline="always")
def _slot(table, key):
    """The slot of a number, or the free one where it belongs."""
    mixed = ((key & 0x7FFFFFFF) * 0x45D9F3B) ^ ((key >> 31) * 0x119DE1F3)
    mask = len(table) - 1
    slot = (mixed ^ (mixed >> 29)) & mask
    while table[slot] != -1 and table[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def _larger(table):
    """A table of twice the size with the same numbers."""
    wide = np.full(2 * len(table), -1, np.int64)
    for i in range(len(table)):
        if table[i] != -1:
            wide[_slot(wide, table[i])] = table[i]
    return wide


@njit(cache=True, nogil=True)
def trace_space(start, ends, num_hits):
    """Return the numbers, in the order in which they were met, of the cells from `start` (3,) up to each of `ends` (N, 3).

    Positions are in cells. The cells of the first `num_hits` ends are left out, whichever ray meets them.
    """
    size = 1 << 12
    while size < 4 * num_hits:
        size *= 2
    table = np.full(size, -1, np.int64)
    for n in range(num_hits):
        key = _number(math.floor(ends[n, 0]), math.floor(ends[n, 1]), math.floor(ends[n, 2]))
        table[_slot(table, key)] = key
    met = np.empty(size // 4, np.int64)
    count = 0
    cell, last, step = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    following, spacing = np.empty(3), np.empty(3)
    for n in range(len(ends)):
        left = 1
        for a in range(3):
            cell[a], last[a] = math.floor(start[a]), math.floor(ends[n, a])
            left += abs(last[a] - cell[a])
            d = ends[n, a] - start[a]
            step[a] = 1 if d > 0.0 else -1
            spacing[a] = abs(1.0 / d) if d != 0.0 else np.inf
            following[a] = (cell[a] + (1 if d > 0.0 else 0) - start[a]) / d if d != 0.0 else np.inf
        while left > 0:
            left -= 1
            key = _number(cell[0], cell[1], cell[2])
            slot = _slot(table, key)
            if table[slot] == -1:
                table[slot] = key
                met[count] = key
                count += 1
                if count == len(met):
                    wide = np.empty(2 * len(met), np.int64)
                    wide[:count] = met
                    met = wide
                    table = _larger(table)
            # The nearest border, but never one beyond the end.
            best = -1
            for a in range(3):
                if cell[a] != last[a] and (best < 0 or following[a] < following[best]):
                    best = a
            if best >= 0:
                cell[best] += step[best]
                following[best] += spacing[best]
    return met[:count]


@njit(cache=True, nogil=True)
def update_cells(numbers, change, least, most, kind, view, table, rows, held, odds, kinds, views, used, done):
    """Add `change` to the log odds of cells that this view has not changed yet, and limit them; unknown ones (NaN) begin at 0.

    Parameters
    ----------
    numbers
        int64 (N,).
    kind
        What the cells become in `kinds`; -1: they keep what they are.
    table, rows
        int64 (T,), numbers of blocks of 8 x 8 x 8 cells, and their rows in the next.
    held
        int64 (B,), numbers of blocks by row.
    odds, kinds, views
        float32, int8 and int32 (B, 512), z fastest; `views` is which view changed a cell last.
    used, done
        Rows in use, and how many of `numbers` were done in an earlier call.

    Returns
    -------
    Rows in use, and how many numbers are done: fewer than N where there is no room for another block.
    """
    last_block, row = -1, 0
    for i in range(done, len(numbers)):
        x, y, z = (numbers[i] >> 42) - HALF, ((numbers[i] >> 21) & MASK) - HALF, (numbers[i] & MASK) - HALF
        block = _number(x >> 3, y >> 3, z >> 3)
        if block != last_block:
            slot = _slot(table, block)
            if table[slot] == -1:
                if used == len(held) or 2 * (used + 1) > len(table):
                    return used, i
                table[slot], rows[slot], held[used] = block, used, block
                odds[used] = np.nan
                kinds[used] = 0
                views[used] = -1
                used += 1
            last_block, row = block, rows[slot]
        place = (x & 7) << 6 | (y & 7) << 3 | (z & 7)
        if views[row, place] == view:
            continue
        views[row, place] = view
        before = odds[row, place]
        value = change if np.isnan(before) else before + change
        odds[row, place] = min(max(value, least), most)
        if kind >= 0:
            kinds[row, place] = kind
    return used, len(numbers)


@njit(cache=True, nogil=True)
def put_blocks(table, rows, held):
    """Put the numbers of blocks into an empty table; their rows follow their order."""
    for row in range(len(held)):
        slot = _slot(table, held[row])
        table[slot], rows[slot] = held[row], row


@njit(cache=True, nogil=True)
def known_cells(held, odds, kinds, indices, values, what):
    """Write index (N, 3), log odds (N,) and kind (N,) of every known cell, block by block; return how many there are."""
    count = 0
    for row in range(len(held)):
        x, y, z = (held[row] >> 42) - HALF, ((held[row] >> 21) & MASK) - HALF, (held[row] & MASK) - HALF
        for place in range(512):
            if not np.isnan(odds[row, place]):
                indices[count, 0] = x << 3 | place >> 6
                indices[count, 1] = y << 3 | (place >> 3) & 7
                indices[count, 2] = z << 3 | place & 7
                values[count] = odds[row, place]
                what[count] = kinds[row, place]
                count += 1
    return count
