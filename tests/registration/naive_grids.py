# SPDX-License-Identifier: MIT
"""Naive twins of the matching of points with submaps' grids: plain NumPy in float64, and searches by brute force."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.optimize import least_squares

from slamcli.grids.tsdf_grid import TsdfGrid


def costs(grid):
    """Correspondence costs (H, W); unknown cells cost as much as free ones."""
    return np.where(grid.cells == 0, 0.9, 0.1 + (grid.cells.astype(np.float64) - 1.0) * 0.8 / 32766.0)


def placed(points, pose):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(points) @ np.array([[c, s], [-s, c]]) + np.asarray(pose[:2])


def keys(distance):
    """Kernel of cubic convolution with a = -1/2 (Keys 1981, equation 15)."""
    d = np.abs(distance)
    outer = np.where(d < 2.0, -0.5 * d**3 + 2.5 * d**2 - 4.0 * d + 2.0, 0.0)
    return np.where(d < 1.0, 1.5 * d**3 - 2.5 * d**2 + 1.0, outer)


def bicubic(grid, x, y):
    """Cost at points (N,): a weighted sum over all cells near each, 0.9 for those outside."""
    table = costs(grid)
    u, v = (x - grid.origin[0]) / grid.resolution_m - 0.5, (y - grid.origin[1]) / grid.resolution_m - 0.5
    total = np.zeros(np.shape(x))
    for di, dj in itertools.product(range(-2, 4), repeat=2):
        i, j = np.floor(v).astype(int) + di, np.floor(u).astype(int) + dj
        inside = (i >= 0) & (j >= 0) & (i < table.shape[0]) & (j < table.shape[1])
        cost = np.where(inside, table[np.where(inside, i, 0), np.where(inside, j, 0)], 0.9)
        total += cost * keys(v - i) * keys(u - j)
    return total


def distances(grid):
    """Signed distances and weights (H, W); as far as can be and 0 where unknown."""
    cut = grid.truncation_distance_m
    metres = (grid.tsd.astype(np.float64) - 1.0) * 2.0 * cut / 32766.0 - cut
    weights = np.maximum(grid.weights.astype(np.float64) - 1.0, 0.0)
    return np.where(grid.tsd == 0, cut, metres), weights


def bilinear(grid, x, y):
    """Distance and weight at points (N,); next to a cell without weight the distance is as far as can be."""
    metres, weights = distances(grid)
    u, v = (x - grid.origin[0]) / grid.resolution_m - 0.5, (y - grid.origin[1]) / grid.resolution_m - 0.5
    distance, weight, known = np.zeros(np.shape(x)), np.zeros(np.shape(x)), np.ones(np.shape(x), bool)
    for di, dj in itertools.product((0, 1), repeat=2):
        i, j = np.floor(v).astype(int) + di, np.floor(u).astype(int) + dj
        inside = (i >= 0) & (j >= 0) & (i < metres.shape[0]) & (j < metres.shape[1])
        i, j, share = np.where(inside, i, 0), np.where(inside, j, 0), (1 - abs(v - i)) * (1 - abs(u - j))
        here = np.where(inside, weights[i, j], 0.0)
        known &= here > 0
        distance += np.where(inside, share * metres[i, j], 0.0)
        weight += np.where(inside, share * here, 0.0)
    return np.where(known, distance, grid.truncation_distance_m), weight


def grid_residuals(grid, points, pose, weight):
    """Residuals of the points alone."""
    x, y = placed(points, pose).T
    if not isinstance(grid, TsdfGrid):
        return weight / math.sqrt(len(points)) * bicubic(grid, x, y)
    distance, weights = bilinear(grid, x, y)
    return weight * math.sqrt(len(points)) * distance * weights / weights.sum()


def residuals(grid, points, pose, prior, settings):
    """All residuals of the least squares match, those of the points first."""
    pull = [settings.translation_weight * (pose[k] - prior[k]) for k in (0, 1)]
    turn = settings.rotation_weight * (pose[2] - prior[2])
    return np.array([*grid_residuals(grid, points, pose, settings.occupied_space_weight), *pull, turn])


def matched(grid, points, start, prior, settings):
    """The optimum by SciPy with derivatives by differences."""
    found = least_squares(lambda pose: residuals(grid, points, pose, prior, settings), start, xtol=1e-12, ftol=1e-12)
    return found.x, float(found.cost)


def scores(grid, reach=None):
    """How well a point fits into each cell, 0.1 (unknown cells too) to 0.9; of distances down to `reach`, metres."""
    if isinstance(grid, TsdfGrid):
        reach = min(3 * grid.resolution_m, grid.truncation_distance_m) if reach is None else reach
        return 0.9 - 0.8 * np.minimum(np.abs(distances(grid)[0]) / reach, 1.0)
    return 1.0 - costs(grid)


def cells_of(grid, points, pose):
    """Rows and columns in which points fall."""
    inverse = 1.0 / grid.resolution_m
    x, y = (placed(points, pose) - np.array(grid.origin)).T
    return np.floor(y * inverse).astype(int), np.floor(x * inverse).astype(int)


def mean_at(values, rows, columns, outside):
    """Mean of an array's values at cells."""
    inside = (rows >= 0) & (columns >= 0) & (rows < values.shape[0]) & (columns < values.shape[1])
    picked = values[np.where(inside, rows, 0), np.where(inside, columns, 0)]
    return float(np.where(inside, picked, outside).mean())


def weighted_mean_at(values, weights, rows, columns):
    """Mean of an array's values at cells by weight, 0 where there is none."""
    inside = (rows >= 0) & (columns >= 0) & (rows < values.shape[0]) & (columns < values.shape[1])
    picked, share = values[rows[inside], columns[inside]], weights[rows[inside], columns[inside]]
    return float((picked * share).sum() / share.sum()) if share.sum() > 0 else 0.0


def mean_probability(grid, points, pose):
    return mean_at(scores(grid), *cells_of(grid, points, pose), 0.1)


def best_in_window(grid, points, prior, half_cells, num_turns, turn_step, penalty):
    """Score and pose of the best of all shifts by whole cells and turns by whole steps; the first of equals."""
    values, best = scores(grid, getattr(grid, "truncation_distance_m", None)), (-1.0, None)
    for a in range(-num_turns, num_turns + 1):
        yaw = prior[2] + a * turn_step
        rows, columns = cells_of(grid, points, (prior[0], prior[1], yaw))
        for i, j in itertools.product(range(-half_cells, half_cells + 1), repeat=2):
            far = penalty[0] * grid.resolution_m * math.hypot(i, j) + penalty[1] * abs(a) * turn_step
            if isinstance(grid, TsdfGrid):
                score = weighted_mean_at(values, distances(grid)[1], rows + i, columns + j) * math.exp(-(far**2))
            else:
                score = mean_at(values, rows + i, columns + j, 0.1) * math.exp(-(far**2))
            if score > best[0] + 1e-9:
                best = score, (prior[0] + j * grid.resolution_m, prior[1] + i * grid.resolution_m, yaw)
    return best


def bytes_of(grid):
    """Scores 0.1 to 0.9 as 0 to 255."""
    return np.round((scores(grid) - 0.1) / 0.8 * 255.0).astype(np.int64)


def window_maxima(values, size):
    """For each window of size by size cells that touches the array the maximum, windows that begin before it included."""
    padded = np.pad(values, size - 1)
    rows, columns = values.shape[0] + size - 1, values.shape[1] + size - 1
    return np.array([[padded[i : i + size, j : j + size].max() for j in range(columns)] for i in range(rows)])


def best_sum(grid, points, prior, half_cells, num_turns, turn_step):
    """Greatest sum of bytes over all shifts and turns, and the poses that reach it."""
    values, best, poses = bytes_of(grid), -1, []
    for a in range(-num_turns, num_turns + 1):
        yaw = prior[2] + a * turn_step
        rows, columns = cells_of(grid, points, (prior[0], prior[1], yaw))
        for i, j in itertools.product(range(-half_cells, half_cells + 1), repeat=2):
            inside = (
                (rows + i >= 0) & (columns + j >= 0) & (rows + i < values.shape[0]) & (columns + j < values.shape[1])
            )
            total = int(values[(rows + i)[inside], (columns + j)[inside]].sum())
            if total > best:
                best, poses = total, []
            if total == best:
                poses.append((prior[0] + j * grid.resolution_m, prior[1] + i * grid.resolution_m, yaw))
    return best, poses


def position_spread(grid, points, pose, half, step, temperature):
    """Covariance, m^2, of positions on a raster of `step` cells, each weighed by how well the points fit there."""
    values, (rows, columns) = scores(grid), cells_of(grid, points, pose)
    here, weights, places = mean_at(values, rows, columns, 0.1), [], []
    for i, j in itertools.product(range(-half, half + 1), repeat=2):
        fit = mean_at(values, rows + i * step, columns + j * step, 0.1)
        weights.append(math.exp(min((fit - here) / temperature, 0.0)))
        places.append(np.array([j, i]) * step * grid.resolution_m)
    return np.einsum("k,ki,kj->ij", weights, places, places) / sum(weights)
