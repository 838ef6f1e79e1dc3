# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.registration.rotational_histogram`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

NEAREST_M = 0.2
FARTHEST_M = 0.9


@njit(cache=True, nogil=True)
def add_slices(points, rows, ends, histogram):
    """Add the directions in all slices: `rows` of points (N, 3), slice by slice, each up to its end."""
    first = 0
    for k in range(len(ends)):
        _add_slice(points, rows[first : ends[k]], histogram)
        first = ends[k]


@njit(cache=True, nogil=True)
def _add_slice(points, rows, histogram):
    """Add the directions between successive points of one slice, taken around their centroid, to the histogram."""
    n = len(rows)
    cx, cy = 0.0, 0.0
    for i in range(n):
        cx += points[rows[i], 0]
        cy += points[rows[i], 1]
    cx, cy = cx / n, cy / n
    angles = np.empty(n)
    for i in range(n):
        angles[i] = math.atan2(points[rows[i], 1] - cy, points[rows[i], 0] - cx)
    order = rows[np.argsort(angles, kind="mergesort")]
    last = -1
    for i in range(n):
        row = order[i]
        dx, dy = points[row, 0] - cx, points[row, 1] - cy
        away = math.sqrt(dx * dx + dy * dy)
        if away < NEAREST_M:
            continue
        if last < 0:
            last = row
            continue
        sx, sy = points[row, 0] - points[last, 0], points[row, 1] - points[last, 1]
        distance = math.sqrt(sx * sx + sy * sy)
        if distance < NEAREST_M:
            continue
        if distance > FARTHEST_M:
            last = row
            continue
        # Walls seen along their length, from the middle of the slice, say little about their direction.
        weight = max(0.0, 1.0 - abs(sx * dx + sy * dy) / (distance * away))
        angle = math.atan2(sy, sx) % math.pi
        bucket = min(int(len(histogram) * angle / math.pi), len(histogram) - 1)
        histogram[bucket] += weight


@njit(cache=True, nogil=True)
def rotated(histogram, angle, out):
    """Write the histogram of points turned by `angle`, linear between buckets."""
    n = len(histogram)
    by = -angle * n / math.pi
    whole = math.floor(by)
    fraction = by - whole
    for i in range(n):
        a, b = histogram[(i + whole) % n], histogram[(i + whole + 1) % n]
        out[i] = (1.0 - fraction) * a + fraction * b


@njit(cache=True, nogil=True)
def scores(histogram, turned, angles, out):
    """Write the cosine between `histogram` and `turned` rotated by each of the angles."""
    trial = np.empty(len(histogram))
    for k in range(len(angles)):
        rotated(turned, angles[k], trial)
        ab, aa, bb = 0.0, 0.0, 0.0
        for i in range(len(histogram)):
            ab += histogram[i] * trial[i]
            aa += histogram[i] * histogram[i]
            bb += trial[i] * trial[i]
        norms = math.sqrt(aa) * math.sqrt(bb)
        out[k] = ab / norms if norms > 1e-3 else 1.0
