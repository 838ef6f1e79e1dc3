# SPDX-License-Identifier: MIT
"""Compiled loops of the obstacle layer: beams that clear, points that mark, the robot's outline; and of rotated static maps.

Cells are those of costmap_2d: a beam goes from cell to cell as J. E. Bresenham has it ("Algorithm for computer control of a digital
plotter", IBM Systems Journal 1965), one step per column or row, whichever it crosses more of.
`touched` (4,) int64 is grown by what a kernel wrote to: first and last row plus one, first and last column plus one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def touch(touched, row, column):
    """Let the box `touched` hold a cell."""
    touched[0], touched[1] = min(touched[0], row), max(touched[1], row + 1)
    touched[2], touched[3] = min(touched[2], column), max(touched[3], column + 1)


@njit(cache=True, nogil=True)
def fill_line(costs, row, column, last_row, last_column, most_cells, least_cells, value, touched):
    """Write `value` from a cell towards another, both included, from `least_cells` on and no farther than `most_cells`."""
    d_row, d_column = last_row - row, last_column - column
    rows, columns = abs(d_row), abs(d_column)
    step_row, step_column = (1 if d_row > 0 else -1), (1 if d_column > 0 else -1)
    length = math.hypot(d_row, d_column)
    if length < least_cells:
        return
    scale = min(1.0, most_cells / length) if length > 0.0 else 1.0
    first = math.ceil(least_cells / length * max(rows, columns)) if least_cells > 0.0 and length > 0.0 else 0
    steep = rows > columns
    along, across = (rows, columns) if steep else (columns, rows)
    steps = int(scale * along)
    error = along // 2
    for step in range(steps + 1):
        if step >= first:
            costs[row, column] = value
            if step in (first, steps):
                touch(touched, row, column)
        error += across
        over = along > 0 and error >= along
        if over:
            error -= along
        if steep or over:
            row += step_row
        if not steep or over:
            column += step_column


@njit(cache=True, nogil=True)
def clear_beams(costs, origin, ends, corner, resolution, most_m, least_m, touched):
    """Free the cells along beams from `origin` (3,) to `ends` (N, 3), metres; the corner of cell (0, 0) is at `corner` (2,).

    Beams are cut where they leave the map; nothing happens if they begin outside. Return whether they begin inside.
    """
    height, width = costs.shape
    x0, y0 = (origin[0] - corner[0]) / resolution, (origin[1] - corner[1]) / resolution
    if not (0.0 <= x0 < width and 0.0 <= y0 < height):
        return False
    most, least = float(math.ceil(most_m / resolution)), least_m / resolution
    for n in range(len(ends)):
        x1, y1 = (ends[n, 0] - corner[0]) / resolution, (ends[n, 1] - corner[1]) / resolution
        share = 1.0
        if x1 < 0.0:
            share = min(share, -x0 / (x1 - x0))
        if y1 < 0.0:
            share = min(share, -y0 / (y1 - y0))
        if x1 > width:
            share = min(share, (width - x0) / (x1 - x0))
        if y1 > height:
            share = min(share, (height - y0) / (y1 - y0))
        column = min(max(int(x0 + (x1 - x0) * share), 0), width - 1)
        row = min(max(int(y0 + (y1 - y0) * share), 0), height - 1)
        fill_line(costs, int(y0), int(x0), row, column, most, least, 0, touched)
    return True


@njit(cache=True, nogil=True)
def mark_points(costs, origin, points, corner, resolution, most_m, least_m, low_m, high_m, touched):
    """Make cells lethal that hold `points` (N, 3) between `low_m` and `high_m` high and `least_m` to below `most_m` from `origin` (3,)."""
    height, width = costs.shape
    most, least = most_m * most_m, least_m * least_m
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if z > high_m or z < low_m:
            continue
        squared = (x - origin[0]) ** 2 + (y - origin[1]) ** 2 + (z - origin[2]) ** 2
        if squared >= most or squared < least:
            continue
        column, row = (x - corner[0]) / resolution, (y - corner[1]) / resolution
        if 0.0 <= column < width and 0.0 <= row < height:
            costs[int(row), int(column)] = 254
            touch(touched, int(row), int(column))


@njit(cache=True, nogil=True)
def project_scan(ranges, first_rad, step_rad, pose, near_m, limit_m, height_m, valid, points, nothing):
    """Write the ends of a scan's beams to `points` (N, 3), and of those that met nothing to `nothing` (N, 3) if that is `valid`.

    `ranges` (N,) float32, metres; `pose` (3,) of the scanner. Return how many there are of both.
    """
    met, clear = 0, 0
    for k in range(len(ranges)):
        distance = float(ranges[k])
        if near_m <= distance < limit_m:
            out, row = points, met
            met += 1
        elif valid and distance >= limit_m:
            out, row = nothing, clear
            distance = limit_m - 1e-4
            clear += 1
        else:
            continue
        angle = first_rad + k * step_rad + pose[2]
        out[row, 0] = pose[0] + distance * math.cos(angle)
        out[row, 1] = pose[1] + distance * math.sin(angle)
        out[row, 2] = height_m
    return met, clear


@njit(cache=True, nogil=True)
def outline_cells(polygon, pose, corner, resolution, height, width, cells):
    """Write to `cells` (N, 2) the rows and columns of the corners of `polygon` (N, 2), base frame, with the robot at `pose` (3,).

    Return whether all of them are on the map.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for n in range(len(polygon)):
        x = (pose[0] + c * polygon[n, 0] - s * polygon[n, 1] - corner[0]) / resolution
        y = (pose[1] + s * polygon[n, 0] + c * polygon[n, 1] - corner[1]) / resolution
        if not (0.0 <= x < width and 0.0 <= y < height):
            return False
        cells[n, 0], cells[n, 1] = int(y), int(x)
    return True


@njit(cache=True, nogil=True)
def fill_outline(costs, cells, value, touched):
    """Write `value` to the cells of a convex polygon whose corners are `cells` (N, 2): its edges, and each column between them."""
    first, last = cells[:, 1].min(), cells[:, 1].max()
    bottom = cells[:, 0].min()
    picture = np.zeros((cells[:, 0].max() - bottom + 1, last - first + 1), dtype=np.uint8)
    unused = np.zeros(4, dtype=np.int64)
    for n in range(len(cells)):
        a, b = n, (n + 1) % len(cells)
        fill_line(
            picture, cells[a, 0] - bottom, cells[a, 1] - first, cells[b, 0] - bottom, cells[b, 1] - first,
            np.inf, 0.0, 1, unused,
        )  # fmt: skip
    for j in range(picture.shape[1]):
        low, high = -1, -1
        for i in range(picture.shape[0]):
            if picture[i, j]:
                low = i if low < 0 else low
                high = i
        for i in range(low, high + 1):
            costs[bottom + i, first + j] = value
    touch(touched, bottom, first)
    touch(touched, bottom + picture.shape[0] - 1, last)


@njit(cache=True, nogil=True)
def sample(source, source_corner, source_resolution, pose, corner, resolution, maximum, box, out):
    """Write the costs of `source` to the cells of `out` within `box` (4,), where the centre of a cell lies on it.

    `pose` (3,) is that of the frame of `out` in the frame of `source`. With `maximum` the greater cost stays.
    """
    height, width = source.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for row in range(box[0], box[1]):
        y = corner[1] + (row + 0.5) * resolution
        for column in range(box[2], box[3]):
            x = corner[0] + (column + 0.5) * resolution
            j = math.floor((pose[0] + c * x - s * y - source_corner[0]) / source_resolution)
            i = math.floor((pose[1] + s * x + c * y - source_corner[1]) / source_resolution)
            if 0 <= i < height and 0 <= j < width:
                value = source[i, j]
                out[row, column] = max(value, out[row, column]) if maximum else value
