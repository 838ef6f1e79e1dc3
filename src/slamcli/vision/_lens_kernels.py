# SPDX-License-Identifier: MIT
"""Rays from distorted coordinates, by Newton's method, one point after the other."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

ITERATIONS = 30
TOLERANCE = 1e-13
ACCEPTED = 1e-9


@njit(cache=True, nogil=True)
def straighten_radial(bent, coefficients, limit, rays, area):
    """Write the rays (N, 2) of distorted coordinates (N, 2) and the local change of area (N,); NaN where there is none.

    `coefficients` are k1 k2 p1 p2 k3 k4 k5 k6; `limit` is the squared radius up to which the model holds.
    """
    k1, k2, p1, p2 = coefficients[0], coefficients[1], coefficients[2], coefficients[3]
    k3, k4, k5, k6 = coefficients[4], coefficients[5], coefficients[6], coefficients[7]
    for i in range(bent.shape[0]):
        x, y = bent[i, 0], bent[i, 1]
        rays[i, 0], rays[i, 1], area[i] = math.nan, math.nan, math.nan
        miss, determinant, square = math.inf, math.nan, 0.0
        for _ in range(ITERATIONS):
            square = x * x + y * y
            top = 1.0 + square * (k1 + square * (k2 + square * k3))
            bottom = 1.0 + square * (k4 + square * (k5 + square * k6))
            if not (abs(bottom) > 1e-12 and square < 1e12):
                determinant = math.nan
                break
            factor = top / bottom
            slope = (
                (k1 + square * (2.0 * k2 + square * 3.0 * k3)) - factor * (k4 + square * (2.0 * k5 + square * 3.0 * k6))
            ) / bottom
            miss_x = bent[i, 0] - (x * factor + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x))
            miss_y = bent[i, 1] - (y * factor + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y)
            xx = factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
            xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
            yy = factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
            determinant = xx * yy - xy * xy
            miss = max(abs(miss_x), abs(miss_y))
            if miss < TOLERANCE or not abs(determinant) > 1e-15:
                break
            x += (yy * miss_x - xy * miss_y) / determinant
            y += (xx * miss_y - xy * miss_x) / determinant
        if miss < ACCEPTED and determinant > 0.0 and square < limit:
            rays[i, 0], rays[i, 1], area[i] = x, y, 1.0 / determinant


@njit(cache=True, nogil=True)
def straighten_fisheye(bent, coefficients, limit, rays, area):
    """The same for a fisheye; `coefficients` are k1 k2 k3 k4, `limit` is the angle up to which the model holds."""
    k1, k2, k3, k4 = coefficients[0], coefficients[1], coefficients[2], coefficients[3]
    furthest = min(limit, 0.5 * np.pi - 1e-6)
    for i in range(bent.shape[0]):
        rays[i, 0], rays[i, 1], area[i] = math.nan, math.nan, math.nan
        wanted = math.sqrt(bent[i, 0] ** 2 + bent[i, 1] ** 2)
        if not math.isfinite(wanted):
            continue
        angle, miss, slope = wanted, math.inf, 1.0
        for _ in range(ITERATIONS):
            s = angle * angle
            miss = wanted - angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
            slope = 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))
            if abs(miss) < TOLERANCE or not (abs(slope) > 1e-12 and s < 1e4):
                break
            angle += miss / slope
        if not (abs(miss) < ACCEPTED and slope > 0.0 and 0.0 <= angle < furthest):
            continue
        radius = math.tan(angle)
        tangential = radius / wanted if wanted > 1e-12 else 1.0
        rays[i, 0], rays[i, 1] = bent[i, 0] * tangential, bent[i, 1] * tangential
        area[i] = tangential * (1.0 + radius * radius) / slope
