# SPDX-License-Identifier: MIT
"""Compiled loops that turn depth images into floors and planar grids; see `slamcli.grids.depth_projection` and `slamcli.grids.floor`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def draw_view(points, camera_x, camera_y, low, high, reach, resolution, x_min, y_min, hits, misses, nearest, clear):
    """Draw what one view shows into `hits` and `misses` (H, W).

    Parameters
    ----------
    points
        float64 (N, 3), z up, metres.
    low, high
        Heights between which something is in the way.
    reach
        Points farther away, in the plane, tell only that it is free up to there.
    nearest, clear
        float64 (D,), room for the distance of the nearest obstacle and of what was seen, by direction.
    """
    num_directions = len(nearest)
    nearest[:] = np.inf
    clear[:] = 0.0
    for n in range(len(points)):
        dx, dy, z = points[n, 0] - camera_x, points[n, 1] - camera_y, points[n, 2]
        distance = math.sqrt(dx * dx + dy * dy)
        turn = (math.atan2(dy, dx) + math.pi) / (2.0 * math.pi) * num_directions
        d = min(int(turn), num_directions - 1)
        clear[d] = max(clear[d], min(distance, reach))
        if low <= z <= high and distance <= reach:
            nearest[d] = min(nearest[d], distance)
            i = math.floor((points[n, 1] - y_min) / resolution)
            j = math.floor((points[n, 0] - x_min) / resolution)
            if 0 <= i < hits.shape[0] and 0 <= j < hits.shape[1]:
                hits[i, j] += 1
    # Free up to a cell before the nearest obstacle of a direction: what is behind it was seen over it.
    for d in range(num_directions):
        free = min(clear[d], nearest[d] - resolution)
        angle = (d + 0.5) / num_directions * 2.0 * math.pi - math.pi
        c, s = math.cos(angle), math.sin(angle)
        last_i, last_j = -1, -1
        steps = int(free / (0.5 * resolution)) if free > 0.0 else 0
        for k in range(steps):
            i = math.floor((camera_y + s * k * 0.5 * resolution - y_min) / resolution)
            j = math.floor((camera_x + c * k * 0.5 * resolution - x_min) / resolution)
            if (i != last_i or j != last_j) and 0 <= i < hits.shape[0] and 0 <= j < hits.shape[1]:
                misses[i, j] += 1
                last_i, last_j = i, j


@njit(cache=True, nogil=True)
def count_near(points, normals, offsets, tolerance):
    """Return int64 (S, 2): how many points (N, 3) lie within `tolerance` of each plane ``normal @ p = offset``, and how many well below."""
    counts = np.zeros((len(offsets), 2), np.int64)
    for s in range(len(offsets)):
        for n in range(len(points)):
            d = normals[s, 0] * points[n, 0] + normals[s, 1] * points[n, 1] + normals[s, 2] * points[n, 2] - offsets[s]
            if abs(d) <= tolerance:
                counts[s, 0] += 1
            elif d < -3.0 * tolerance:
                counts[s, 1] += 1
    return counts
