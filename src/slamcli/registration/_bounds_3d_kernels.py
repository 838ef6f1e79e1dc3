# SPDX-License-Identifier: MIT
"""Compiled loops of the branch and bound in three dimensions; see `slamcli.registration.branch_and_bound_3d`.

All levels share one table: a key holds the level above 18 bits for each of a block's x, y, z. A block is 8 x 8 x 8 cells of
uint8, z fastest: probabilities 0.1 to 0.9 as 0 to 255.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HALF = 1 << 17
MASK = (1 << 18) - 1


@njit(cache=True, nogil=True, inline="always")
def _slot(keys, level, x, y, z):
    """The slot of the block of a cell of one level, or the free one where it belongs."""
    key = ((level << 18 | (((x >> 3) + HALF) & MASK)) << 18 | (((y >> 3) + HALF) & MASK)) << 18
    key |= ((z >> 3) + HALF) & MASK
    mixed = ((key & 0xFFFFFFFF) * 0x45D9F3B) ^ ((key >> 32) * 0x119DE1F3)
    mask = len(keys) - 1
    slot = (mixed ^ (mixed >> 29)) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot, key


@njit(cache=True, nogil=True)
def _grown(keys, held, cells, used):
    """Twice the room."""
    rows = 2 * len(held)
    new_held, new_cells = np.zeros(rows, np.int64), np.zeros((rows, 512), np.uint8)
    new_held[:used], new_cells[:used] = held[:used], cells[:used]
    new_keys, new_blocks = np.full(2 * len(keys), -1, np.int64), np.zeros(2 * len(keys), np.int64)
    mask = len(new_keys) - 1
    for row in range(used):
        mixed = ((held[row] & 0xFFFFFFFF) * 0x45D9F3B) ^ ((held[row] >> 32) * 0x119DE1F3)
        slot = (mixed ^ (mixed >> 29)) & mask
        while new_keys[slot] != -1:
            slot = (slot + 1) & mask
        new_keys[slot], new_blocks[slot] = held[row], row
    return new_keys, new_blocks, new_held, new_cells


@njit(cache=True, nogil=True)
def build(indices, values, depth, full_depth):
    """Return the table (keys, blocks, cells) of `depth` levels of window maxima over cells (N, 3) with uint8 values.

    Level h holds, for each cell, the maximum over the 2^h cells from it along each axis; from level `full_depth` on a cell is
    2^(h - full_depth + 1) cells wide and holds the maximum of what its cells would hold.
    """
    keys, blocks = np.full(1 << 12, -1, np.int64), np.zeros(1 << 12, np.int64)
    held, cells = np.zeros(1 << 11, np.int64), np.zeros((1 << 11, 512), np.uint8)
    used = 0
    for i in range(len(indices)):
        if used + 1 > len(held) or 2 * (used + 1) > len(keys):
            keys, blocks, held, cells = _grown(keys, held, cells, used)
        x, y, z = np.int64(indices[i, 0]), np.int64(indices[i, 1]), np.int64(indices[i, 2])
        slot, key = _slot(keys, 0, x, y, z)
        if keys[slot] == -1:
            keys[slot], blocks[slot], held[used] = key, used, key
            used += 1
        cells[blocks[slot], (x & 7) << 6 | (y & 7) << 3 | (z & 7)] = values[i]
    first, width = 0, 1
    for level in range(1, depth):
        last = used
        halve = 1 if level >= full_depth else 0
        for row in range(first, last):
            bx = ((held[row] >> 36) & MASK) - HALF
            by = ((held[row] >> 18) & MASK) - HALF
            bz = (held[row] & MASK) - HALF
            for place in range(512):
                value = cells[row, place]
                if value == 0:
                    continue
                if used + 8 > len(held) or 2 * (used + 8) > len(keys):
                    keys, blocks, held, cells = _grown(keys, held, cells, used)
                for octant in range(8):
                    x = (bx << 3 | place >> 6) - (octant & 1) * width >> halve
                    y = (by << 3 | (place >> 3) & 7) - (octant >> 1 & 1) * width >> halve
                    z = (bz << 3 | place & 7) - (octant >> 2) * width >> halve
                    slot, key = _slot(keys, level, x, y, z)
                    if keys[slot] == -1:
                        keys[slot], blocks[slot], held[used] = key, used, key
                        used += 1
                    place_to = (x & 7) << 6 | (y & 7) << 3 | (z & 7)
                    if cells[blocks[slot], place_to] < value:
                        cells[blocks[slot], place_to] = value
        first = last
        # The next window is twice as wide; cells that have just been halved see it as wide as this one.
        width = width if halve else 2 * width
    return keys, blocks, cells


@njit(cache=True, nogil=True)
def _bound(points, ox, oy, oz, level, shrink, keys, blocks, cells, worst):
    """The sum of the level's values at points (N, 3), cell indices, moved by an offset; -1 as soon as it misses `worst`."""
    n = len(points)
    total = 0
    for i in range(n):
        x, y, z = points[i, 0] + ox >> shrink, points[i, 1] + oy >> shrink, points[i, 2] + oz >> shrink
        slot, _ = _slot(keys, level, x, y, z)
        if keys[slot] != -1:
            total += np.int64(cells[blocks[slot], (x & 7) << 6 | (y & 7) << 3 | (z & 7)])
        if total + 255 * (n - 1 - i) <= worst:
            return -1
    return total


@njit(cache=True, nogil=True)
def discretise(points, rotations, shift, resolution, out):
    """Write the cells (K, N, 3) in which points (N, 3) lie, turned by each of K rotations and then shifted."""
    for k in range(len(rotations)):
        r = rotations[k]
        for i in range(len(points)):
            a, b, c = points[i, 0], points[i, 1], points[i, 2]
            for d in range(3):
                at = r[d, 0] * a + r[d, 1] * b + r[d, 2] * c + shift[d]
                out[k, i, d] = math.floor(at / resolution + 0.5)


@njit(cache=True, nogil=True)
def _mean_of_low(points, rotation, shift, resolution, keys, blocks, cells):
    """The mean probability of a `HybridBlocks` at moved points; its layout has 20 bits per axis."""
    total = 0.0
    mask = len(keys) - 1
    for i in range(len(points)):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = math.floor((rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c + shift[0]) / resolution + 0.5)
        y = math.floor((rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c + shift[1]) / resolution + 0.5)
        z = math.floor((rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c + shift[2]) / resolution + 0.5)
        key = (((x >> 3) + 524288) & 1048575) << 40 | (((y >> 3) + 524288) & 1048575) << 20
        key |= ((z >> 3) + 524288) & 1048575
        mixed = ((key & 0xFFFFFFFF) * 0x45D9F3B) ^ ((key >> 32) * 0x119DE1F3)
        slot = (mixed ^ (mixed >> 29)) & mask
        while keys[slot] != -1 and keys[slot] != key:
            slot = (slot + 1) & mask
        value = 0
        if keys[slot] != -1:
            value = cells[blocks[slot], (x & 7) << 6 | (y & 7) << 3 | (z & 7)]
        total += 0.1 if value == 0 else 0.1 + (value - 1) * (0.8 / 32766.0)
    return total / max(len(points), 1)


@njit(cache=True, nogil=True)
def search(scans, rotations, shift, resolution, window_xy, window_z, depth, full_depth, min_score, keys, blocks, cells,
           low_points, low_resolution, low_keys, low_blocks, low_cells, min_low_score):  # fmt: skip
    """Depth-first branch and bound over turns and offsets (cells); the best offset that the low resolution confirms.

    Returns (score, turn, offset x, y, z, low-resolution score, bounds computed, leaves that the low resolution refused); the
    score is negative if nothing passed.
    """
    n = scans.shape[1]
    worst = math.floor((min_score - 0.1) / 0.8 * 255.0 * n)
    best = (-1.0, 0, 0, 0, 0, 0.0)
    computed, refused = 0, 0
    top = depth - 1
    step = 1 << top
    room = len(scans) * ((2 * window_xy) // step + 1) ** 2 * ((2 * window_z) // step + 1)
    first = np.empty((room, 5), np.int64)
    count = 0
    for turn in range(len(scans)):
        for ox in range(-window_xy, window_xy + 1, step):
            for oy in range(-window_xy, window_xy + 1, step):
                for oz in range(-window_z, window_z + 1, step):
                    total = _bound(
                        scans[turn], ox, oy, oz, top, max(0, top - full_depth + 1), keys, blocks, cells, worst
                    )  # fmt: skip
                    computed += 1
                    if total > worst:
                        first[count, 0], first[count, 1] = total, turn
                        first[count, 2], first[count, 3], first[count, 4] = ox, oy, oz
                        count += 1
    order = np.argsort(-first[:count, 0], kind="mergesort")
    stack = np.empty((8 * depth + 8, 6), np.int64)
    shifted = np.empty(3)
    children = np.empty((8, 5), np.int64)
    for place in order:
        if first[place, 0] <= worst:
            break
        stack[0, :5], stack[0, 5] = first[place], top
        height = 1
        while height > 0:
            height -= 1
            total, turn, ox, oy, oz, level = stack[height]
            if total <= worst:
                continue
            if level == 0:
                for d in range(3):
                    shifted[d] = shift[d] + stack[height, 2 + d] * resolution
                low = _mean_of_low(
                    low_points, rotations[turn], shifted, low_resolution, low_keys, low_blocks, low_cells
                )  # fmt: skip
                if low >= min_low_score:
                    worst = total
                    best = (0.1 + 0.8 * total / (255.0 * n), turn, ox, oy, oz, low)
                else:
                    refused += 1
                continue
            half = 1 << (level - 1)
            found = 0
            for octant in range(8):
                x, y, z = ox + (octant & 1) * half, oy + (octant >> 1 & 1) * half, oz + (octant >> 2) * half
                if x > window_xy or y > window_xy or z > window_z:
                    continue
                bound = _bound(
                    scans[turn], x, y, z, level - 1, max(0, level - full_depth), keys, blocks, cells, worst
                )  # fmt: skip
                computed += 1
                if bound > worst:
                    at = found  # sorted so that the best child comes last, on top of the stack; of equals the first
                    while at > 0 and children[at - 1, 0] >= bound:
                        children[at] = children[at - 1]
                        at -= 1
                    children[at, 0], children[at, 1] = bound, octant
                    children[at, 2], children[at, 3], children[at, 4] = x, y, z
                    found += 1
            for at in range(found):
                stack[height, 0], stack[height, 1] = children[at, 0], turn
                stack[height, 2:5], stack[height, 5] = children[at, 2:5], level - 1
                height += 1
    return best, computed, refused
