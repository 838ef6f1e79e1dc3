# SPDX-License-Identifier: MIT
"""Residuals and Jacobians of planar pose graphs; derivations stand in `slamcli.posegraph.planar`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TWO_PI = 2.0 * math.pi


@njit(cache=True, nogil=True, inline="always")
def _wrap(angle):
    """The angle between -pi and pi."""
    return angle - TWO_PI * math.floor((angle + math.pi) / TWO_PI)


@njit(cache=True, nogil=True)
def residuals(poses, variables, ratios, measured, whitening, out):
    """Fill `out` (N, 3) with W e, where e is how far the third pose of a row of `variables` is from where it was seen.

    It was seen from `ratios` of the way from the first pose to the second.
    """
    for n in range(len(variables)):
        a, u, b = variables[n, 0], variables[n, 1], variables[n, 2]
        ratio = ratios[n]
        yaw = poses[a, 2] + ratio * _wrap(poses[u, 2] - poses[a, 2])
        dx = poses[b, 0] - poses[a, 0] - ratio * (poses[u, 0] - poses[a, 0])
        dy = poses[b, 1] - poses[a, 1] - ratio * (poses[u, 1] - poses[a, 1])
        c, s = math.cos(yaw), math.sin(yaw)
        ex = c * dx + s * dy - measured[n, 0]
        ey = c * dy - s * dx - measured[n, 1]
        ez = _wrap(poses[b, 2] - yaw - measured[n, 2])
        for i in range(3):
            out[n, i] = whitening[n, i, 0] * ex + whitening[n, i, 1] * ey + whitening[n, i, 2] * ez


@njit(cache=True, nogil=True)
def jacobians(poses, variables, ratios, whitening, out):
    """Fill `out` (N, 3, 9) with the derivatives of the residuals by the three poses of each row of `variables`."""
    inner = np.zeros((3, 9))
    for n in range(len(variables)):
        a, u, b = variables[n, 0], variables[n, 1], variables[n, 2]
        ratio = ratios[n]
        yaw = poses[a, 2] + ratio * _wrap(poses[u, 2] - poses[a, 2])
        dx = poses[b, 0] - poses[a, 0] - ratio * (poses[u, 0] - poses[a, 0])
        dy = poses[b, 1] - poses[a, 1] - ratio * (poses[u, 1] - poses[a, 1])
        c, s = math.cos(yaw), math.sin(yaw)
        for block in range(3):
            share = ratio - 1.0 if block == 0 else (-ratio if block == 1 else 1.0)
            inner[0, 3 * block], inner[0, 3 * block + 1] = share * c, share * s
            inner[1, 3 * block], inner[1, 3 * block + 1] = -share * s, share * c
            inner[2, 3 * block + 2] = share
            turn = 0.0 if block == 2 else -share  # only the pose it was seen from turns the axes
            inner[0, 3 * block + 2] = turn * (c * dy - s * dx)
            inner[1, 3 * block + 2] = -turn * (c * dx + s * dy)
        for i in range(3):
            for j in range(9):
                out[n, i, j] = (
                    whitening[n, i, 0] * inner[0, j]
                    + whitening[n, i, 1] * inner[1, j]
                    + whitening[n, i, 2] * inner[2, j]
                )
