# SPDX-License-Identifier: MIT
"""Residuals and Jacobians of pose graphs in space; derivations stand in `slamcli.posegraph.spatial`.

Poses are rows x, y, z, qx, qy, qz, qw of unit quaternions. Matrices are 3 x 3 work arrays that are written in place.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SMALL = 1e-4  # angle below which series replace quotients of sines, rad


@njit(cache=True, nogil=True, inline="always")
def _product(a, b):
    """The quaternion a b (first b, then a), of and as tuples x, y, z, w."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@njit(cache=True, nogil=True, inline="always")
def _quaternion(row, sign):
    """The rotation of a pose's row, or with sign -1 its inverse."""
    return sign * row[3], sign * row[4], sign * row[5], row[6]


@njit(cache=True, nogil=True)
def _exponential(x, y, z):
    """The quaternion of a rotation vector."""
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    scale = 0.5 - half * half / 12.0 if half < SMALL else 0.5 * math.sin(half) / half
    return scale * x, scale * y, scale * z, math.cos(half)


@njit(cache=True, nogil=True)
def _logarithm(q):
    """The rotation vector of a quaternion, no longer than pi."""
    x, y, z, w = q
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 / w - 2.0 * sine * sine / (3.0 * w * w * w) if sine < SMALL else 2.0 * math.atan2(sine, w) / sine
    return scale * x, scale * y, scale * z


@njit(cache=True, nogil=True)
def _fill_matrix(q, out):
    """Write the rotation matrix of a quaternion."""
    x, y, z, w = q
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@njit(cache=True, nogil=True)
def _fill_cross(v, first, second, out):
    """Write I + first [v]x + second [v]x [v]x."""
    x, y, z = v
    square = x * x + y * y + z * z
    out[0, 0], out[0, 1], out[0, 2] = x * x - square, x * y, x * z
    out[1, 0], out[1, 1], out[1, 2] = x * y, y * y - square, y * z
    out[2, 0], out[2, 1], out[2, 2] = x * z, y * z, z * z - square
    for r in range(3):
        for c in range(3):
            out[r, c] *= second
        out[r, r] += 1.0
    out[0, 1] -= first * z
    out[0, 2] += first * y
    out[1, 0] += first * z
    out[1, 2] -= first * x
    out[2, 0] -= first * y
    out[2, 1] += first * x


@njit(cache=True, nogil=True)
def _fill_inverse_jacobian(v, side, out):
    """Write the inverse of the right (`side` 1) or left (-1) Jacobian of the exponential at a rotation vector."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if angle < SMALL:
        second = 1.0 / 12.0 + angle * angle / 720.0
    else:
        second = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / (angle * angle)
    _fill_cross(v, 0.5 * side, second, out)


@njit(cache=True, nogil=True)
def _fill_left_jacobian(v, out):
    """Write the left Jacobian of the exponential at a rotation vector."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if angle < SMALL:
        first, second = 0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0
    else:
        first = (1.0 - math.cos(angle)) / (angle * angle)
        second = (angle - math.sin(angle)) / (angle * angle * angle)
    _fill_cross(v, first, second, out)


@njit(cache=True, nogil=True)
def _fill_product(a, b, transposed, out):
    """Write a b, or with `transposed` a b'."""
    for r in range(3):
        for c in range(3):
            total = 0.0
            for i in range(3):
                total += a[r, i] * (b[c, i] if transposed else b[i, c])
            out[r, c] = total


@njit(cache=True, nogil=True, inline="always")
def _observer(poses, a, u, ratio):
    """The quaternion `ratio` of the way from pose a to pose u, and the rotation vector of the whole way in the map."""
    start = _quaternion(poses[a], 1.0)
    way = _logarithm(_product(_quaternion(poses[u], 1.0), _quaternion(poses[a], -1.0)))
    return _product(_exponential(ratio * way[0], ratio * way[1], ratio * way[2]), start), way


@njit(cache=True, nogil=True)
def residuals(poses, pairs, ratios, measured, whitening, out):
    """Fill `out` (N, 6) with W e, where e is how far the third pose of a row of `pairs` is from where it was seen.

    It was seen from `ratios` of the way from the first pose to the second.
    """
    axes, error = np.empty((3, 3)), np.empty(6)
    for n in range(len(pairs)):
        a, u, b = pairs[n, 0], pairs[n, 1], pairs[n, 2]
        ratio = ratios[n]
        observer = _quaternion(poses[a], 1.0) if ratio == 0.0 else _observer(poses, a, u, ratio)[0]
        _fill_matrix(observer, axes)
        for i in range(3):
            error[i] = -measured[n, i]
        for k in range(3):
            d = poses[b, k] - poses[a, k] - ratio * (poses[u, k] - poses[a, k])
            for i in range(3):
                error[i] += axes[k, i] * d
        inverse = (-observer[0], -observer[1], -observer[2], observer[3])
        relative = _product(inverse, _quaternion(poses[b], 1.0))
        error[3], error[4], error[5] = _logarithm(_product(_quaternion(measured[n], -1.0), relative))
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += whitening[n, i, j] * error[j]
            out[n, i] = total


@njit(cache=True, nogil=True)
def jacobians(poses, pairs, ratios, measured, whitening, out):
    """Fill `out` (N, 6, 12), or (N, 6, 18) where observers may lie between poses, with the residuals' derivatives.

    Columns are translation and rotation (in the map's axes) of the first pose, of the second (18 only) and of the third.
    """
    width = out.shape[2]
    last = width - 6
    axes, seen, turn = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    by_seen, by_observer = np.empty((3, 3)), np.empty((3, 3))
    work, left, share_a, share_u = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    inner = np.zeros((6, width))
    for n in range(len(pairs)):
        a, u, b = pairs[n, 0], pairs[n, 1], pairs[n, 2]
        ratio = ratios[n]
        observer, way = _observer(poses, a, u, ratio)
        _fill_matrix(observer, axes)
        _fill_matrix(_quaternion(poses[b], 1.0), seen)
        inverse = (-observer[0], -observer[1], -observer[2], observer[3])
        relative = _product(inverse, _quaternion(poses[b], 1.0))
        error = _logarithm(_product(_quaternion(measured[n], -1.0), relative))
        _fill_inverse_jacobian(error, 1.0, turn)
        _fill_product(turn, seen, True, by_seen)  # d error / d rotation of the seen; minus that for the observer's
        dx = poses[b, 0] - poses[a, 0] - ratio * (poses[u, 0] - poses[a, 0])
        dy = poses[b, 1] - poses[a, 1] - ratio * (poses[u, 1] - poses[a, 1])
        dz = poses[b, 2] - poses[a, 2] - ratio * (poses[u, 2] - poses[a, 2])
        for i in range(3):  # R' [d]x
            x, y, z = axes[0, i], axes[1, i], axes[2, i]
            by_observer[i, 0], by_observer[i, 1], by_observer[i, 2] = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
        for i in range(3):
            for j in range(3):
                inner[i, j] = (ratio - 1.0) * axes[j, i]
                inner[i, last + j] = axes[j, i]
                inner[i, 3 + j] = by_observer[i, j]
                inner[3 + i, 3 + j] = -by_seen[i, j]
                inner[3 + i, last + 3 + j] = by_seen[i, j]
        if width == 18:
            _fill_left_jacobian((ratio * way[0], ratio * way[1], ratio * way[2]), left)
            _fill_inverse_jacobian(way, -1.0, work)
            _fill_product(left, work, False, share_u)
            _fill_inverse_jacobian(way, 1.0, work)
            _fill_product(left, work, False, share_a)
            _fill_matrix(_exponential(ratio * way[0], ratio * way[1], ratio * way[2]), work)
            for i in range(3):
                for j in range(3):
                    share_a[i, j] = work[i, j] - ratio * share_a[i, j]
                    share_u[i, j] *= ratio
            for i in range(3):
                for j in range(3):
                    inner[i, 6 + j] = -ratio * axes[j, i]
                    totals = (0.0, 0.0, 0.0, 0.0)
                    for k in range(3):
                        totals = (
                            totals[0] + by_observer[i, k] * share_a[k, j],
                            totals[1] + by_observer[i, k] * share_u[k, j],
                            totals[2] - by_seen[i, k] * share_a[k, j],
                            totals[3] - by_seen[i, k] * share_u[k, j],
                        )
                    inner[i, 3 + j], inner[i, 9 + j], inner[3 + i, 3 + j], inner[3 + i, 9 + j] = totals
        for i in range(6):
            for j in range(width):
                total = 0.0
                for k in range(6):
                    total += whitening[n, i, k] * inner[k, j]
                out[n, i, j] = total


@njit(cache=True, nogil=True)
def retract(poses, steps, out):
    """Fill `out` (P, 7) with poses moved by steps (2 P, 3): a translation and a rotation in the map's axes each."""
    for i in range(len(poses)):
        for k in range(3):
            out[i, k] = poses[i, k] + steps[2 * i, k]
        turn = _exponential(steps[2 * i + 1, 0], steps[2 * i + 1, 1], steps[2 * i + 1, 2])
        x, y, z, w = _product(turn, _quaternion(poses[i], 1.0))
        scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
        out[i, 3], out[i, 4], out[i, 5], out[i, 6] = scale * x, scale * y, scale * z, scale * w
