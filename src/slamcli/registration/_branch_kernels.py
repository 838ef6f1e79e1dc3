# SPDX-License-Identifier: MIT
"""Compiled loops of the branch and bound search in 2D; see `slamcli.registration.branch_and_bound`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def precompute(cells, table, levels):
    """Fill `levels` (depth, H + pad, W + pad) uint8: level h holds the maximum over 2^h x 2^h cells from each cell on.

    Cell (i, j) of the grid is at (i + pad, j + pad), pad = 2^(depth - 1) - 1.
    """
    depth, rows, columns = levels.shape
    pad = (1 << (depth - 1)) - 1
    levels[0] = 0
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            levels[0, i + pad, j + pad] = table[cells[i, j]]
    for h in range(1, depth):
        w = 1 << (h - 1)
        below, level = levels[h - 1], levels[h]
        for i in range(rows):
            for j in range(columns):
                level[i, j] = max(below[i, j], below[i, j + w]) if j + w < columns else below[i, j]
        for i in range(rows - w):
            for j in range(columns):
                level[i, j] = max(level[i, j], level[i + w, j])


@njit(cache=True, nogil=True)
def _sum(level, rows, columns, di, dj, pad):
    """Sum of a level's values at the points moved by (di, dj) cells."""
    total = np.int64(0)
    height, width = level.shape
    di += pad
    dj += pad
    for k in range(rows.shape[0]):
        i, j = rows[k] + di, columns[k] + dj
        if 0 <= i < height and 0 <= j < width:
            total += level[i, j]
    return total


@njit(cache=True, nogil=True)
def search(levels, depth, points, corner_x, corner_y, inverse, prior, half_cells, num_turns, turn_step, least):
    """Best pose in the window with a score over `least`: (score, x, y, yaw); a score of -1 where there is none.

    Depth first over offsets in cells for each of ``2 * num_turns + 1`` headings, upper bounds from the first `depth` levels
    (algorithm 3 of Hess et al., ICRA 2016). Scores are sums of 0..255 over the points. Among equal scores the first wins.
    """
    pad = (1 << (levels.shape[0] - 1)) - 1
    height, width = levels.shape[1] - pad, levels.shape[2] - pad
    n = points.shape[0]
    turns = 2 * num_turns + 1
    rows, columns = np.empty((turns, n), np.int32), np.empty((turns, n), np.int32)
    bounds = np.empty((turns, 4), np.int64)
    step = 1 << (depth - 1)
    count = 0
    for a in range(turns):
        yaw = prior[2] + (a - num_turns) * turn_step
        c, s = math.cos(yaw), math.sin(yaw)
        low_i, low_j, high_i, high_j = 1 << 30, 1 << 30, -(1 << 30), -(1 << 30)
        for k in range(n):
            j = np.int32(math.floor((prior[0] + c * points[k, 0] - s * points[k, 1] - corner_x) * inverse))
            i = np.int32(math.floor((prior[1] + s * points[k, 0] + c * points[k, 1] - corner_y) * inverse))
            rows[a, k], columns[a, k] = i, j
            low_i, high_i, low_j, high_j = min(low_i, i), max(high_i, i), min(low_j, j), max(high_j, j)
        # offsets at which the scan does not touch the grid cannot score
        bounds[a, 0], bounds[a, 1] = max(-half_cells, -high_i), min(half_cells, height - 1 - low_i)
        bounds[a, 2], bounds[a, 3] = max(-half_cells, -high_j), min(half_cells, width - 1 - low_j)
        if bounds[a, 0] <= bounds[a, 1] and bounds[a, 2] <= bounds[a, 3]:
            count += ((bounds[a, 1] - bounds[a, 0]) // step + 1) * ((bounds[a, 3] - bounds[a, 2]) // step + 1)
    scores, where = np.empty(count, np.int64), np.empty((count, 3), np.int64)
    count = 0
    for a in range(turns):
        for di in range(bounds[a, 0], bounds[a, 1] + 1, step):
            for dj in range(bounds[a, 2], bounds[a, 3] + 1, step):
                total = _sum(levels[depth - 1], rows[a], columns[a], di, dj, pad)
                if total > least:
                    scores[count] = total
                    where[count, 0], where[count, 1], where[count, 2] = a, di, dj
                    count += 1
    order = np.argsort(-scores[:count], kind="mergesort")
    best, best_a, best_i, best_j = least, -1, 0, 0
    stack = np.empty((4 * depth + 4, 4), np.int64)
    child = np.empty((4, 3), np.int64)
    for place in order:
        if scores[place] <= best:
            break
        a = where[place, 0]
        size = 1
        stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = scores[place], depth - 1, where[place, 1], where[place, 2]
        while size > 0:
            size -= 1
            total, h, di, dj = stack[size, 0], stack[size, 1], stack[size, 2], stack[size, 3]
            if total <= best:
                continue
            if h == 0:
                best, best_a, best_i, best_j = total, a, di, dj
                continue
            half = 1 << (h - 1)
            found = 0
            for q in range(4):
                i, j = di + (q // 2) * half, dj + (q % 2) * half
                if i > bounds[a, 1] or j > bounds[a, 3]:
                    continue
                value = _sum(levels[h - 1], rows[a], columns[a], i, j, pad)
                if value <= best:
                    continue
                place_in = found
                while place_in > 0 and child[place_in - 1, 0] > value:  # ascending, so that the best is popped first
                    child[place_in] = child[place_in - 1]
                    place_in -= 1
                child[place_in, 0], child[place_in, 1], child[place_in, 2] = value, i, j
                found += 1
            for q in range(found):
                stack[size, 0], stack[size, 1], stack[size, 2], stack[size, 3] = (
                    child[q, 0],
                    h - 1,
                    child[q, 1],
                    child[q, 2],
                )
                size += 1
    if best_a < 0:
        return -1.0, prior[0], prior[1], prior[2]
    yaw = prior[2] + (best_a - num_turns) * turn_step
    return best / (255.0 * n), prior[0] + best_j / inverse, prior[1] + best_i / inverse, yaw
