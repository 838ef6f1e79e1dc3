# SPDX-License-Identifier: MIT
"""Compiled loops over tiled maps: looking up, matching, registering.

A map is a table of tile indices (rows, columns); a tile is 32 x 32 cells; a cell holds four float32: visits, hits, and
the summed offset of its hit points from its centre in metres. Tile 0 is always empty. Poses are x, y, yaw of the base
in the map; points are beam end points in the base frame.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TILE = 32
SHIFT = 5
MASK = 31


@njit(cache=True, nogil=True, inline="always")
def _nearest_hit(cells, table, row, column, x, y, window, delta, fullness):
    """Squared distance from (x, y), metres from the map's corner, to the nearest mean hit point in the window, or -1."""
    best = -1.0
    rows, columns = table.shape
    for i in range(row - window, row + window + 1):
        ti = i >> SHIFT
        if i < 0 or ti >= rows:
            continue
        cy = (i + 0.5) * delta
        for j in range(column - window, column + window + 1):
            tj = j >> SHIFT
            if j < 0 or tj >= columns:
                continue
            tile = table[ti, tj]
            if tile == 0:
                continue
            r = i & MASK
            c = j & MASK
            hits = cells[tile, r, c, 1]
            if hits <= 0.0 or hits <= fullness * cells[tile, r, c, 0]:
                continue
            dx = x - ((j + 0.5) * delta + cells[tile, r, c, 2] / hits)
            dy = y - (cy + cells[tile, r, c, 3] / hits)
            d2 = dx * dx + dy * dy
            if best < 0.0 or d2 < best:
                best = d2
    return best


@njit(cache=True, nogil=True)
def score_pose(cells, table, origin_x, origin_y, delta, points, x, y, yaw, window, fullness, sigma):
    """Sum over beams of exp(-d^2 / sigma)."""
    c = math.cos(yaw)
    s = math.sin(yaw)
    bx = x - origin_x
    by = y - origin_y
    total = 0.0
    inverse = 1.0 / delta
    for k in range(points.shape[0]):
        px = bx + c * points[k, 0] - s * points[k, 1]
        py = by + s * points[k, 0] + c * points[k, 1]
        d2 = _nearest_hit(
            cells, table, int(math.floor(py * inverse)), int(math.floor(px * inverse)), px, py, window, delta, fullness
        )
        if d2 >= 0.0:
            total += math.exp(-d2 / sigma)
    return total


@njit(cache=True, nogil=True)
def log_likelihood(cells, table, origin_x, origin_y, delta, points, x, y, yaw, window, fullness, lsigma):
    """Sum over beams of -d^2 / lsigma, -0.5 / lsigma where there is no hit; and the number of beams with one."""
    c = math.cos(yaw)
    s = math.sin(yaw)
    bx = x - origin_x
    by = y - origin_y
    total = 0.0
    found = 0
    inverse = 1.0 / delta
    for k in range(points.shape[0]):
        px = bx + c * points[k, 0] - s * points[k, 1]
        py = by + s * points[k, 0] + c * points[k, 1]
        d2 = _nearest_hit(
            cells, table, int(math.floor(py * inverse)), int(math.floor(px * inverse)), px, py, window, delta, fullness
        )
        if d2 >= 0.0:
            total -= d2 / lsigma
            found += 1
        else:
            total -= 0.5 / lsigma
    return total, found


@njit(cache=True, nogil=True)
def hill_climb(
    cells, table, origin_x, origin_y, delta, points, pose, window, fullness, sigma, lstep, astep, iterations
):
    """Greedy ascent of the score from `pose`: six moves, steps halved when none improves; returns x, y, yaw, score."""
    x, y, yaw = pose[0], pose[1], pose[2]
    current = score_pose(cells, table, origin_x, origin_y, delta, points, x, y, yaw, window, fullness, sigma)
    best = -1.0
    linear = lstep
    angular = astep
    refinement = 0
    while current > best or refinement < iterations:
        if best >= current:
            refinement += 1
            linear *= 0.5
            angular *= 0.5
        best = current
        best_x, best_y, best_yaw = x, y, yaw
        for move in range(6):
            tx, ty, ta = x, y, yaw
            if move == 0:
                tx += linear
            elif move == 1:
                tx -= linear
            elif move == 2:
                ty += linear
            elif move == 3:
                ty -= linear
            elif move == 4:
                ta += angular
            else:
                ta -= angular
            trial = score_pose(cells, table, origin_x, origin_y, delta, points, tx, ty, ta, window, fullness, sigma)
            if trial > current:
                current = trial
                best_x, best_y, best_yaw = tx, ty, ta
        x, y, yaw = best_x, best_y, best_yaw
    return x, y, yaw, current


@njit(cache=True, nogil=True)
def register(cells, table, origin_x, origin_y, delta, starts, ends, hit, pose):
    """Add one scan: cells along each ray are visited, the end cell is hit where `hit` says so; tiles must exist."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    bx = pose[0] - origin_x
    by = pose[1] - origin_y
    inverse = 1.0 / delta
    for k in range(ends.shape[0]):
        x0 = bx + c * starts[k, 0] - s * starts[k, 1]
        y0 = by + s * starts[k, 0] + c * starts[k, 1]
        x1 = bx + c * ends[k, 0] - s * ends[k, 1]
        y1 = by + s * ends[k, 0] + c * ends[k, 1]
        j = int(math.floor(x0 * inverse))
        i = int(math.floor(y0 * inverse))
        je = int(math.floor(x1 * inverse))
        ie = int(math.floor(y1 * inverse))
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
            cells[tile, r, q, 2] += x1 - (je + 0.5) * delta
            cells[tile, r, q, 3] += y1 - (ie + 0.5) * delta


@njit(cache=True, nogil=True)
def touched_tiles(touched, origin_x, origin_y, delta, starts, ends, pose):
    """Mark in `touched` (rows, columns) the tiles that `register` would write to; returns False if one lies outside."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    bx = pose[0] - origin_x
    by = pose[1] - origin_y
    inverse = 1.0 / delta
    rows, columns = touched.shape
    for k in range(ends.shape[0]):
        x0 = bx + c * starts[k, 0] - s * starts[k, 1]
        y0 = by + s * starts[k, 0] + c * starts[k, 1]
        x1 = bx + c * ends[k, 0] - s * ends[k, 1]
        y1 = by + s * ends[k, 0] + c * ends[k, 1]
        j = int(math.floor(x0 * inverse))
        i = int(math.floor(y0 * inverse))
        je = int(math.floor(x1 * inverse))
        ie = int(math.floor(y1 * inverse))
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
