# SPDX-License-Identifier: MIT
"""Compiled loops that write scans into a probability grid; see `slamcli.grids.probability_grid` for the layout.

A value is 0 (unknown) or 1 to 32767 (a correspondence cost). While a scan is drawn, cells that it has already changed
carry `MARK`, so that each cell changes once, and hits go before misses.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MARK = 32768


@njit(cache=True, nogil=True)
def add_scan(
    cells, origin_x, origin_y, inverse, start, points, misses, pose, hit_table, miss_table, free_space, changed
):
    """Update `cells` (H, W) by one scan: `points` are hits, beams to `misses` only clear; all seen from `pose`.

    `changed` is int64 scratch for flat indices of at least `scratch_size`; returns how many of it are used. The grid must
    hold every beam with a cell around (`ProbabilityGrid.with_room`): nothing is checked here.
    """
    columns = cells.shape[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    sx = (pose[0] + c * start[0] - s * start[1] - origin_x) * inverse
    sy = (pose[1] + s * start[0] + c * start[1] - origin_y) * inverse
    count = 0
    for k in range(points.shape[0]):
        x = (pose[0] + c * points[k, 0] - s * points[k, 1] - origin_x) * inverse
        y = (pose[1] + s * points[k, 0] + c * points[k, 1] - origin_y) * inverse
        i, j = math.floor(y), math.floor(x)
        value = cells[i, j]
        if value < MARK:
            cells[i, j] = hit_table[value] + MARK
            changed[count] = i * columns + j
            count += 1
    if free_space:
        for k in range(points.shape[0] + misses.shape[0]):
            if k < points.shape[0]:
                ex, ey = points[k, 0], points[k, 1]
            else:
                ex, ey = misses[k - points.shape[0], 0], misses[k - points.shape[0], 1]
            x = (pose[0] + c * ex - s * ey - origin_x) * inverse
            y = (pose[1] + s * ex + c * ey - origin_y) * inverse
            count = _clear_ray(cells, sx, sy, x, y, k >= points.shape[0], miss_table, changed, count)
    for k in range(count):
        i, j = changed[k] // columns, changed[k] % columns
        cells[i, j] -= MARK
    return count


@njit(cache=True, nogil=True)
def _clear_ray(cells, x0, y0, x1, y1, with_end, miss_table, changed, count):
    """Lower the probability of each cell that the segment crosses (Amanatides and Woo 1987), its end cell if `with_end`."""
    columns = cells.shape[1]
    j, i = math.floor(x0), math.floor(y0)
    je, ie = math.floor(x1), math.floor(y1)
    dx, dy = x1 - x0, y1 - y0
    step_j, step_i = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    tdx = abs(1.0 / dx) if dx != 0.0 else math.inf
    tdy = abs(1.0 / dy) if dy != 0.0 else math.inf
    tx = ((j + 1 - x0) if dx > 0 else (x0 - j)) * tdx if dx != 0.0 else math.inf
    ty = ((i + 1 - y0) if dy > 0 else (y0 - i)) * tdy if dy != 0.0 else math.inf
    left = abs(je - j) + abs(ie - i)
    while left > 0:
        value = cells[i, j]
        if value < MARK:
            cells[i, j] = miss_table[value] + MARK
            changed[count] = i * columns + j
            count += 1
        if tx < ty:
            tx += tdx
            j += step_j
        else:
            ty += tdy
            i += step_i
        left -= 1
    if with_end:
        value = cells[ie, je]
        if value < MARK:
            cells[ie, je] = miss_table[value] + MARK
            changed[count] = ie * columns + je
            count += 1
    return count


@njit(cache=True, nogil=True)
def scratch_size(start, points, misses, inverse):
    """Return how many cells the beams may cross at most."""
    total = 8
    for k in range(points.shape[0]):
        total += math.ceil((abs(points[k, 0] - start[0]) + abs(points[k, 1] - start[1])) * inverse * 1.4143) + 4
    for k in range(misses.shape[0]):
        total += math.ceil((abs(misses[k, 0] - start[0]) + abs(misses[k, 1] - start[1])) * inverse * 1.4143) + 4
    return np.int64(total)
