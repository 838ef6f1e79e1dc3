# SPDX-License-Identifier: MIT
"""Similarity of two cameras from matched points: Levenberg-Marquardt on the reprojection errors both ways."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

NEAREST = 1e-6  # units of the map ahead of a camera from which on a point counts as seen
BEHIND = 1e8  # chi2 of an active point behind a camera


@njit(cache=True, nogil=True)
def _project(x, y, z, pixel, weight, camera, error, jacobian):
    """Error (2,) and its derivative (2, 3) by the point in the camera's frame; return chi2, BEHIND if it lies behind."""
    if not z > NEAREST:
        return BEHIND
    error[0] = camera[0] * x / z + camera[2] - pixel[0]
    error[1] = camera[1] * y / z + camera[3] - pixel[1]
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = camera[0] / z, 0.0, -camera[0] * x / (z * z)
    jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = 0.0, camera[1] / z, -camera[1] * y / (z * z)
    return weight * (error[0] * error[0] + error[1] * error[1])


@njit(cache=True, nogil=True)
def _accumulate(rows, error, weight, hessian, gradient):
    """Add weight J'J and weight J'e of two rows (2, 7)."""
    for i in range(7):
        gradient[i] += weight * (rows[0, i] * error[0] + rows[1, i] * error[1])
        for j in range(7):
            hessian[i, j] += weight * (rows[0, i] * rows[0, j] + rows[1, i] * rows[1, j])


@njit(cache=True, nogil=True)
def linearise(
    similarity, first, second, pixels_1, pixels_2, weights_1, weights_2, camera, bound, robust, active, chi2, hessian,
    gradient,
):  # fmt: skip
    """Fill chi2 (N, 2) of all matches, and the normal equations (7, 7), (7,) of the active ones; return half their losses.

    `similarity` (13,): rotation row by row, translation, scale of p_1 = s R p_2 + t. The increment is (phi, rho, sigma) in
    the first camera's axes: p_1 becomes e^sigma Exp(phi) p_1 + rho.
    """
    R, t, scale = similarity[:9].copy().reshape(3, 3), similarity[9:12], similarity[12]
    error, projection, rows, q = np.empty(2), np.empty((2, 3)), np.empty((2, 7)), np.empty(3)
    hessian[:] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    for n in range(len(first)):
        for side in range(2):
            if side == 0:  # the second camera's point in the first image
                for i in range(3):
                    q[i] = scale * (R[i, 0] * second[n, 0] + R[i, 1] * second[n, 1] + R[i, 2] * second[n, 2]) + t[i]
                square = _project(q[0], q[1], q[2], pixels_1[n], weights_1[n], camera, error, projection)
                weight = weights_1[n]
            else:  # the first camera's point in the second image
                a, b, c = first[n, 0] - t[0], first[n, 1] - t[1], first[n, 2] - t[2]
                for i in range(3):
                    q[i] = (R[0, i] * a + R[1, i] * b + R[2, i] * c) / scale
                square = _project(q[0], q[1], q[2], pixels_2[n], weights_2[n], camera, error, projection)
                weight = weights_2[n]
            chi2[n, side] = square
            if not active[n]:
                continue
            if robust and square > bound:
                cost += 0.5 * (2.0 * math.sqrt(bound * square) - bound)
                weight *= math.sqrt(bound / square)
            else:
                cost += 0.5 * square
            if square >= BEHIND:
                continue
            for r in range(2):
                if side == 0:
                    k0, k1, k2 = projection[r, 0], projection[r, 1], projection[r, 2]
                    x, y, z = q[0], q[1], q[2]
                else:
                    k0 = -(projection[r, 0] * R[0, 0] + projection[r, 1] * R[0, 1] + projection[r, 2] * R[0, 2]) / scale
                    k1 = -(projection[r, 0] * R[1, 0] + projection[r, 1] * R[1, 1] + projection[r, 2] * R[1, 2]) / scale
                    k2 = -(projection[r, 0] * R[2, 0] + projection[r, 1] * R[2, 1] + projection[r, 2] * R[2, 2]) / scale
                    x, y, z = first[n, 0], first[n, 1], first[n, 2]
                rows[r, 0], rows[r, 1], rows[r, 2] = y * k2 - z * k1, z * k0 - x * k2, x * k1 - y * k0
                rows[r, 3], rows[r, 4], rows[r, 5] = k0, k1, k2
                rows[r, 6] = k0 * x + k1 * y + k2 * z
            _accumulate(rows, error, weight, hessian, gradient)
    return cost


@njit(cache=True, nogil=True)
def move(similarity, delta, out):
    """Write the similarity after an increment (7,) to `out` (13,)."""
    x, y, z = delta[0], delta[1], delta[2]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < 1e-5:
        a, b = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    turn = np.empty((3, 3))
    turn[0, 0], turn[0, 1], turn[0, 2] = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    turn[1, 0], turn[1, 1], turn[1, 2] = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
    turn[2, 0], turn[2, 1], turn[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)
    growth = math.exp(delta[6])
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += turn[i, k] * similarity[3 * k + j]
            out[3 * i + j] = total
        total = 0.0
        for k in range(3):
            total += turn[i, k] * similarity[9 + k]
        out[9 + i] = growth * total + delta[3 + i]
    out[12] = growth * similarity[12]
