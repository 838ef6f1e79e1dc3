# SPDX-License-Identifier: MIT
"""Compiled loops that write scans into truncated signed distances; see `slamcli.grids.tsdf_grid` for the layout.

While a scan is drawn, distances that it has already changed carry `MARK`: each cell changes once, by the first beam that
meets it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MARK = 32768
STEPS = 32766.0


@njit(cache=True, nogil=True)
def normals(points, start, num_samples, radius):
    """Return float64 (N,), the heading of the surface's normal at each of `points` (N, 2), which are sorted by bearing.

    It is the mean of the normals to the lines to the nearest points in the order, at most half of `num_samples` on each
    side and none beyond `radius`; all point to `start`. Without any neighbour it is the way back along the beam.
    """
    count = points.shape[0]
    found = np.empty(count)
    for k in range(count):
        back_x, back_y = start[0] - points[k, 0], start[1] - points[k, 1]
        sum_x, sum_y = 0.0, 0.0
        for side in (-1, 1):
            most = num_samples // 2 if side < 0 else (num_samples + 1) // 2
            for step in range(1, most + 1):
                other = k + side * step
                if other < 0 or other >= count:
                    break
                tx, ty = points[k, 0] - points[other, 0], points[k, 1] - points[other, 1]
                distance = math.hypot(tx, ty)
                if distance >= radius:
                    break
                if distance == 0.0:
                    continue
                nx, ny = -ty / distance, tx / distance
                if nx * back_x + ny * back_y < 0.0:
                    nx, ny = -nx, -ny
                sum_x += nx
                sum_y += ny
        if sum_x == 0.0 and sum_y == 0.0:
            sum_x, sum_y = back_x, back_y
        found[k] = math.atan2(sum_y, sum_x)
    return found


@njit(cache=True, nogil=True)
def _bell(x, bandwidth):
    return math.exp(-0.5 * x * x / (bandwidth * bandwidth)) / (math.sqrt(2.0 * math.pi) * bandwidth)


@njit(cache=True, nogil=True)
def add_scan(
    tsd,
    weights,
    origin_x,
    origin_y,
    inverse,
    start,
    points,
    headings,
    truncation,
    most_weight,
    whole_beam,
    along_normal,
    range_exponent,
    angle_bandwidth,
    distance_bandwidth,
    changed,
):
    """Update `tsd` and `weights` (H, W) by beams from `start` to `points` (N, 2), all in the grid's frame.

    `headings` (N,) are those of the normals. `changed` is int64 scratch for a flat index per cell that a beam may cross;
    returns how many of it are used. The grid must hold every beam, prolonged by `truncation`, with a cell around.
    """
    columns = tsd.shape[1]
    count = 0
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - start[0], points[k, 1] - start[1]
        distance = math.hypot(dx, dy)
        if distance < truncation:
            continue
        beam_weight = 1.0
        if angle_bandwidth > 0.0:
            angle = headings[k] - math.atan2(-dy, -dx)
            beam_weight = _bell(math.atan2(math.sin(angle), math.cos(angle)), angle_bandwidth)
        if range_exponent > 0:
            beam_weight /= distance**range_exponent
        if beam_weight == 0.0:
            continue
        first = 0.0 if whole_beam else 1.0 - truncation / distance
        last = 1.0 + truncation / distance
        x0, y0 = (start[0] + first * dx - origin_x) * inverse, (start[1] + first * dy - origin_y) * inverse
        x1, y1 = (start[0] + last * dx - origin_x) * inverse, (start[1] + last * dy - origin_y) * inverse
        nx, ny = math.cos(headings[k]), math.sin(headings[k])
        j, i = math.floor(x0), math.floor(y0)
        left = abs(math.floor(x1) - j) + abs(math.floor(y1) - i)
        step_j, step_i = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        tdx = 1.0 / abs(x1 - x0) if x1 != x0 else math.inf
        tdy = 1.0 / abs(y1 - y0) if y1 != y0 else math.inf
        tx = ((j + 1 - x0) if dx > 0 else (x0 - j)) * tdx if x1 != x0 else math.inf
        ty = ((i + 1 - y0) if dy > 0 else (y0 - i)) * tdy if y1 != y0 else math.inf
        while left >= 0:  # cell after cell along the beam (Amanatides and Woo 1987), its last one too
            value = tsd[i, j]
            if value < MARK:
                cx, cy = origin_x + (j + 0.5) / inverse, origin_y + (i + 0.5) / inverse
                if along_normal:
                    sdf = (cx - points[k, 0]) * nx + (cy - points[k, 1]) * ny
                else:
                    sdf = distance - math.hypot(cx - start[0], cy - start[1])
                sdf = min(max(sdf, -truncation), truncation)
                weight = beam_weight
                if distance_bandwidth > 0.0:
                    weight *= _bell(sdf, distance_bandwidth)
                if weight > 0.0:
                    old = max(weights[i, j] - 1.0, 0.0) * most_weight / STEPS
                    before = (value - 1.0) * 2.0 * truncation / STEPS - truncation if value > 0 else 0.0
                    mean = (before * old + sdf * weight) / (old + weight)
                    tsd[i, j] = np.int64(math.floor((mean + truncation) * STEPS / (2.0 * truncation) + 0.5)) + 1 + MARK
                    new = min(old + weight, most_weight)
                    weights[i, j] = np.int64(math.floor(new * STEPS / most_weight + 0.5)) + 1
                    changed[count] = i * columns + j
                    count += 1
            if tx < ty:
                tx += tdx
                j += step_j
            else:
                ty += tdy
                i += step_i
            left -= 1
    for k in range(count):
        i, j = changed[k] // columns, changed[k] % columns
        tsd[i, j] -= MARK
    return count
