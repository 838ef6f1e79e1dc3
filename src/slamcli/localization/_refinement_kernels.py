# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.localization.refinement`: a pose laid onto the walls of a map."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_BEHIND = 0.2  # cosine between a beam and the slope of the distance from which on the beam has passed the wall


@njit(cache=True, nogil=True)
def _distance(distances, column, row, out):
    """Set `out` (3,) to the distance at a place in cells, between four centres, and its slopes per cell; return whether it lies there."""
    u, v = column - 0.5, row - 0.5
    j, i = math.floor(u), math.floor(v)
    if j < 0 or i < 0 or j + 1 >= distances.shape[1] or i + 1 >= distances.shape[0]:
        return False
    fu, fv = u - j, v - i
    a, b = np.float64(distances[i, j]), np.float64(distances[i, j + 1])
    c, d = np.float64(distances[i + 1, j]), np.float64(distances[i + 1, j + 1])
    out[0] = (a * (1.0 - fu) + b * fu) * (1.0 - fv) + (c * (1.0 - fu) + d * fu) * fv
    out[1] = (b - a) * (1.0 - fv) + (d - c) * fv
    out[2] = (c - a) * (1.0 - fu) + (d - b) * fu
    return True


@njit(cache=True, nogil=True)
def _linearise(points, pose, frame, distances, half, noise, scale, hessian, gradient):
    """Set the normal equations of the distances of `points` (M, 2), seen from `pose` (3,), and return the mean of their weights.

    A wall's surface is `half` metres before the middle of its cells.
    """
    gc, gs, per_metre = math.cos(frame[2]), math.sin(frame[2]), frame[3]
    dx, dy = pose[0] - frame[0], pose[1] - frame[1]
    x, y = gc * dx + gs * dy, gc * dy - gs * dx
    c, s = math.cos(pose[2] - frame[2]), math.sin(pose[2] - frame[2])
    hessian[:] = 0.0
    gradient[:] = 0.0
    found = np.empty(3)
    fit = 0.0
    for m in range(points.shape[0]):
        px, py = c * points[m, 0] - s * points[m, 1], s * points[m, 0] + c * points[m, 1]
        if not _distance(distances, (x + px) * per_metre, (y + py) * per_metre, found):
            continue
        u, v = found[1] * per_metre, found[2] * per_metre
        if u * px + v * py > _BEHIND * math.sqrt(px * px + py * py) and found[0] < 3.0 * half:
            # Past the middle of a thin wall: the face that the beam met is the one before it.
            d, u, v = -found[0] - half, -u, -v
        else:
            d = found[0] - half  # to the face of the wall's cell, negative within it
        weight = math.exp(-d * d / (2.0 * scale * scale))
        fit += weight
        jx, jy, ja = gc * u - gs * v, gs * u + gc * v, v * px - u * py
        k = weight / (noise * noise)
        hessian[0, 0] += k * jx * jx
        hessian[0, 1] += k * jx * jy
        hessian[0, 2] += k * jx * ja
        hessian[1, 1] += k * jy * jy
        hessian[1, 2] += k * jy * ja
        hessian[2, 2] += k * ja * ja
        gradient[0] += k * jx * d
        gradient[1] += k * jy * d
        gradient[2] += k * ja * d
    hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]
    return fit / max(points.shape[0], 1)


@njit(cache=True, nogil=True)
def _solve(h, g):
    """Return the solution of the 3 x 3 system `h` x = `g` with `h` positive definite, by its Cholesky factor; 0 where it is not."""
    a = math.sqrt(max(h[0, 0], 1e-12))
    b, c = h[0, 1] / a, h[0, 2] / a
    d = math.sqrt(max(h[1, 1] - b * b, 1e-12))
    e = (h[1, 2] - b * c) / d
    f = math.sqrt(max(h[2, 2] - c * c - e * e, 1e-12))
    y0 = g[0] / a
    y1 = (g[1] - b * y0) / d
    y2 = (g[2] - c * y0 - e * y1) / f
    z = y2 / f
    y = (y1 - e * z) / d
    return (y0 - b * y - c * z) / a, y, z


@njit(cache=True, nogil=True)
def refine(points, prior, information, frame, distances, half, noise, scale, iterations, pose):
    """Move `pose` (3,) to where `points` (M, 2) lie best on the walls, held to `prior` (3,) by `information` (3, 3).

    Gauss-Newton on the distances of the points to the nearest wall's face, in metres, of standard deviation `noise`; those far off
    `scale` do not pull. Returns the mean of the weights, 1 where all points lie on walls.
    """
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    for _ in range(iterations):
        _linearise(points, pose, frame, distances, half, noise, scale, hessian, gradient)
        turn = pose[2] - prior[2] + math.pi
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi)) + math.pi
        x, y = pose[0] - prior[0], pose[1] - prior[1]
        for i in range(3):
            for j in range(3):
                hessian[i, j] += information[i, j]
            gradient[i] += information[i, 0] * x + information[i, 1] * y + information[i, 2] * turn
        x, y, a = _solve(hessian, gradient)
        pose[0] -= x
        pose[1] -= y
        pose[2] -= a
        if abs(x) < 1e-4 and abs(y) < 1e-4 and abs(a) < 1e-4:
            break
    return _linearise(points, pose, frame, distances, half, noise, scale, hessian, gradient)


@njit(cache=True, nogil=True)
def refine_each(points, poses, information, frame, distances, half, noise, scale, iterations, fit):
    """Do as `refine` for each of `poses` (N, 3), held to where it begins; set `fit` (N,)."""
    prior = np.empty(3)
    for n in range(poses.shape[0]):
        prior[:] = poses[n]
        fit[n] = refine(points, prior, information, frame, distances, half, noise, scale, iterations, poses[n])


@njit(cache=True, nogil=True)
def blocked_shares(points, poses, frame, distances, spare, out):
    """Set `out` (N,) to the share of `points` (M, 2) that `poses` (N, 3) see through a wall: on the way to them, `spare` metres short."""
    height, width = distances.shape
    gc, gs, per_metre = math.cos(frame[2]), math.sin(frame[2]), frame[3]
    for n in range(poses.shape[0]):
        dx, dy = poses[n, 0] - frame[0], poses[n, 1] - frame[1]
        x, y = (gc * dx + gs * dy) * per_metre, (gc * dy - gs * dx) * per_metre
        c, s = math.cos(poses[n, 2] - frame[2]) * per_metre, math.sin(poses[n, 2] - frame[2]) * per_metre
        blocked = 0
        for m in range(points.shape[0]):
            way_x, way_y = c * points[m, 0] - s * points[m, 1], s * points[m, 0] + c * points[m, 1]
            length = math.sqrt(way_x * way_x + way_y * way_y)
            steps = math.floor(length - spare * per_metre)
            for k in range(1, steps):
                column, row = math.floor(x + way_x * k / length), math.floor(y + way_y * k / length)
                if column < 0 or row < 0 or column >= width or row >= height:
                    break
                if distances[row, column] == 0.0:
                    blocked += 1
                    break
        out[n] = blocked / max(points.shape[0], 1)
