# SPDX-License-Identifier: MIT
"""Compiled loop that compares the beams of a scan with a tiled map; the layout is described in `slamcli.grids.tiles`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TILE = 32
SHIFT = 5
MASK = 31
WALL_SHARE = 0.5
"""Share of hits among the visits of a cell that no beam passes."""
PARTED_CELLS = 5
"""How far from a beam's end a wall must lie to contradict it, cells."""


@njit(cache=True, nogil=True)
def _near_hit(cells, table, i, j, fullness, window):
    """Whether a cell within `window` cells of (i, j) is full."""
    for a in range(i - window, i + window + 1):
        for b in range(j - window, j + window + 1):
            if a < 0 or b < 0 or a >> SHIFT >= table.shape[0] or b >> SHIFT >= table.shape[1]:
                continue
            tile = np.int64(table[a >> SHIFT, b >> SHIFT])
            visits, hits = cells[tile, a & MASK, b & MASK, 0], cells[tile, a & MASK, b & MASK, 1]
            if hits > fullness * visits:
                return True
    return False


@njit(cache=True, nogil=True)
def compare(cells, table, corner_x, corner_y, delta, points, start, pose, fullness, counts):
    """Count into int64 (4,): beams whose ends lie on a surface, in free space, where nothing is known, and beams through walls.

    A cell is free if it was visited at least twice and neither it nor one of the 24 around it is full. Of the last kind are beams that end on the far side of a cell which most beams did not pass, `PARTED_CELLS` before the end.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    sx = (pose[0] + c * start[0] - s * start[1] - corner_x) / delta
    sy = (pose[1] + s * start[0] + c * start[1] - corner_y) / delta
    rows, columns = table.shape
    counts[:] = 0
    for k in range(points.shape[0]):
        ex = (pose[0] + c * points[k, 0] - s * points[k, 1] - corner_x) / delta
        ey = (pose[1] + s * points[k, 0] + c * points[k, 1] - corner_y) / delta
        i, j = math.floor(ey), math.floor(ex)
        kind = 2
        if i >= 0 and j >= 0 and i >> SHIFT < rows and j >> SHIFT < columns:
            if _near_hit(cells, table, i, j, fullness, 1):
                kind = 0
            elif cells[np.int64(table[i >> SHIFT, j >> SHIFT]), i & MASK, j & MASK, 0] >= 2.0 and not _near_hit(
                cells, table, i, j, fullness, 2
            ):
                kind = 1
        counts[kind] += 1
        length = math.sqrt((ex - sx) ** 2 + (ey - sy) ** 2)
        steps = math.floor(length) - PARTED_CELLS
        for q in range(PARTED_CELLS, steps):
            y, x = math.floor(sy + (ey - sy) * q / length), math.floor(sx + (ex - sx) * q / length)
            if y < 0 or x < 0 or y >> SHIFT >= rows or x >> SHIFT >= columns:
                continue
            tile = np.int64(table[y >> SHIFT, x >> SHIFT])
            hits = cells[tile, y & MASK, x & MASK, 1]
            if hits >= 2.0 and hits > WALL_SHARE * cells[tile, y & MASK, x & MASK, 0]:
                counts[3] += 1
                break
