# SPDX-License-Identifier: MIT
"""Compiled loops that match points with the 2D grid of a submap; see `slamcli.registration.grid_matching`.

`weights` (H, W) belong to grids of signed distances; for grids of correspondence costs it is empty.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, inline="always")
def _cubic(a, b, c, d, t):
    """Cubic convolution (Keys 1981) through four samples: the value between b and c, and its derivative."""
    e = 0.5 * (-a + 3.0 * b - 3.0 * c + d)
    f = 0.5 * (2.0 * a - 5.0 * b + 4.0 * c - d)
    g = 0.5 * (-a + c)
    return b + t * (g + t * (f + t * e)), g + t * (2.0 * f + 3.0 * e * t)


@njit(cache=True, nogil=True, inline="always")
def _cost(cells, table, i, j):
    """Cost of a cell; the one of unknown cells outside."""
    if i < 0 or j < 0 or i >= cells.shape[0] or j >= cells.shape[1]:
        return table[0]
    return table[cells[i, j]]


@njit(cache=True, nogil=True)
def interpolate(cells, table, u, v):
    """Bicubic cost at column u and row v (fractions of cells from the first cell's centre), and its derivatives by u, v."""
    j, i = math.floor(u), math.floor(v)
    t, w = u - j, v - i
    if i < -2 or j < -2 or i > cells.shape[0] + 1 or j > cells.shape[1] + 1:
        return table[0], 0.0, 0.0
    f0, d0 = _cubic(
        _cost(cells, table, i - 1, j - 1),
        _cost(cells, table, i - 1, j),
        _cost(cells, table, i - 1, j + 1),
        _cost(cells, table, i - 1, j + 2),
        t,
    )
    f1, d1 = _cubic(
        _cost(cells, table, i, j - 1),
        _cost(cells, table, i, j),
        _cost(cells, table, i, j + 1),
        _cost(cells, table, i, j + 2),
        t,
    )
    f2, d2 = _cubic(
        _cost(cells, table, i + 1, j - 1),
        _cost(cells, table, i + 1, j),
        _cost(cells, table, i + 1, j + 1),
        _cost(cells, table, i + 1, j + 2),
        t,
    )
    f3, d3 = _cubic(
        _cost(cells, table, i + 2, j - 1),
        _cost(cells, table, i + 2, j),
        _cost(cells, table, i + 2, j + 1),
        _cost(cells, table, i + 2, j + 2),
        t,
    )
    value, dv = _cubic(f0, f1, f2, f3, w)
    du, _ = _cubic(d0, d1, d2, d3, w)
    return value, du, dv


@njit(cache=True, nogil=True)
def interpolate_distance(cells, weights, table, u, v):
    """Bilinear distance at column u and row v and its derivatives by u, v; then the same of the stored weight.

    Next to an unknown cell the distance is that of `table` for unknown cells, and flat.
    """
    j, i = math.floor(u), math.floor(v)
    t, w = u - j, v - i
    distance, by_u, by_v, weight, weight_u, weight_v = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    known = True
    for di in range(2):
        share_v, slope_v = (w, 1.0) if di == 1 else (1.0 - w, -1.0)
        for dj in range(2):
            share_u, slope_u = (t, 1.0) if dj == 1 else (1.0 - t, -1.0)
            row, column = i + di, j + dj
            if row < 0 or column < 0 or row >= cells.shape[0] or column >= cells.shape[1] or weights[row, column] < 2:
                known = False
                continue
            value, stored = table[cells[row, column]], weights[row, column] - 1.0
            distance += share_u * share_v * value
            by_u += slope_u * share_v * value
            by_v += share_u * slope_v * value
            weight += share_u * share_v * stored
            weight_u += slope_u * share_v * stored
            weight_v += share_u * slope_v * stored
    if not known:
        distance, by_u, by_v = np.float64(table[0]), 0.0, 0.0
    return distance, by_u, by_v, weight, weight_u, weight_v


@njit(cache=True, nogil=True)
def _linearise_distances(cells, weights, table, ox, oy, inverse, points, pose, scale, hessian, gradient):
    """Normal equations of the distance term at a pose: residual k is ``scale * N * d_k w_k / (w_1 + ... + w_N)``.

    Returns its cost, half of the squared residuals' sum; infinite where no point lies on a known cell.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    hessian[:] = 0.0
    gradient[:] = 0.0
    j, total_j = np.empty(3), np.zeros(3)
    squares, total = 0.0, 0.0
    for k in range(points.shape[0]):
        rx = c * points[k, 0] - s * points[k, 1]
        ry = s * points[k, 0] + c * points[k, 1]
        d, du, dv, w, wu, wv = interpolate_distance(
            cells, weights, table, (pose[0] + rx - ox) * inverse - 0.5, (pose[1] + ry - oy) * inverse - 0.5
        )
        r = d * w
        j[0], j[1] = (du * w + d * wu) * inverse, (dv * w + d * wv) * inverse
        j[2] = j[1] * rx - j[0] * ry
        squares += r * r
        total += w
        total_j[0] += wu * inverse
        total_j[1] += wv * inverse
        total_j[2] += (wv * rx - wu * ry) * inverse
        for a in range(3):
            gradient[a] += j[a] * r
            for b in range(a, 3):
                hessian[a, b] += j[a] * j[b]
    if total <= 0.0:
        return math.inf
    factor = scale * points.shape[0] / total
    total_j /= total
    for a in range(3):  # the derivative of a quotient, its denominator the same for all residuals
        for b in range(a, 3):
            hessian[a, b] += squares * total_j[a] * total_j[b] - gradient[a] * total_j[b] - total_j[a] * gradient[b]
            hessian[a, b] *= factor * factor
    for a in range(3):
        gradient[a] = factor * factor * (gradient[a] - squares * total_j[a])
    return 0.5 * factor * factor * squares


@njit(cache=True, nogil=True)
def _linearise(cells, weights, table, ox, oy, inverse, points, pose, weight, hessian, gradient):
    """Normal equations of the occupied-space term at a pose; returns its cost, a half of the squared residuals' sum."""
    if weights.size > 0:
        return _linearise_distances(cells, weights, table, ox, oy, inverse, points, pose, weight, hessian, gradient)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    hessian[:] = 0.0
    gradient[:] = 0.0
    for k in range(points.shape[0]):
        rx = c * points[k, 0] - s * points[k, 1]
        ry = s * points[k, 0] + c * points[k, 1]
        value, du, dv = interpolate(
            cells, table, (pose[0] + rx - ox) * inverse - 0.5, (pose[1] + ry - oy) * inverse - 0.5
        )
        r = weight * value
        jx, jy = weight * du * inverse, weight * dv * inverse
        jt = jy * rx - jx * ry
        total += 0.5 * r * r
        gradient[0] += jx * r
        gradient[1] += jy * r
        gradient[2] += jt * r
        hessian[0, 0] += jx * jx
        hessian[0, 1] += jx * jy
        hessian[0, 2] += jx * jt
        hessian[1, 1] += jy * jy
        hessian[1, 2] += jy * jt
        hessian[2, 2] += jt * jt
    return total


@njit(cache=True, nogil=True)
def _solve3(h, g):
    """Solution of h * step = -g for the upper triangle of a positive definite h (3, 3)."""
    l00 = math.sqrt(max(h[0, 0], 1e-30))
    l10, l20 = h[0, 1] / l00, h[0, 2] / l00
    l11 = math.sqrt(max(h[1, 1] - l10 * l10, 1e-30))
    l21 = (h[1, 2] - l20 * l10) / l11
    l22 = math.sqrt(max(h[2, 2] - l20 * l20 - l21 * l21, 1e-30))
    z0 = -g[0] / l00
    z1 = (-g[1] - l10 * z0) / l11
    z2 = (-g[2] - l20 * z0 - l21 * z1) / l22
    d2 = z2 / l22
    d1 = (z1 - l21 * d2) / l11
    return (z0 - l10 * d1 - l20 * d2) / l00, d1, d2


@njit(cache=True, nogil=True)
def match(
    cells, weights, table, ox, oy, inverse, points, start, prior, occupied, translation, rotation, max_iterations
):
    """Levenberg-Marquardt on the interpolated grid with a pull to `prior`; returns x, y, yaw and the cost of the grid term.

    Where the grid says nothing at the start (an infinite cost), it stays there.
    """
    weight = occupied / math.sqrt(max(points.shape[0], 1))
    pose = start.copy()
    trial = np.empty(3)
    h, g = np.empty((3, 3)), np.empty(3)
    wt, wr = translation * translation, rotation * rotation
    grid_cost = _linearise(cells, weights, table, ox, oy, inverse, points, pose, weight, h, g)
    dx, dy, da = pose[0] - prior[0], pose[1] - prior[1], pose[2] - prior[2]
    cost = grid_cost + 0.5 * (wt * (dx * dx + dy * dy) + wr * da * da)
    if cost == math.inf:
        return pose[0], pose[1], pose[2], cost
    radius = 1e4
    damped, hessian, gradient = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    shrink = 2.0
    for _ in range(max_iterations):
        g[0] += wt * dx
        g[1] += wt * dy
        g[2] += wr * da
        h[0, 0] += wt
        h[1, 1] += wt
        h[2, 2] += wr
        accepted, small = False, False
        for _ in range(8):
            damped[:] = h
            for q in range(3):
                damped[q, q] += min(max(h[q, q], 1e-6), 1e32) / radius
            sx, sy, sa = _solve3(damped, g)
            trial[0], trial[1], trial[2] = pose[0] + sx, pose[1] + sy, pose[2] + sa
            small = sx * sx + sy * sy < 1e-10 and sa * sa < 1e-10
            new_grid = _linearise(cells, weights, table, ox, oy, inverse, points, trial, weight, hessian, gradient)
            ex, ey, ea = trial[0] - prior[0], trial[1] - prior[1], trial[2] - prior[2]
            new_cost = new_grid + 0.5 * (wt * (ex * ex + ey * ey) + wr * ea * ea)
            if new_cost <= cost:
                accepted = True
                break
            if small:
                break
            radius /= shrink
            shrink *= 2.0
        if not accepted:
            break
        done = small or cost - new_cost < 1e-6 * cost
        pose[:], h[:], g[:] = trial, hessian, gradient
        dx, dy, da, cost, grid_cost = ex, ey, ea, new_cost, new_grid
        radius = min(radius * 3.0, 1e16)
        shrink = 2.0
        if done:
            break
    return pose[0], pose[1], pose[2], grid_cost


@njit(cache=True, nogil=True)
def score(cells, probability, ox, oy, inverse, points, x, y, yaw):
    """Mean probability of the cells in which the points fall; `probability` is a table by stored value."""
    c, s = math.cos(yaw), math.sin(yaw)
    total = 0.0
    for k in range(points.shape[0]):
        j = math.floor((x + c * points[k, 0] - s * points[k, 1] - ox) * inverse)
        i = math.floor((y + s * points[k, 0] + c * points[k, 1] - oy) * inverse)
        total += _cost(cells, probability, i, j)
    return total / max(points.shape[0], 1)


@njit(cache=True, nogil=True)
def _weighted(cells, weights, scores, rows, columns, i, j):
    """Sum of the weighted scores of cells moved by (i, j), and of the weights; 0 and 1 where nothing is known."""
    total, count = 0.0, 0.0
    for k in range(rows.shape[0]):
        row, column = rows[k] + i, columns[k] + j
        if 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]:
            weight = max(weights[row, column] - 1.0, 0.0)
            total += weight * scores[cells[row, column]]
            count += weight
    return (total, count) if count > 0.0 else (0.0, 1.0)


@njit(cache=True, nogil=True)
def best_in_window(
    cells,
    weights,
    scores,
    ox,
    oy,
    inverse,
    points,
    prior,
    linear_cells,
    step,
    turns,
    delta_step,
    translation_weight,
    rotation_weight,
):
    """Exhaustive search (real-time correlative matcher): the pose of the best mean score with a penalty for its distance.

    `scores` is a table by stored value. Where cells have weights they weigh the mean, and a mean without weight is 0.
    """
    best, bx, by, ba = -1.0, prior[0], prior[1], prior[2]
    n = points.shape[0]
    rows, columns = np.empty(n, np.int64), np.empty(n, np.int64)
    for a in range(-turns, turns + 1):
        yaw = prior[2] + a * delta_step
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(n):
            columns[k] = math.floor((prior[0] + c * points[k, 0] - s * points[k, 1] - ox) * inverse)
            rows[k] = math.floor((prior[1] + s * points[k, 0] + c * points[k, 1] - oy) * inverse)
        for i in range(-linear_cells, linear_cells + 1):
            for j in range(-linear_cells, linear_cells + 1):
                total, count = 0.0, float(max(n, 1))
                if weights.size > 0:
                    total, count = _weighted(cells, weights, scores, rows, columns, i, j)
                else:
                    for k in range(n):
                        total += _cost(cells, scores, rows[k] + i, columns[k] + j)
                penalty = math.hypot(i * step, j * step) * translation_weight + abs(a * delta_step) * rotation_weight
                value = total / count * math.exp(-penalty * penalty)
                if value > best:
                    best, bx, by, ba = value, prior[0] + j * step, prior[1] + i * step, yaw
    return bx, by, ba, best


@njit(cache=True, nogil=True)
def spread(cells, probability, ox, oy, inverse, points, pose, half, step, temperature, out):
    """Mean and covariance of the translation over a window of ``2 * half + 1`` steps of `step` cells about a pose.

    Each offset weighs exp((score - score at the pose) / temperature), at most 1. `out` is float64 (5,): mean x, mean y,
    covariance xx, xy, yy, in cells.
    """
    n = points.shape[0]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rows, columns = np.empty(n, np.int64), np.empty(n, np.int64)
    for k in range(n):
        columns[k] = math.floor((pose[0] + c * points[k, 0] - s * points[k, 1] - ox) * inverse)
        rows[k] = math.floor((pose[1] + s * points[k, 0] + c * points[k, 1] - oy) * inverse)
    best = 0.0
    for k in range(n):
        best += _cost(cells, probability, rows[k], columns[k])
    total, mx, my, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            value = 0.0
            for k in range(n):
                value += _cost(cells, probability, rows[k] + i * step, columns[k] + j * step)
            weight = math.exp(min((value - best) / (max(n, 1) * temperature), 0.0))
            x, y = j * step, i * step
            total += weight
            mx += weight * x
            my += weight * y
            xx += weight * x * x
            xy += weight * x * y
            yy += weight * y * y
    out[0], out[1] = mx / total, my / total
    out[2], out[3], out[4] = xx / total, xy / total, yy / total
