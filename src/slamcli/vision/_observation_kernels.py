# SPDX-License-Identifier: MIT
"""Bundle adjustment: the order of observations, which cameras share points, steps of cameras, and squared residuals."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

NEAREST = 1e-6  # units of the map ahead of the camera from which on a point counts as seen


@njit(cache=True, nogil=True)
def sort_stably(keys, size, order, starts):
    """Fill `order` (M,) with a stable order by `keys` (values below `size`), and `starts` (size + 1,) of each key."""
    starts[:] = 0
    for n in range(len(keys)):
        starts[keys[n] + 1] += 1
    for k in range(size):
        starts[k + 1] += starts[k]
    ends = starts[:size].copy()
    for n in range(len(keys)):
        order[ends[keys[n]]] = n
        ends[keys[n]] += 1


@njit(cache=True, nogil=True)
def mark_pairs(starts, columns, pairs):
    """Set `pairs` [a, b] for free cameras a <= b (columns (M,) by point, -1: fixed) that see a point together."""
    for p in range(len(starts) - 1):
        for m in range(starts[p], starts[p + 1]):
            a = columns[m]
            if a < 0:
                continue
            for n in range(m, starts[p + 1]):
                b = columns[n]
                if b >= a:
                    pairs[a, b] = True
                elif b >= 0:
                    pairs[b, a] = True


@njit(cache=True, nogil=True)
def move_cameras(poses, ranks, steps, out):
    """Write [Exp(phi) | rho] pose of each camera with a rank to `out` (C, 3, 4); the others stay."""
    for k in range(len(poses)):
        rank = ranks[k]
        if rank < 0:
            out[k] = poses[k]
            continue
        x, y, z = steps[rank, 0], steps[rank, 1], steps[rank, 2]
        square = x * x + y * y + z * z
        angle = math.sqrt(square)
        if angle < 1e-5:
            a, b = 1.0 - square / 6.0, 0.5 - square / 24.0
        else:
            a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
        r00, r01, r02 = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
        r10, r11, r12 = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
        r20, r21, r22 = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)
        for j in range(4):
            p0, p1, p2 = poses[k, 0, j], poses[k, 1, j], poses[k, 2, j]
            out[k, 0, j] = r00 * p0 + r01 * p1 + r02 * p2
            out[k, 1, j] = r10 * p0 + r11 * p1 + r12 * p2
            out[k, 2, j] = r20 * p0 + r21 * p1 + r22 * p2
        for i in range(3):
            out[k, i, 3] += steps[rank, 3 + i]


@njit(cache=True, nogil=True)
def squares(cameras, point_of, measured, weights, poses, points, camera, chi2, ahead):
    """Fill chi2 (M,) and whether the point lies ahead of the camera (M,); inf behind."""
    for m in range(len(cameras)):
        k, p = cameras[m], point_of[m]
        begin = poses[k]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        cz = begin[2, 0] * x + begin[2, 1] * y + begin[2, 2] * z + begin[2, 3]
        ahead[m] = cz > NEAREST
        if not ahead[m]:
            chi2[m] = np.inf
            continue
        u = camera[0] * (begin[0, 0] * x + begin[0, 1] * y + begin[0, 2] * z + begin[0, 3]) / cz + camera[2]
        v = camera[1] * (begin[1, 0] * x + begin[1, 1] * y + begin[1, 2] * z + begin[1, 3]) / cz + camera[3]
        eu, ev = u - measured[m, 0], v - measured[m, 1]
        er = 0.0 if math.isnan(measured[m, 2]) else u - camera[4] / cz - measured[m, 2]
        chi2[m] = weights[m] * (eu * eu + ev * ev + er * er)
