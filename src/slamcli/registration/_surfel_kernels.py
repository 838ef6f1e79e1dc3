# SPDX-License-Identifier: MIT
"""Compiled loops that lay points on the planes of a `SurfelMap`; its layout is described in `slamcli.grids`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

HALF = 1 << 19
MASK = (1 << 20) - 1


@njit(cache=True, nogil=True, inline="always")
def _plane_at(x, y, z, smallest, levels, keys, rows, planes):
    """The row of the largest voxel around a point that has a plane, or -1."""
    mask = len(keys) - 1
    for up in range(levels):
        level = levels - 1 - up
        size = smallest * (1 << level)
        i, j, k = math.floor(x / size), math.floor(y / size), math.floor(z / size)
        key = (((((i + HALF) & MASK) << 20 | ((j + HALF) & MASK)) << 20 | ((k + HALF) & MASK)) << 2) | level
        mixed = ((key & 0xFFFFFFFF) * 0x45D9F3B) ^ ((key >> 32) * 0x119DE1F3)
        slot = (mixed ^ (mixed >> 29)) & mask
        while keys[slot] != -1 and keys[slot] != key:
            slot = (slot + 1) & mask
        if keys[slot] == key and planes[rows[slot], 6] >= 0.0:
            return rows[slot]
    return -1


@njit(cache=True, nogil=True)
def _exp(w):
    """The rotation matrix of a rotation vector (Rodrigues)."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if angle < 1e-8:
        a, b = 1.0, 0.5
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    x, y, z = w[0], w[1], w[2]
    out = np.empty((3, 3))
    out[0, 0], out[1, 1], out[2, 2] = 1.0 - b * (y * y + z * z), 1.0 - b * (x * x + z * z), 1.0 - b * (x * x + y * y)
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x
    return out


@njit(cache=True, nogil=True)
def _log(r):
    """The rotation vector of a rotation matrix whose angle is well below pi."""
    x, y, z = 0.5 * (r[2, 1] - r[1, 2]), 0.5 * (r[0, 2] - r[2, 0]), 0.5 * (r[1, 0] - r[0, 1])
    sine = math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(sine, 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0))
    scale = 1.0 if sine < 1e-9 else angle / sine
    return np.array([x * scale, y * scale, z * scale])


@njit(cache=True, nogil=True)
def _normal_equations(points, rotation, shift, smallest, levels, keys, rows, planes, noise2, loose2, scale2, h, g):
    """Add the weighted squares of all distances from planes to `h` and `g`; return matched points and summed weights.

    The weight falls with the distance as Geman and McClure's; `loose2` widens it while the pose is still uncertain.
    """
    matched, total = 0, 0.0
    jacobian = np.empty(6)
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + shift[0]
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + shift[1]
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + shift[2]
        row = _plane_at(x, y, z, smallest, levels, keys, rows, planes)
        if row < 0:
            continue
        a, b, c = planes[row, 3], planes[row, 4], planes[row, 5]
        r = a * (x - planes[row, 0]) + b * (y - planes[row, 1]) + c * (z - planes[row, 2])
        variance = planes[row, 6] + noise2 + loose2
        fall = scale2 / (scale2 + r * r / variance)
        weight = fall * fall / variance
        matched += 1
        total += fall * fall
        # d(distance)/d(shift), d(distance)/d(rotation): the normal, and p x (R^T n)
        na = rotation[0, 0] * a + rotation[1, 0] * b + rotation[2, 0] * c
        nb = rotation[0, 1] * a + rotation[1, 1] * b + rotation[2, 1] * c
        nc = rotation[0, 2] * a + rotation[1, 2] * b + rotation[2, 2] * c
        jacobian[0], jacobian[1], jacobian[2] = a, b, c
        jacobian[3], jacobian[4], jacobian[5] = py * nc - pz * nb, pz * na - px * nc, px * nb - py * na
        for u in range(6):
            ju = weight * jacobian[u]
            g[u] -= ju * r
            for v in range(u, 6):
                h[u, v] += ju * jacobian[v]
    return matched, total


@njit(cache=True, nogil=True)
def information_at(points, rotation, shift, smallest, levels, keys, rows, planes, noise_m, scale, loose_m, h):
    """Fill the information matrix (6, 6) of points at a pose, shift before rotation."""
    g = np.zeros(6)
    h[:] = 0.0
    _normal_equations(
        points,
        rotation,
        shift,
        smallest,
        levels,
        keys,
        rows,
        planes,
        noise_m * noise_m,
        loose_m * loose_m,
        scale * scale,
        h,
        g,
    )
    for u in range(6):
        for v in range(u):
            h[u, v] = h[v, u]


@njit(cache=True, nogil=True)
def align(points, rotation, shift, prior_rotation, prior_shift, information, smallest, levels, keys, rows, planes,
          noise_m, scale, loose_m, max_iterations, h):  # fmt: skip
    """Move (`rotation`, `shift`) in place so that points lie on planes; see `slamcli.registration.surfel_matching`.

    `information` (6, 6) is that of the prior: any for the shift, diagonal for the rotation. `h` becomes the information matrix (6, 6) of the points at the result. Returns matched points, the sum of their
    weights between 0 and 1, and the iterations.
    """
    g = np.empty(6)
    loose = loose_m
    matched, total = 0, 0.0
    for iteration in range(max_iterations):
        h[:] = 0.0
        g[:] = 0.0
        matched, total = _normal_equations(
            points, rotation, shift, smallest, levels, keys, rows, planes, noise_m * noise_m, loose * loose,
            scale * scale, h, g,
        )  # fmt: skip
        for u in range(6):
            for v in range(u):
                h[u, v] = h[v, u]
        system = h.copy()
        turn = _log(prior_rotation.T @ rotation)
        for d in range(3):
            for e in range(3):
                system[d, e] += information[d, e]
                g[d] -= information[d, e] * (shift[e] - prior_shift[e])
            system[3 + d, 3 + d] += information[3 + d, 3 + d]
            g[3 + d] -= information[3 + d, 3 + d] * turn[d]
        step = np.linalg.solve(system, g)
        for d in range(3):
            shift[d] += step[d]
        rotation[:] = rotation @ _exp(step[3:])
        small = abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-4 and abs(step[3]) + abs(step[4]) + abs(step[5]) < 2e-5
        if small and loose < 0.02:
            return matched, total, iteration + 1
        loose *= 0.25 if small else 0.6
    return matched, total, max_iterations
