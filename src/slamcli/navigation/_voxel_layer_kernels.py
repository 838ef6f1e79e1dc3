# SPDX-License-Identifier: MIT
"""Compiled loops of the voxel layer; see `slamcli.navigation.voxel_layer`.

A column of up to 16 voxels is one uint32, as costmap_2d's voxel grid has it: bit z says that voxel z is not known to be free, bit
z + 16 that it is marked. So 00 is free, 01 unknown, 11 marked.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FREE, LETHAL, UNKNOWN = 0, 254, 255


@njit(cache=True, nogil=True)
def bits(number):
    """Return how many bits of a whole number are 1."""
    count = 0
    while number > 0:
        number &= number - 1
        count += 1
    return count


@njit(cache=True, nogil=True)
def touch(touched, row, column):
    """Let the box `touched` (4,) hold a cell."""
    touched[0], touched[1] = min(touched[0], row), max(touched[1], row + 1)
    touched[2], touched[3] = min(touched[2], column), max(touched[3], column + 1)


@njit(cache=True, nogil=True)
def mark_voxels(
    columns, costs, origin, points, corner, sizes, levels, most_m, least_m, low_m, high_m, threshold, touched
):
    """Mark the voxels that hold `points` (N, 3); a column with more than `threshold` marked ones is lethal.

    `corner` (3,) is that of voxel (0, 0, 0), `sizes` (2,) the side and the height of a voxel, metres. Points below the lowest voxel
    count to it, points above the highest of `levels` are left out.
    """
    height, width = columns.shape
    most, least = most_m * most_m, least_m * least_m
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if z > high_m or z < low_m:
            continue
        squared = (x - origin[0]) ** 2 + (y - origin[1]) ** 2 + (z - origin[2]) ** 2
        if squared >= most or squared < least:
            continue
        j, i = (x - corner[0]) / sizes[0], (y - corner[1]) / sizes[0]
        k = (max(z, corner[2]) - corner[2]) / sizes[1]
        if not (0.0 <= j < width and 0.0 <= i < height and k < levels):
            continue
        row, column, level = int(i), int(j), int(k)
        voxels = np.int64(columns[row, column]) | (0x10001 << level)
        columns[row, column] = voxels
        if bits(voxels >> 16) > threshold:
            costs[row, column] = LETHAL
            touch(touched, row, column)


@njit(cache=True, nogil=True)
def clear_voxel(columns, costs, row, column, level, unknown_threshold, mark_threshold):
    """Free one voxel; a column with no more marked voxels than allowed is free, or unknown if too much of it is."""
    voxels = np.int64(columns[row, column]) & ~(0x10001 << level)
    columns[row, column] = voxels
    marked = voxels >> 16
    if bits(marked) <= mark_threshold:
        unknown = marked ^ (voxels & 0xFFFF)
        costs[row, column] = FREE if bits(unknown) <= unknown_threshold else UNKNOWN


@njit(cache=True, nogil=True)
def clear_voxel_line(columns, costs, start, end, most, least, unknown_threshold, mark_threshold, touched):
    """Free the voxels from `start` towards `end`, both (3,) in voxels along x, y, z, from `least` to `most` voxels far.

    One step per voxel of the direction with the most of them; the others follow by halves, as Bresenham's line.
    """
    x, y, z = int(start[0]), int(start[1]), int(start[2])
    d_x, d_y, d_z = int(end[0]) - x, int(end[1]) - y, int(end[2]) - z
    n_x, n_y, n_z = abs(d_x), abs(d_y), abs(d_z)
    length = math.sqrt((start[0] - end[0]) ** 2 + (start[1] - end[1]) ** 2 + (start[2] - end[2]) ** 2)
    if length < least:
        return
    scale = min(1.0, most / length) if length > 0.0 else 1.0
    along = max(n_x, n_y, n_z)
    steps = int(scale * along)
    first = math.ceil(least / length * along) if least > 0.0 and length > 0.0 else 0
    for step in range(steps + 1):
        if along > 0:
            row = y + (along // 2 + step * n_y) // along * (1 if d_y > 0 else -1)
            column = x + (along // 2 + step * n_x) // along * (1 if d_x > 0 else -1)
            level = z + (along // 2 + step * n_z) // along * (1 if d_z > 0 else -1)
        else:
            row, column, level = y, x, z
        if step >= first:
            clear_voxel(columns, costs, row, column, level, unknown_threshold, mark_threshold)
            if step in (first, steps):
                touch(touched, row, column)


@njit(cache=True, nogil=True)
def clear_voxel_beams(
    columns, costs, origin, ends, corner, sizes, levels, most_m, least_m, high_m, unknown_threshold, mark_threshold, touched
):  # fmt: skip
    """Free the voxels along beams from `origin` (3,) to two cells before each of `ends` (N, 3), metres.

    Beams are cut at `high_m`, at the lowest voxel and where they leave the map. Return whether they begin within the voxels.
    """
    height, width = columns.shape
    side = sizes[0]
    start, end = np.empty(3), np.empty(3)
    start[0], start[1] = (origin[0] - corner[0]) / side, (origin[1] - corner[1]) / side
    start[2] = (origin[2] - corner[2]) / sizes[1]
    if not (0.0 <= start[0] < width and 0.0 <= start[1] < height and 0.0 <= start[2] < levels):
        return False
    most, least = float(math.ceil(most_m / side)), least_m / side
    far_x, far_y = corner[0] + (width - 0.5) * side, corner[1] + (height - 0.5) * side
    for n in range(len(ends)):
        a, b, c = ends[n, 0] - origin[0], ends[n, 1] - origin[1], ends[n, 2] - origin[2]
        distance = math.sqrt(a * a + b * b + c * c)
        shorter = max(0.0, (distance - 2.0 * side) / distance) if distance > 0.0 else 0.0
        a, b, c = a * shorter, b * shorter, c * shorter
        share = 1.0
        if origin[2] + c > high_m:
            share = max(0.0, min(share, (high_m - 0.01 - origin[2]) / c))
        elif origin[2] + c < corner[2]:
            share = min(share, (corner[2] - origin[2]) / c)
        if origin[0] + a < corner[0]:
            share = min(share, (corner[0] - origin[0]) / a)
        if origin[1] + b < corner[1]:
            share = min(share, (corner[1] - origin[1]) / b)
        if origin[0] + a > far_x:
            share = min(share, max(0.0, (far_x - origin[0]) / a))
        if origin[1] + b > far_y:
            share = min(share, max(0.0, (far_y - origin[1]) / b))
        end[0] = start[0] + a * share / side
        end[1] = start[1] + b * share / side
        end[2] = start[2] + c * share / sizes[1]
        # Rounding at the borders; a beam that rises above the highest voxel is not followed at all, as in costmap_2d.
        end[0], end[1] = min(max(end[0], 0.0), width - 0.5), min(max(end[1], 0.0), height - 0.5)
        end[2] = max(end[2], 0.0)
        if end[2] < levels:
            clear_voxel_line(
                columns, costs, start, end, most, least, unknown_threshold, mark_threshold, touched
            )  # fmt: skip
    return True
