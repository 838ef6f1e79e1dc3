# SPDX-License-Identifier: MIT
"""Compiled loop that looks at a cloud from above; see `slamcli.cartographer.projection_3d`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def look_around(points, origin, low, high, reach, nearest, clear, inside):
    """Fill, by direction, the distance of the nearest point in the height band and how far rays run within the band.

    `points` (N, 3) and `origin` (3,) are upright; distances are in the plane. `inside` (N,) becomes whether a point lies in the
    band and within `reach`. Before: `nearest` infinite and `clear` 0.
    """
    bins = len(nearest)
    for i in range(len(points)):
        dx, dy, dz = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        distance = math.sqrt(dx * dx + dy * dy)
        inside[i] = False
        if distance < 1e-6:
            continue
        where = int((math.atan2(dy, dx) / (2.0 * math.pi) + 0.5) * bins) % bins
        z = points[i, 2]
        if low <= z <= high and distance <= reach:
            inside[i] = True
            if distance < nearest[where]:
                nearest[where] = distance
        # The part of the ray whose height is in the band, as shares of its length; it must begin near the sensor.
        first, last = 0.0, 1.0
        if abs(dz) > 1e-9:
            a, b = (low - origin[2]) / dz, (high - origin[2]) / dz
            first, last = max(first, min(a, b)), min(last, max(a, b))
        elif not low <= origin[2] <= high:
            continue
        if first < last:
            clear[where] = max(clear[where], min(last * distance, reach))


@njit(cache=True, nogil=True)
def count_heights(points, reach, low, step, counts):
    """Add how many points (N, 3) within `reach` of the origin in the plane lie in each layer of `step` from `low` up."""
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        layer = math.floor((points[i, 2] - low) / step)
        if x * x + y * y <= reach * reach and 0 <= layer < len(counts):
            counts[np.int64(layer)] += 1.0
