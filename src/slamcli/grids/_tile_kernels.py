# SPDX-License-Identifier: MIT
"""Compiled loops that write tiled maps; the layout is described in `slamcli.grids.tiles`.

Poses are x, y, yaw of the base in the map; beams are given by their two ends in the base frame, metres.
"""

from __future__ import annotations

import math

from numba import njit

TILE = 32
SHIFT = 5
MASK = 31


@njit(cache=True, nogil=True)
def register(cells, table, origin_x, origin_y, delta, start, ends, hit, pose):
    """Add one scan: cells along each ray are visited, the end cell is hit where `hit` says so; tiles must exist."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    bx = pose[0] - origin_x
    by = pose[1] - origin_y
    inverse = 1.0 / delta
    for k in range(ends.shape[0]):
        x0 = bx + c * start[0, 0] - s * start[0, 1]
        y0 = by + s * start[0, 0] + c * start[0, 1]
        x1 = bx + c * ends[k, 0] - s * ends[k, 1]
        y1 = by + s * ends[k, 0] + c * ends[k, 1]
        j = math.floor(x0 * inverse)
        i = math.floor(y0 * inverse)
        je = math.floor(x1 * inverse)
        ie = math.floor(y1 * inverse)
        dj = abs(je - j)
        di = abs(ie - i)
        sj = 1 if j < je else -1
        si = 1 if i < ie else -1
        error = dj - di
        while i != ie or j != je:
            tile = table[i >> SHIFT, j >> SHIFT]
            cells[tile, i & MASK, j & MASK, 0] += 1.0
            double = 2 * error
            if double > -di:
                error -= di
                j += sj
            if double < dj:
                error += dj
                i += si
        tile = table[ie >> SHIFT, je >> SHIFT]
        r = ie & MASK
        q = je & MASK
        cells[tile, r, q, 0] += 1.0
        if hit[k]:
            cells[tile, r, q, 1] += 1.0
            share = 1.0 / cells[tile, r, q, 1]
            cells[tile, r, q, 2] += (x1 - je * delta - cells[tile, r, q, 2]) * share
            cells[tile, r, q, 3] += (y1 - ie * delta - cells[tile, r, q, 3]) * share


@njit(cache=True, nogil=True)
def touched_tiles(touched, origin_x, origin_y, delta, start, ends, pose):
    """Mark in `touched` (rows, columns) the tiles that `register` would write to; returns False if one lies outside."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    bx = pose[0] - origin_x
    by = pose[1] - origin_y
    inverse = 1.0 / delta
    rows, columns = touched.shape
    for k in range(ends.shape[0]):
        x0 = bx + c * start[0, 0] - s * start[0, 1]
        y0 = by + s * start[0, 0] + c * start[0, 1]
        x1 = bx + c * ends[k, 0] - s * ends[k, 1]
        y1 = by + s * ends[k, 0] + c * ends[k, 1]
        j = math.floor(x0 * inverse)
        i = math.floor(y0 * inverse)
        je = math.floor(x1 * inverse)
        ie = math.floor(y1 * inverse)
        if min(i, ie) < 0 or min(j, je) < 0 or max(i, ie) >> SHIFT >= rows or max(j, je) >> SHIFT >= columns:
            return False
        dj = abs(je - j)
        di = abs(ie - i)
        sj = 1 if j < je else -1
        si = 1 if i < ie else -1
        error = dj - di
        touched[i >> SHIFT, j >> SHIFT] = 1
        while i != ie or j != je:
            double = 2 * error
            if double > -di:
                error -= di
                j += sj
            if double < dj:
                error += dj
                i += si
            touched[i >> SHIFT, j >> SHIFT] = 1
    return True


@njit(cache=True, nogil=True)
def trinary(cells, table, occ_thresh, out):
    """Write the occupancy of the tiles of a table (R, C) to `out` (32 R, 32 C), which is unknown (-1) where there is no tile.

    A visited cell is occupied (100) where its share of hits is over `occ_thresh` (float32), else free (0).
    """
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            tile = table[i, j]
            if tile == 0:
                continue
            for r in range(TILE):
                for q in range(TILE):
                    visits = cells[tile, r, q, 0]
                    if visits > 0.0:
                        hits = cells[tile, r, q, 1]
                        out[i * TILE + r, j * TILE + q] = 100 if hits > occ_thresh * visits else 0
