# SPDX-License-Identifier: MIT
"""Compiled grids of the dynamic window approach: distances from the plan, greatest cost around a cell."""

from __future__ import annotations

import math

from numba import njit

INSCRIBED = 253
UNKNOWN = 255


@njit(cache=True, nogil=True)
def plan_cells(costs, poses, origin_x, origin_y, resolution, cells):
    """Write the cells of a plan until it leaves the costmap; return how many there are, -1 if `cells` is too short."""
    height, width = costs.shape
    count = 0
    for i in range(len(poses)):
        steps = 1
        dx = 0.0
        dy = 0.0
        if i > 0:
            dx = poses[i, 0] - poses[i - 1, 0]
            dy = poses[i, 1] - poses[i - 1, 1]
            length = math.sqrt(dx * dx + dy * dy)
            if length > resolution:
                steps = math.ceil(length / resolution)
        for j in range(1, steps + 1):
            share = (j - steps) / steps
            c = math.floor((poses[i, 0] + share * dx - origin_x) / resolution)
            r = math.floor((poses[i, 1] + share * dy - origin_y) / resolution)
            inside = r >= 0 and c >= 0 and r < height and c < width
            if inside and costs[r, c] != UNKNOWN:
                if count == len(cells):
                    return -1
                cells[count] = r * width + c
                count += 1
            elif count > 0:
                return count
    return count


@njit(cache=True, nogil=True)
def spread(costs, targets, clear_row, clear_col, clear_radius, queue, distance):
    """Grow 4-connected distances, cells, from the targets; H*W marks obstacles, H*W + 1 what is not reached.

    Cells of cost 253 within `clear_radius` cells of the robot's are passed (a negative radius: none).
    """
    height, width = costs.shape
    size = height * width
    for r in range(height):
        for c in range(width):
            distance[r, c] = size + 1
    head = 0
    tail = 0
    for i in range(len(targets)):
        r = targets[i] // width
        c = targets[i] - r * width
        if distance[r, c] != 0:
            distance[r, c] = 0
            queue[tail] = targets[i]
            tail += 1
    while head < tail:
        here = queue[head]
        head += 1
        r0 = here // width
        c0 = here - r0 * width
        step = distance[r0, c0] + 1
        for k in range(4):
            r = r0
            c = c0
            if k == 0:
                c = c0 - 1
            elif k == 1:
                c = c0 + 1
            elif k == 2:
                r = r0 - 1
            else:
                r = r0 + 1
            if r < 0 or c < 0 or r >= height or c >= width or distance[r, c] != size + 1:
                continue
            cost = costs[r, c]
            if cost >= INSCRIBED:
                dr = r - clear_row
                dc = c - clear_col
                if cost != INSCRIBED or clear_radius < 0.0 or dr * dr + dc * dc > clear_radius * clear_radius:
                    distance[r, c] = size
                    continue
            distance[r, c] = step
            queue[tail] = r * width + c
            tail += 1


@njit(cache=True, nogil=True)
def box_maximum(costs, radius, rows, out):
    """Write the greatest cost within `radius` cells, in rows and in columns, of each cell."""
    height, width = costs.shape
    for r in range(height):
        for c in range(width):
            best = 0
            for k in range(max(0, c - radius), min(width, c + radius + 1)):
                value = costs[r, k]
                if value > best:
                    best = value
            rows[r, c] = best
    for r in range(height):
        for c in range(width):
            out[r, c] = 0
        for k in range(max(0, r - radius), min(height, r + radius + 1)):
            for c in range(width):
                if rows[k, c] > out[r, c]:
                    out[r, c] = rows[k, c]
