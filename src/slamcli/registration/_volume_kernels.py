# SPDX-License-Identifier: MIT
"""Compiled loops that match points with 3D probability grids; the grids' layout is described in `slamcli.grids`.

A grid is the tuple (resolution, keys, blocks, cells) of a `HybridBlocks`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HALF = 1 << 19
MASK = (1 << 20) - 1


@njit(cache=True, nogil=True, inline="always")
def _probability(x, y, z, keys, blocks, cells):
    """The probability of a cell; 0.1 where unknown."""
    key = (((x >> 3) + HALF) & MASK) << 40 | (((y >> 3) + HALF) & MASK) << 20 | (((z >> 3) + HALF) & MASK)
    mixed = ((key & 0xFFFFFFFF) * 0x45D9F3B) ^ ((key >> 32) * 0x119DE1F3)
    mask = len(keys) - 1
    slot = (mixed ^ (mixed >> 29)) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    if keys[slot] == -1:
        return 0.1
    value = cells[blocks[slot], (x & 7) << 6 | (y & 7) << 3 | (z & 7)]
    return 0.1 if value == 0 else 0.1 + (value - 1) * (0.8 / 32766.0)


@njit(cache=True, nogil=True)
def mean_probability(points, rotation, shift, grid):
    """The mean probability of the cells in which moved points lie."""
    resolution, keys, blocks, cells = grid
    total = 0.0
    for i in range(len(points)):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c + shift[0]
        y = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c + shift[1]
        z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c + shift[2]
        total += _probability(
            math.floor(x / resolution + 0.5), math.floor(y / resolution + 0.5), math.floor(z / resolution + 0.5),
            keys, blocks, cells,
        )  # fmt: skip
    return total / max(len(points), 1)


@njit(cache=True, nogil=True)
def _add_grid(points, rotation, shift, grid, scaling, h, g, derive):
    """Add the squares of ``scaling (1 - probability)`` to the normal equations (if `derive`); return their sum."""
    resolution, keys, blocks, cells = grid
    p = np.empty((2, 2, 2))
    jacobian = np.empty(6)
    total = 0.0
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        sx = (rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + shift[0]) / resolution
        sy = (rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + shift[1]) / resolution
        sz = (rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + shift[2]) / resolution
        x, y, z = math.floor(sx), math.floor(sy), math.floor(sz)
        for a in range(2):
            for b in range(2):
                for c in range(2):
                    p[a, b, c] = _probability(x + a, y + b, z + c, keys, blocks, cells)
        sx, sy, sz = sx - x, sy - y, sz - z
        u, v, w = sx * sx * (3 - 2 * sx), sy * sy * (3 - 2 * sy), sz * sz * (3 - 2 * sz)
        c00, c01 = p[0, 0, 0] + u * (p[1, 0, 0] - p[0, 0, 0]), p[0, 0, 1] + u * (p[1, 0, 1] - p[0, 0, 1])
        c10, c11 = p[0, 1, 0] + u * (p[1, 1, 0] - p[0, 1, 0]), p[0, 1, 1] + u * (p[1, 1, 1] - p[0, 1, 1])
        e0, e1 = c00 + v * (c10 - c00), c01 + v * (c11 - c01)
        residual = scaling * (1.0 - (e0 + w * (e1 - e0)))
        total += residual * residual
        if not derive:
            continue
        d0 = (p[1, 0, 0] - p[0, 0, 0]) + v * ((p[1, 1, 0] - p[0, 1, 0]) - (p[1, 0, 0] - p[0, 0, 0]))
        d1 = (p[1, 0, 1] - p[0, 0, 1]) + v * ((p[1, 1, 1] - p[0, 1, 1]) - (p[1, 0, 1] - p[0, 0, 1]))
        s = -scaling / resolution
        gx = s * 6 * sx * (1 - sx) * (d0 + w * (d1 - d0))
        gy = s * 6 * sy * (1 - sy) * ((c10 - c00) + w * ((c11 - c01) - (c10 - c00)))
        gz = s * 6 * sz * (1 - sz) * (e1 - e0)
        na = rotation[0, 0] * gx + rotation[1, 0] * gy + rotation[2, 0] * gz
        nb = rotation[0, 1] * gx + rotation[1, 1] * gy + rotation[2, 1] * gz
        nc = rotation[0, 2] * gx + rotation[1, 2] * gy + rotation[2, 2] * gz
        jacobian[0], jacobian[1], jacobian[2] = gx, gy, gz
        jacobian[3], jacobian[4], jacobian[5] = py * nc - pz * nb, pz * na - px * nc, px * nb - py * na
        for m in range(6):
            g[m] -= jacobian[m] * residual
            for n in range(6):
                h[m, n] += jacobian[m] * jacobian[n]
    return total


@njit(cache=True, nogil=True)
def turned(rotation, w):
    """``rotation @ exp(w)``."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    a, b = (1.0, 0.5) if angle < 1e-8 else (math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle))
    x, y, z = w[0], w[1], w[2]
    e = np.empty((3, 3))
    e[0, 0], e[1, 1], e[2, 2] = 1.0 - b * (y * y + z * z), 1.0 - b * (x * x + z * z), 1.0 - b * (x * x + y * y)
    e[0, 1], e[1, 0] = b * x * y - a * z, b * x * y + a * z
    e[0, 2], e[2, 0] = b * x * z + a * y, b * x * z - a * y
    e[1, 2], e[2, 1] = b * y * z - a * x, b * y * z + a * x
    return rotation @ e


@njit(cache=True, nogil=True)
def _half_turn(a, b):
    """The vector part of the quaternion of ``a.T @ b`` for angles well below pi: half the rotation vector when small."""
    r = a.T @ b
    x, y, z = 0.5 * (r[2, 1] - r[1, 2]), 0.5 * (r[0, 2] - r[2, 0]), 0.5 * (r[1, 0] - r[0, 1])
    w = math.sqrt(max(1.0 + r[0, 0] + r[1, 1] + r[2, 2], 1e-12))  # twice the quaternion's real part
    return np.array([x / w, y / w, z / w])


@njit(cache=True, nogil=True)
def _cost(high, low, high_grid, low_grid, weights, rotation, shift, target_rotation, target_shift, h, g, derive):
    """The sum of squares at a pose, with its normal equations if `derive`."""
    if derive:
        h[:] = 0.0
        g[:] = 0.0
    total = 0.0
    if len(high):
        total += _add_grid(high, rotation, shift, high_grid, weights[0] / math.sqrt(len(high)), h, g, derive)
    if len(low):
        total += _add_grid(low, rotation, shift, low_grid, weights[1] / math.sqrt(len(low)), h, g, derive)
    turn = _half_turn(target_rotation, rotation)
    for d in range(3):
        off, bend = weights[2] * (shift[d] - target_shift[d]), weights[3] * turn[d]
        total += off * off + bend * bend
        if derive:
            h[d, d] += weights[2] * weights[2]
            g[d] -= weights[2] * off
            h[3 + d, 3 + d] += 0.25 * weights[3] * weights[3]
            g[3 + d] -= 0.5 * weights[3] * bend
    return total


@njit(cache=True, nogil=True)
def align(
    high, low, high_grid, low_grid, weights, rotation, shift, target_rotation, target_shift, only_yaw, iterations
):
    """Move (`rotation`, `shift`) in place to the least squares by Levenberg and Marquardt; return cost and iterations.

    `weights`: of the high and low resolution points, of the distance and of the rotation from the target.
    """
    h, g, trial_h, trial_g = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6)
    cost = _cost(high, low, high_grid, low_grid, weights, rotation, shift, target_rotation, target_shift, h, g, True)
    damping, done = 1e-4, 0
    while done < iterations:
        done += 1
        size = 4 if only_yaw else 6
        basis = np.zeros((6, size))
        for d in range(size):
            basis[d, d] = 1.0
        if only_yaw:  # about the vertical of the map, not of the cloud
            basis[3, 3], basis[4, 3], basis[5, 3] = rotation[2, 0], rotation[2, 1], rotation[2, 2]
        a = basis.T @ (h @ basis)
        for d in range(size):
            a[d, d] += damping * min(max(a[d, d], 1e-6), 1e32)
        step = basis @ np.linalg.solve(a, basis.T @ g)
        moved, rotated = shift + step[:3], turned(rotation, step[3:])
        trial = _cost(
            high, low, high_grid, low_grid, weights, rotated, moved, target_rotation, target_shift, trial_h, trial_g, True
        )  # fmt: skip
        if trial < cost:
            gain = cost - trial
            shift[:], rotation[:] = moved, rotated
            h[:], g[:] = trial_h, trial_g
            damping = max(damping / 3.0, 1e-16)
            if gain < 1e-6 * cost:
                return trial, done
            cost = trial
        else:
            damping *= 4.0
            if damping > 1e8:
                break
    return cost, done


@njit(cache=True, nogil=True)
def best_of_window(points, grid, rotation, shift, shifts, turns, weights):
    """The best of all poses ``start @ (shift, turn)``: mean probability, lowered with the distance from the start.

    `turns` are rotation vectors (M, 3), `shifts` (K, 3); `weights` lower the score by
    ``exp(-(|shift| weights[0] + |turn| weights[1])^2)``. Returns score and indices of shift and turn; of equals the first.
    """
    best, best_shift, best_turn = -1.0, 0, 0
    for t in range(len(turns)):
        rotated = turned(rotation, turns[t])
        angle = math.sqrt(turns[t, 0] ** 2 + turns[t, 1] ** 2 + turns[t, 2] ** 2)
        for s in range(len(shifts)):
            length = math.sqrt(shifts[s, 0] ** 2 + shifts[s, 1] ** 2 + shifts[s, 2] ** 2)
            moved = shift + rotation @ shifts[s]
            away = length * weights[0] + angle * weights[1]
            score = mean_probability(points, rotated, moved, grid) * math.exp(-away * away)
            if score > best:
                best, best_shift, best_turn = score, s, t
    return best, best_shift, best_turn
