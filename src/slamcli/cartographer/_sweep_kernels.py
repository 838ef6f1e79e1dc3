# SPDX-License-Identifier: MIT
"""Compiled loops over the points of a sweep and the samples of a gyroscope."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def unwarp(points, seconds, knot_seconds, quats, shifts, out):
    """Write points (N, 3) moved by the pose at each one's time, linear between the knots' poses (K), held outside of them."""
    last = len(knot_seconds) - 1
    begin = knot_seconds[0]
    step = (knot_seconds[last] - begin) / last if last > 0 else 1.0
    for i in range(len(points)):
        at = (seconds[i] - begin) / step if step > 0.0 else 0.0
        k = min(max(math.floor(at), 0), max(last - 1, 0))
        f = min(max(at - k, 0.0), 1.0)
        n = min(k + 1, last)
        dot = (
            quats[k, 0] * quats[n, 0]
            + quats[k, 1] * quats[n, 1]
            + quats[k, 2] * quats[n, 2]
            + quats[k, 3] * quats[n, 3]
        )
        g = -f if dot < 0.0 else f
        qx = (1 - f) * quats[k, 0] + g * quats[n, 0]
        qy = (1 - f) * quats[k, 1] + g * quats[n, 1]
        qz = (1 - f) * quats[k, 2] + g * quats[n, 2]
        qw = (1 - f) * quats[k, 3] + g * quats[n, 3]
        norm = 1.0 / math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        qx, qy, qz, qw = qx * norm, qy * norm, qz * norm, qw * norm
        x, y, z = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        tx, ty, tz = 2 * (qy * z - qz * y), 2 * (qz * x - qx * z), 2 * (qx * y - qy * x)
        out[i, 0] = x + qw * tx + qy * tz - qz * ty + (1 - f) * shifts[k, 0] + f * shifts[n, 0]
        out[i, 1] = y + qw * ty + qz * tx - qx * tz + (1 - f) * shifts[k, 1] + f * shifts[n, 1]
        out[i, 2] = z + qw * tz + qx * ty - qy * tx + (1 - f) * shifts[k, 2] + f * shifts[n, 2]


@njit(cache=True, nogil=True)
def in_range(points, nearest, farthest, kept):
    """Write the rows of finite points (N, 3) whose distance from the sensor is within limits; return how many."""
    count = 0
    for i in range(len(points)):
        x, y, z = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        squares = x * x + y * y + z * z
        if nearest * nearest <= squares <= farthest * farthest:
            kept[count] = i
            count += 1
    return count


@njit(cache=True, nogil=True)
def _turned(q, x, y, z):
    """A quaternion xyzw followed by a rotation vector in its own frame."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    a, b, c, w = x * s, y * s, z * s, math.cos(0.5 * angle)
    out = np.empty(4)
    out[0] = q[3] * a + q[0] * w + q[1] * c - q[2] * b
    out[1] = q[3] * b - q[0] * c + q[1] * w + q[2] * a
    out[2] = q[3] * c + q[0] * b - q[1] * a + q[2] * w
    out[3] = q[3] * w - q[0] * a - q[1] * b - q[2] * c
    return out / math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)


@njit(cache=True, nogil=True)
def integrate_rates(sample_seconds, rates, start, ends, out):
    """Write the rotations (K, 4) from time `start` to each of `ends` (increasing, not before `start`).

    A rate (M, 3) holds half way to the samples before and after it; the first and last hold beyond the ends.
    """
    quat = np.array([0.0, 0.0, 0.0, 1.0])
    now, m = start, 0
    last = len(sample_seconds) - 1
    for k in range(len(ends)):
        while now < ends[k]:
            while m < last and 0.5 * (sample_seconds[m] + sample_seconds[m + 1]) <= now:
                m += 1
            until = ends[k] if m == last else min(ends[k], 0.5 * (sample_seconds[m] + sample_seconds[m + 1]))
            dt = until - now
            quat = _turned(quat, rates[m, 0] * dt, rates[m, 1] * dt, rates[m, 2] * dt)
            now = until
        out[k] = quat
