# SPDX-License-Identifier: MIT
"""Integration of IMU samples over intervals."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
def _turned(x, y, z, w, rate, seconds):
    """The quaternion x, y, z, w followed by a rotation at a constant rate in its own frame."""
    half_x, half_y, half_z = 0.5 * seconds * rate[0], 0.5 * seconds * rate[1], 0.5 * seconds * rate[2]
    half = math.sqrt(half_x * half_x + half_y * half_y + half_z * half_z)
    scale = 1.0 - half * half / 6.0 if half < 1e-4 else math.sin(half) / half
    a, b, c, d = scale * half_x, scale * half_y, scale * half_z, math.cos(half)
    return (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )


@njit(cache=True, nogil=True)
def integrate(stamps, rates, forces, begins, ends, starts, rotations, velocities, gaps):
    """Fill `rotations` (K, 4), `velocities` (K, 3) and `gaps` (K,); `starts` are the samples that hold at `begins`."""
    count = len(stamps)
    for k in range(len(begins)):
        x, y, z, w = 0.0, 0.0, 0.0, 1.0
        now, i = begins[k], starts[k]
        widest = max(stamps[0] - begins[k], 0)
        while now < ends[k]:
            following = ends[k]
            if i + 1 < count:
                following = min(following, stamps[i + 1])
                widest = max(widest, stamps[i + 1] - stamps[i])
            else:
                widest = max(widest, ends[k] - stamps[i])
            seconds = (following - now) * 1e-9
            mx, my, mz, mw = _turned(x, y, z, w, rates[i], 0.5 * seconds)
            fx, fy, fz = forces[i, 0] * seconds, forces[i, 1] * seconds, forces[i, 2] * seconds
            tx, ty, tz = 2 * (my * fz - mz * fy), 2 * (mz * fx - mx * fz), 2 * (mx * fy - my * fx)
            velocities[k, 0] += fx + mw * tx + my * tz - mz * ty
            velocities[k, 1] += fy + mw * ty + mz * tx - mx * tz
            velocities[k, 2] += fz + mw * tz + mx * ty - my * tx
            x, y, z, w = _turned(x, y, z, w, rates[i], seconds)
            now = following
            if i + 1 < count and following == stamps[i + 1]:
                i += 1
        scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
        rotations[k, 0], rotations[k, 1], rotations[k, 2], rotations[k, 3] = scale * x, scale * y, scale * z, scale * w
        gaps[k] = widest * 1e-9
