# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.grids.ground`: normals of small neighbourhoods, and clusters of points."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, inline="always")
def _least_axis(a, b, c, d, e, f):
    """The eigenvector of the least eigenvalue of the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]]; zeros where there is no single one.

    The eigenvalue is a root of the characteristic polynomial by the cosine formula; the vector is orthogonal to two rows of
    what is left of the matrix without it.
    """
    mean = (a + d + f) / 3.0
    off = b * b + c * c + e * e
    spread = (a - mean) ** 2 + (d - mean) ** 2 + (f - mean) ** 2 + 2.0 * off
    if spread <= 0.0:
        return 0.0, 0.0, 0.0
    scale = math.sqrt(spread / 6.0)
    a1, b1, c1 = (a - mean) / scale, b / scale, c / scale
    d1, e1, f1 = (d - mean) / scale, e / scale, (f - mean) / scale
    half = 0.5 * (a1 * (d1 * f1 - e1 * e1) - b1 * (b1 * f1 - e1 * c1) + c1 * (b1 * e1 - d1 * c1))
    angle = math.acos(min(1.0, max(-1.0, half))) / 3.0
    least = 2.0 * math.cos(angle + 2.0 * math.pi / 3.0)
    a1, d1, f1 = a1 - least, d1 - least, f1 - least
    best, x, y, z = 0.0, 0.0, 0.0, 0.0
    for which in range(3):
        if which == 0:
            u, v, w = b1 * e1 - c1 * d1, c1 * b1 - a1 * e1, a1 * d1 - b1 * b1
        elif which == 1:
            u, v, w = b1 * f1 - c1 * e1, c1 * c1 - a1 * f1, a1 * e1 - b1 * c1
        else:
            u, v, w = d1 * f1 - e1 * e1, e1 * c1 - b1 * f1, b1 * e1 - d1 * c1
        length = u * u + v * v + w * w
        if length > best:
            best, x, y, z = length, u, v, w
    if best < 1e-12:
        return 0.0, 0.0, 0.0
    best = math.sqrt(best)
    return x / best, y / best, z / best


@njit(cache=True, nogil=True)
def find_flat(points, neighbours, view, least_cos, ground_normals_up, flat):
    """Write into `flat` (N,) whether the surface about each point (N, 3) lies flat, seen from `view` (3,).

    Parameters
    ----------
    neighbours
        int64 (N, K), rows of `points`.
    least_cos
        Least cosine of the angle between the normal, turned to the viewer, and z.
    ground_normals_up
        A normal whose z is below minus this, of a point below the viewer, is turned up; 0 for none.
    """
    k = neighbours.shape[1]
    for i in range(len(points)):
        mx, my, mz = 0.0, 0.0, 0.0
        for j in range(k):
            n = neighbours[i, j]
            mx, my, mz = mx + points[n, 0], my + points[n, 1], mz + points[n, 2]
        mx, my, mz = mx / k, my / k, mz / k
        xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(k):
            n = neighbours[i, j]
            x, y, z = points[n, 0] - mx, points[n, 1] - my, points[n, 2] - mz
            xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
            yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
        nx, ny, nz = _least_axis(xx, xy, xz, yy, yz, zz)
        towards = nx * (view[0] - points[i, 0]) + ny * (view[1] - points[i, 1]) + nz * (view[2] - points[i, 2])
        if towards < 0.0:
            nz = -nz
        if ground_normals_up > 0.0 and nz < -ground_normals_up and points[i, 2] < view[2]:
            nz = -nz
        flat[i] = nz > least_cos


@njit(cache=True, nogil=True)
def join_cells(points, order, keys, starts, radius, parents):
    """Join points (N, 3) no more than `radius` apart into clusters: `parents` (N,) becomes the first point of each one's cluster.

    Parameters
    ----------
    order
        int64 (N,), points by the cell they lie in; cells have an edge of at most ``radius / sqrt(3)``, and at least half the radius.
    keys
        int64 (M,), rising, of the cells: ``x << 42 | y << 21 | z``.
    starts
        int64 (M + 1,), where each cell begins in `order`.
    """
    for i in range(len(parents)):
        parents[i] = i
    squared = radius * radius
    for m in range(len(keys)):
        first = order[starts[m]]
        for s in range(starts[m] + 1, starts[m + 1]):
            _join(parents, first, order[s])
    for m in range(len(keys)):
        for dx in range(3):
            for dy in range(-2, 3):
                for dz in range(-2, 3):
                    if dx == 0 and (dy < 0 or (dy == 0 and dz <= 0)):
                        continue
                    other = keys[m] + (dx << 42) + (dy << 21) + dz
                    n = np.searchsorted(keys, other)
                    if n == len(keys) or keys[n] != other:
                        continue
                    if _root(parents, order[starts[m]]) != _root(parents, order[starts[n]]):
                        _join_near(points, order, starts, m, n, squared, parents)
    for i in range(len(parents)):
        parents[i] = _root(parents, i)


@njit(cache=True, nogil=True)
def _join_near(points, order, starts, m, n, squared, parents):
    """Join two cells if points of them are near."""
    for s in range(starts[m], starts[m + 1]):
        a = order[s]
        for t in range(starts[n], starts[n + 1]):
            b = order[t]
            x, y, z = points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], points[a, 2] - points[b, 2]
            if x * x + y * y + z * z <= squared:
                _join(parents, a, b)
                return


@njit(cache=True, nogil=True)
def _root(parents, i):
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@njit(cache=True, nogil=True)
def _join(parents, a, b):
    """Put two clusters together under the point that comes first."""
    a, b = _root(parents, a), _root(parents, b)
    if a < b:
        parents[b] = a
    else:
        parents[a] = b
