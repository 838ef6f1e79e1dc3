# SPDX-License-Identifier: MIT
"""Compiled loops that match points with tiled maps; the layout is described in `slamcli.grids.tiles`.

Poses are x, y, yaw of the base in the map; points are beam end points in the base frame, metres. `view` is a map as
matching sees it: (cells, table of tile indices, x and y of its lower left corner, cell size, its inverse).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TILE = 32
SHIFT = 5
MASK = 31
WIDE = 3
"""Half window, cells, in which the direction of a surface is told."""
FAR = np.float32(1e6)


@njit(cache=True, nogil=True, inline="always")
def _is_full(cells, tile, row, column, fullness):
    """Whether the share of hits among the visits of a cell is over `fullness`."""
    return cells[tile, row, column, 1] > fullness * cells[tile, row, column, 0]


@njit(cache=True, nogil=True, inline="always")
def _nearest_hit(view, x, y, window, fullness):
    """Squared distance from (x, y), metres from the map's corner, to the nearest mean hit point in the window, or FAR.

    A 3 x 3 window that lies in one tile (nine times of ten) is read without branches.
    """
    cells, table, _, _, delta, inverse = view
    rows, columns = table.shape
    low_i, low_j = math.floor(y * inverse) - window, math.floor(x * inverse) - window
    if low_i < 0 or low_j < 0 or (low_i + 2 * window) >> SHIFT >= rows or (low_j + 2 * window) >> SHIFT >= columns:
        return FAR
    best = FAR
    size = np.float32(delta)
    fx, fy = np.float32(x - low_j * delta), np.float32(y - low_i * delta)
    r0, c0 = low_i & MASK, low_j & MASK
    if window == 1 and r0 < TILE - 2 and c0 < TILE - 2:
        tile = np.uint32(table[low_i >> SHIFT, low_j >> SHIFT])
        for a in range(3):
            ry = fy - np.float32(a) * size
            r = np.uint32(r0) + np.uint32(a)
            for b in range(3):
                c = np.uint32(c0) + np.uint32(b)
                dx = fx - np.float32(b) * size - cells[tile, r, c, 2]
                dy = ry - cells[tile, r, c, 3]
                d2 = dx * dx + dy * dy
                best = min(best, d2 if _is_full(cells, tile, r, c, fullness) else FAR)
        return best
    for a in range(2 * window + 1):
        ry = fy - np.float32(a) * size
        for b in range(2 * window + 1):
            i, j = low_i + a, low_j + b
            tile = np.uint32(table[i >> SHIFT, j >> SHIFT])
            r, c = np.uint32(i & MASK), np.uint32(j & MASK)
            dx = fx - np.float32(b) * size - cells[tile, r, c, 2]
            dy = ry - cells[tile, r, c, 3]
            d2 = dx * dx + dy * dy
            best = min(best, d2 if _is_full(cells, tile, r, c, fullness) else FAR)
    return best


@njit(cache=True, nogil=True, inline="always")
def _occupied(view, x, y, fullness):
    """Whether the cell at (x, y), metres from the map's corner, is full."""
    cells, table, _, _, _, inverse = view
    i, j = math.floor(y * inverse), math.floor(x * inverse)
    if i < 0 or j < 0 or i >> SHIFT >= table.shape[0] or j >> SHIFT >= table.shape[1]:
        return False
    return _is_full(cells, table[i >> SHIFT, j >> SHIFT], i & MASK, j & MASK, fullness)


@njit(cache=True, nogil=True, inline="always")
def _beam_distance2(view, px, py, ux, uy, window, fullness, free_check):
    """Squared distance of one end point to its hit, or FAR; with `free_check`, a wall seen from inside does not count."""
    if free_check > 0.0 and _occupied(view, px - free_check * ux, py - free_check * uy, fullness):
        return FAR
    return _nearest_hit(view, px, py, window, fullness)


@njit(cache=True, nogil=True)
def score_pose(view, points, directions, x, y, yaw, window, fullness, free_check, sigma):
    """Sum over beams of exp(-d^2 / sigma)."""
    c, s = math.cos(yaw), math.sin(yaw)
    bx, by = x - view[2], y - view[3]
    full = np.float32(fullness)
    total = 0.0
    for k in range(points.shape[0]):
        px = bx + c * points[k, 0] - s * points[k, 1]
        py = by + s * points[k, 0] + c * points[k, 1]
        ux = c * directions[k, 0] - s * directions[k, 1]
        uy = s * directions[k, 0] + c * directions[k, 1]
        d2 = _beam_distance2(view, px, py, ux, uy, window, full, free_check)
        if d2 < FAR:
            total += math.exp(-d2 / sigma)
    return total


@njit(cache=True, nogil=True)
def log_likelihood(view, points, directions, x, y, yaw, window, fullness, free_check, lsigma):
    """Sum over beams of -d^2 / lsigma, and -0.5 / lsigma for a beam without a hit."""
    c, s = math.cos(yaw), math.sin(yaw)
    bx, by = x - view[2], y - view[3]
    full = np.float32(fullness)
    total = 0.0
    for k in range(points.shape[0]):
        px = bx + c * points[k, 0] - s * points[k, 1]
        py = by + s * points[k, 0] + c * points[k, 1]
        ux = c * directions[k, 0] - s * directions[k, 1]
        uy = s * directions[k, 0] + c * directions[k, 1]
        d2 = _beam_distance2(view, px, py, ux, uy, window, full, free_check)
        total -= d2 / lsigma if d2 < FAR else 0.5 / lsigma
    return total


@njit(cache=True, nogil=True)
def hill_climb(view, points, directions, pose, window, fullness, free_check, sigma, lstep, astep, iterations):
    """Greedy ascent of the score from `pose`: six moves, steps halved when none improves; returns x, y, yaw, score."""
    x, y, yaw = pose[0], pose[1], pose[2]
    current = score_pose(view, points, directions, x, y, yaw, window, fullness, free_check, sigma)
    best = -1.0
    linear, angular = lstep, astep
    refinement = 0
    while current > best or refinement < iterations:
        if best >= current:
            refinement += 1
            linear *= 0.5
            angular *= 0.5
        best = current
        best_x, best_y, best_yaw = x, y, yaw
        for move in range(6):
            sign = 1.0 - 2.0 * (move % 2)
            tx = x + sign * linear if move < 2 else x
            ty = y + sign * linear if 2 <= move < 4 else y
            ta = yaw + sign * angular if move >= 4 else yaw
            trial = score_pose(view, points, directions, tx, ty, ta, window, fullness, free_check, sigma)
            if trial > current:
                current = trial
                best_x, best_y, best_yaw = tx, ty, ta
        x, y, yaw = best_x, best_y, best_yaw
    return x, y, yaw, current


@njit(cache=True, nogil=True)
def sample_likelihoods(cells, tables, corner_x, corner_y, delta, points, directions, poses, offsets, out, first, last,
                       window, fullness, free_check, lsigma):  # fmt: skip
    """Likelihoods out (particles, samples) at each particle's pose plus each offset (samples, 3)."""
    for p in range(first, last):
        view = (cells, tables[p], corner_x, corner_y, delta, 1.0 / delta)
        for k in range(offsets.shape[0]):
            x, y, yaw = poses[p, 0] + offsets[k, 0], poses[p, 1] + offsets[k, 1], poses[p, 2] + offsets[k, 2]
            out[p, k] = log_likelihood(view, points, directions, x, y, yaw, window, fullness, free_check, lsigma)


@njit(cache=True, nogil=True)
def _line(view, px, py, fullness, noise2):
    """How much the mean hits around (px, py) form a line, 0 to 1, and its direction; -1 where there are fewer than three."""
    cells, table, _, _, delta, inverse = view
    low_i, low_j = math.floor(py * inverse) - WIDE, math.floor(px * inverse) - WIDE
    high_i, high_j = low_i + 2 * WIDE, low_j + 2 * WIDE
    if low_i < 0 or low_j < 0 or high_i >> SHIFT >= table.shape[0] or high_j >> SHIFT >= table.shape[1]:
        return -1.0, 1.0, 0.0
    n, sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(low_i, high_i + 1):
        for j in range(low_j, high_j + 1):
            tile = np.uint32(table[i >> SHIFT, j >> SHIFT])
            r, c = np.uint32(i & MASK), np.uint32(j & MASK)
            if _is_full(cells, tile, r, c, fullness):
                dx = cells[tile, r, c, 2] + j * delta - px
                dy = cells[tile, r, c, 3] + i * delta - py
                n += 1.0
                sx += dx
                sy += dy
                sxx += dx * dx
                sxy += dx * dy
                syy += dy * dy
    if n < 3.0:
        return -1.0, 1.0, 0.0
    vxx, vxy, vyy = sxx / n - (sx / n) ** 2 + noise2, sxy / n - sx * sy / (n * n), syy / n - (sy / n) ** 2 + noise2
    half, gap = 0.5 * (vxx + vyy), math.sqrt(0.25 * (vxx - vyy) ** 2 + vxy * vxy)
    angle = 0.5 * math.atan2(2.0 * vxy, vxx - vyy)
    return 2.0 * gap / (half + gap), math.cos(angle), math.sin(angle)


@njit(cache=True, nogil=True, inline="always")
def _surface(view, px, py, window, fullness, noise2, tangent):
    """Mean and inverse covariance of the mean hits around (px, py): count, x, y relative to the point, and ixx ixy iyy.

    Along the surface, the direction in which hits in a wider window spread most, the information counts by `tangent` only,
    as far as they form a line; where there are too few to tell, in every direction.
    """
    cells, table, _, _, delta, inverse = view
    low_i, low_j = math.floor(py * inverse) - window, math.floor(px * inverse) - window
    high_i, high_j = low_i + 2 * window, low_j + 2 * window
    if low_i < 0 or low_j < 0 or high_i >> SHIFT >= table.shape[0] or high_j >> SHIFT >= table.shape[1]:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    n, sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(low_i, high_i + 1):
        for j in range(low_j, high_j + 1):
            tile = np.uint32(table[i >> SHIFT, j >> SHIFT])
            r, c = np.uint32(i & MASK), np.uint32(j & MASK)
            if _is_full(cells, tile, r, c, fullness):
                dx = cells[tile, r, c, 2] + j * delta - px
                dy = cells[tile, r, c, 3] + i * delta - py
                n += 1.0
                sx += dx
                sy += dy
                sxx += dx * dx
                sxy += dx * dy
                syy += dy * dy
    if n == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mx, my = sx / n, sy / n
    vxx, vxy, vyy = sxx / n - mx * mx + noise2, sxy / n - mx * my, syy / n - my * my + noise2
    det = vxx * vyy - vxy * vxy
    if tangent == 1.0:
        return n, mx, my, vyy / det, -vxy / det, vxx / det
    line, ax, ay = _line(view, px, py, fullness, noise2)
    if line < 0.0:
        return n, mx, my, tangent * vyy / det, -tangent * vxy / det, tangent * vxx / det
    # variances of the small window along and across the direction that the wide one tells
    along = ax * ax * vxx + 2.0 * ax * ay * vxy + ay * ay * vyy
    across = ay * ay * vxx - 2.0 * ax * ay * vxy + ax * ax * vyy
    ia, ic = (1.0 - (1.0 - tangent) * line) / along, 1.0 / across
    return n, mx, my, ia * ax * ax + ic * ay * ay, (ia - ic) * ax * ay, ia * ay * ay + ic * ax * ax


@njit(cache=True, nogil=True)
def _linearise(view, points, x, y, yaw, window, fullness, noise2, scale, tangent, hessian, gradient):
    """Add the points' terms to the normal equations; returns how many found a surface and their summed robust weight."""
    c, s = math.cos(yaw), math.sin(yaw)
    bx, by = x - view[2], y - view[3]
    found, quality = 0, 0.0
    for k in range(points.shape[0]):
        rx = c * points[k, 0] - s * points[k, 1]
        ry = s * points[k, 0] + c * points[k, 1]
        n, mx, my, ixx, ixy, iyy = _surface(view, bx + rx, by + ry, window, fullness, noise2, tangent)
        if n == 0.0:
            continue
        weight = scale / (scale + ixx * mx * mx + 2.0 * ixy * mx * my + iyy * my * my)
        found += 1
        quality += weight
        weight *= weight
        ex, ey = -weight * (ixx * mx + ixy * my), -weight * (ixy * mx + iyy * my)
        hx, hy = weight * (ixy * rx - ixx * ry), weight * (iyy * rx - ixy * ry)
        gradient[0] += ex
        gradient[1] += ey
        gradient[2] += ey * rx - ex * ry
        hessian[0, 0] += weight * ixx
        hessian[0, 1] += weight * ixy
        hessian[1, 1] += weight * iyy
        hessian[0, 2] += hx
        hessian[1, 2] += hy
        hessian[2, 2] += hy * rx - hx * ry
    return found, quality


@njit(cache=True, nogil=True, inline="always")
def _solve(hessian, gradient):
    """Solution of hessian * step = -gradient, by the Cholesky factor of the upper triangle."""
    l00 = math.sqrt(hessian[0, 0] + 1e-9)
    l10 = hessian[0, 1] / l00
    l20 = hessian[0, 2] / l00
    l11 = math.sqrt(max(hessian[1, 1] + 1e-9 - l10 * l10, 1e-12))
    l21 = (hessian[1, 2] - l20 * l10) / l11
    l22 = math.sqrt(max(hessian[2, 2] + 1e-9 - l20 * l20 - l21 * l21, 1e-12))
    z0 = -gradient[0] / l00
    z1 = (-gradient[1] - l10 * z0) / l11
    z2 = (-gradient[2] - l20 * z0 - l21 * z1) / l22
    d2 = z2 / l22
    d1 = (z1 - l21 * d2) / l11
    return (z0 - l10 * d1 - l20 * d2) / l00, d1, d2


@njit(cache=True, nogil=True)
def align(view, points, start, prior, information, window, fullness, noise, scale, tangent, max_iterations, hessian):
    """Gauss-Newton alignment of points with the surface that the mean hits of neighbouring cells form.

    Each point is compared with mean and covariance of the mean hits in its window (a distribution, as in generalised
    ICP); a residual counts by inverse(covariance + noise^2) and a Geman-McClure weight of `scale`. The result is drawn
    to `prior` by `information` (3,), its diagonal. Returns x, y, yaw and the quality: the summed weights before
    squaring over the number of points, 1 where every point lies on a surface. `hessian` (3, 3) gets the last normal
    matrix in its upper triangle, in the map's axes about the pose, with `information`.
    """
    x, y, yaw = start[0], start[1], start[2]
    gradient = np.empty(3)
    quality = 0.0
    for _ in range(max_iterations):
        hessian[:] = 0.0
        for q in range(3):
            hessian[q, q] = information[q]
        gradient[0] = information[0] * (x - prior[0])
        gradient[1] = information[1] * (y - prior[1])
        gradient[2] = information[2] * (yaw - prior[2])
        _, total = _linearise(
            view, points, x, y, yaw, window, fullness, noise * noise, scale, tangent, hessian, gradient
        )
        quality = total / max(points.shape[0], 1)
        dx, dy, dyaw = _solve(hessian, gradient)
        x += dx
        y += dy
        yaw += dyaw
        if dx * dx + dy * dy < 1e-8 and dyaw * dyaw < 1e-8:
            break
    return x, y, yaw, quality


@njit(cache=True, nogil=True)
def match_particles(cells, tables, corner_x, corner_y, delta, points, directions, poses, scores, likelihoods, first, last,
                    window, fullness, free_check, sigma, lsigma, lstep, astep, iterations, minimum_score,
                    information, noise, scale, max_alignments):  # fmt: skip
    """Match particles first to last - 1; poses move where the score is over the minimum.

    A hill climb, then at most `max_alignments` Gauss-Newton steps that draw to the predicted pose by `information` (3,).
    """
    hessian = np.empty((3, 3))
    for p in range(first, last):
        view = (cells, tables[p], corner_x, corner_y, delta, 1.0 / delta)
        x, y, yaw, score = hill_climb(
            view, points, directions, poses[p], window, fullness, free_check, sigma, lstep, astep, iterations
        )
        if max_alignments > 0:
            climbed = np.array([x, y, yaw])
            x, y, yaw, _ = align(
                view,
                points,
                climbed,
                poses[p],
                information,
                window,
                fullness,
                noise,
                scale,
                1.0,
                max_alignments,
                hessian,
            )
            score = score_pose(view, points, directions, x, y, yaw, window, fullness, free_check, sigma)
        scores[p] = score
        if score > minimum_score:
            poses[p, 0], poses[p, 1], poses[p, 2] = x, y, yaw
        likelihoods[p] = log_likelihood(
            view, points, directions, poses[p, 0], poses[p, 1], poses[p, 2], window, fullness, free_check, lsigma
        )
