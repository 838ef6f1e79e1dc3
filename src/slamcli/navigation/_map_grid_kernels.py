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
def open_cells(costs, clear_row, clear_col, clear_radius, state):
    """Write to state, (H + 2) * (W + 2): H*W + 1 for cells that can be passed, -1 for blocked ones, -2 around the costmap.

    Cells of cost 253 within `clear_radius` cells of the robot's can be passed (a negative radius: none).
    """
    height, width = costs.shape
    stride = width + 2
    state[:] = -2
    for r in range(height):
        for c in range(width):
            at = (r + 1) * stride + c + 1
            state[at] = height * width + 1
            if costs[r, c] >= INSCRIBED:
                state[at] = -1
    reach = int(clear_radius) if clear_radius >= 0.0 else -1
    for r in range(max(0, clear_row - reach), min(height, clear_row + reach + 1)):
        for c in range(max(0, clear_col - reach), min(width, clear_col + reach + 1)):
            squared = (r - clear_row) * (r - clear_row) + (c - clear_col) * (c - clear_col)
            if costs[r, c] == INSCRIBED and squared <= clear_radius * clear_radius:
                state[(r + 1) * stride + c + 1] = height * width + 1


@njit(cache=True, nogil=True)
def spread(state, height, width, targets, queue, flat, distance):
    """Grow 4-connected distances, cells, from the targets; H*W marks obstacles, H*W + 1 what is not reached.

    `state` is what `open_cells` wrote, `flat` a work array of its size, `distance` the result, (H, W).
    """
    size = height * width
    stride = width + 2
    flat[:] = state
    tail = 0
    for i in range(len(targets)):
        r = targets[i] // width
        at = (r + 1) * stride + targets[i] - r * width + 1
        if flat[at] != 0:
            flat[at] = 0
            queue[tail] = at
            tail += 1
    head = 0
    while head < tail:
        here = queue[head]
        head += 1
        step = flat[here] + 1
        for k in range(4):
            at = here - 1 if k == 0 else here + 1 if k == 1 else here - stride if k == 2 else here + stride
            value = flat[at]
            if value == size + 1:
                flat[at] = step
                queue[tail] = at
                tail += 1
            elif value == -1:
                flat[at] = size
    for r in range(height):
        for c in range(width):
            value = flat[(r + 1) * stride + c + 1]
            distance[r, c] = value if value >= 0 else size + 1


@njit(cache=True, nogil=True)
def box_maximum(costs, radius, rows, out):
    """Write the greatest cost within `radius` cells, in rows and in columns, of each cell."""
    height, width = costs.shape
    for r in range(height):
        for c in range(width):
            rows[r, c] = costs[r, c]
        for shift in range(1, radius + 1):
            for c in range(width - shift):
                rows[r, c] = max(rows[r, c], costs[r, c + shift])
            for c in range(shift, width):
                rows[r, c] = max(rows[r, c], costs[r, c - shift])
    for r in range(height):
        for c in range(width):
            out[r, c] = rows[r, c]
        for k in range(max(0, r - radius), min(height, r + radius + 1)):
            for c in range(width):
                out[r, c] = max(out[r, c], rows[k, c])
