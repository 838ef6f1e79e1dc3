# SPDX-License-Identifier: MIT
"""Compiled integration of a gyroscope with the pull of gravity; see `slamcli.trajectory.attitude`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def track(seconds, rates, forces, time_constant, level, out):
    """Orientations `out` (N, 4), xyzw, of the base in a frame whose z is up: gyroscope, drawn to the mean of the forces.

    `seconds` (N,) increase; `rates` and `forces` are (N, 3) in the base. `level` (3,) is the first direction of up in the
    base, a unit vector; a zero vector means that the forces say nothing.
    """
    known = level[0] != 0.0 or level[1] != 0.0 or level[2] != 0.0
    up = level.copy()
    if not known:
        up[2] = 1.0
    # the shortest rotation that takes `up` to z
    x, y, z, w = up[1], -up[0], 0.0, 1.0 + up[2]
    if w < 1e-9:
        x, y, z, w = 1.0, 0.0, 0.0, 0.0
    n = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / n, y / n, z / n, w / n
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = x, y, z, w
    gravity = up.copy()
    for k in range(1, seconds.shape[0]):
        dt = seconds[k] - seconds[k - 1]
        half = 0.5 * dt
        a = half * (rates[k, 0] + rates[k - 1, 0])
        b = half * (rates[k, 1] + rates[k - 1, 1])
        c = half * (rates[k, 2] + rates[k - 1, 2])
        angle = math.sqrt(a * a + b * b + c * c)
        h = 0.5 * math.sin(0.5 * angle) / (0.5 * angle) if angle > 1e-9 else 0.5
        p, q, r, s = a * h, b * h, c * h, math.cos(0.5 * angle)
        x, y, z, w = (
            w * p + x * s + y * r - z * q,
            w * q - x * r + y * s + z * p,
            w * r + x * q - y * p + z * s,
            w * s - x * p - y * q - z * r,
        )
        if known:
            # gravity in the base turns with it, and follows the measured forces slowly
            gx, gy, gz = gravity[0], gravity[1], gravity[2]
            gravity[0] = gx - (b * gz - c * gy)
            gravity[1] = gy - (c * gx - a * gz)
            gravity[2] = gz - (a * gy - b * gx)
            size = math.sqrt(forces[k, 0] ** 2 + forces[k, 1] ** 2 + forces[k, 2] ** 2)
            if size > 1e-6:
                share = 1.0 - math.exp(-dt / time_constant)
                for i in range(3):
                    gravity[i] += share * (forces[k, i] / size - gravity[i])
            # turn so that the tracked gravity points up
            ux = (
                (1 - 2 * (y * y + z * z)) * gravity[0]
                + 2 * (x * y - z * w) * gravity[1]
                + 2 * (x * z + y * w) * gravity[2]
            )
            uy = (
                2 * (x * y + z * w) * gravity[0]
                + (1 - 2 * (x * x + z * z)) * gravity[1]
                + 2 * (y * z - x * w) * gravity[2]
            )
            uz = (
                2 * (x * z - y * w) * gravity[0]
                + 2 * (y * z + x * w) * gravity[1]
                + (1 - 2 * (x * x + y * y)) * gravity[2]
            )
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            if length > 1e-6 and uz > -0.999 * length:
                cx, cy, cw = uy / length, -ux / length, 1.0 + uz / length
                x, y, z, w = (
                    cw * x + cx * w + cy * z,
                    cw * y - cx * z + cy * w,
                    cw * z + cx * y - cy * x,
                    cw * w - cx * x - cy * y,
                )
        n = math.sqrt(x * x + y * y + z * z + w * w)
        x, y, z, w = x / n, y / n, z / n, w / n
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = x, y, z, w


def warm() -> None:
    """Compile the kernel of this module."""
    track(np.arange(2.0), np.zeros((2, 3)), np.ones((2, 3)), 10.0, np.array([0.0, 0.0, 1.0]), np.empty((2, 4)))
