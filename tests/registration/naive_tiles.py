# SPDX-License-Identifier: MIT
"""Naive twins of the kernels that match points with tiled maps: plain Python, one cell at a time, float64."""

from __future__ import annotations

import math

import numpy as np


class NaiveView:
    """One tiled map as a function from a cell to its four numbers; cells outside and untouched ones are None."""

    def __init__(self, maps, index=0):
        self.maps, self.table, self.delta = maps, maps.tables[index], maps.delta
        self.corner = np.array(maps.origin)

    @property
    def kernel_view(self):
        return (self.maps.cells, self.table, float(self.corner[0]), float(self.corner[1]), self.delta, 1.0 / self.delta)

    def cell(self, point):
        inverse = 1.0 / self.delta  # as the kernels do it, so that a point on a border falls into the same cell
        return math.floor(point[1] * inverse), math.floor(point[0] * inverse)

    def inside(self, i, j):
        return 0 <= i < 32 * self.table.shape[0] and 0 <= j < 32 * self.table.shape[1]

    def hit(self, i, j, fullness):
        """Mean hit point of a full cell, metres from the corner; None where the cell is not full."""
        visits, hits, x, y = self.maps.cells[self.table[i // 32, j // 32], i % 32, j % 32]
        if not hits > np.float32(fullness) * visits:
            return None
        return np.array([float(x) + j * self.delta, float(y) + i * self.delta])

    def window_hits(self, point, window, fullness):
        """Mean hits of the full cells around a point; none at all where the window leaves the map."""
        i0, j0 = self.cell(point)
        if not (self.inside(i0 - window, j0 - window) and self.inside(i0 + window, j0 + window)):
            return []
        cells = [(i0 + a, j0 + b) for a in range(-window, window + 1) for b in range(-window, window + 1)]
        found = [self.hit(i, j, fullness) for i, j in cells]
        return [hit for hit in found if hit is not None]

    def place(self, points, pose):
        """Points of the base frame, metres from the corner."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        return np.asarray(points) @ np.array([[c, s], [-s, c]]) + np.asarray(pose[:2]) - self.corner

    def distances2(self, points, directions, pose, window, fullness, free_check):
        """Squared distance of each point to the nearest hit, inf for none."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        beams = np.asarray(directions) @ np.array([[c, s], [-s, c]])
        distances = []
        for point, beam in zip(self.place(points, pose), beams, strict=True):
            before = point - free_check * beam
            i, j = self.cell(before)
            blocked = free_check > 0 and self.inside(i, j) and self.hit(i, j, fullness) is not None
            hits = [] if blocked else self.window_hits(point, window, fullness)
            distances.append(min((float(((point - hit) ** 2).sum()) for hit in hits), default=math.inf))
        return np.array(distances)


def score(view, points, directions, pose, window, fullness, free_check, sigma):
    return float(np.exp(-view.distances2(points, directions, pose, window, fullness, free_check) / sigma).sum())


def log_likelihood(view, points, directions, pose, window, fullness, free_check, lsigma):
    d2 = view.distances2(points, directions, pose, window, fullness, free_check)
    return float(-np.where(np.isfinite(d2), d2, 0.5).sum() / lsigma)


def hill_climb(score_at, pose, lstep, astep, iterations):
    """ScanMatcher::optimize as gmapping's paper code does it: go to the best of six moves, halve when none is better."""
    pose, current, best, refinement = tuple(pose), score_at(*pose), -1.0, 0
    while current > best or refinement < iterations:
        if best >= current:
            refinement, lstep, astep = refinement + 1, lstep / 2, astep / 2
        best, here = current, pose
        for dx, dy, da in ((lstep, 0, 0), (-lstep, 0, 0), (0, lstep, 0), (0, -lstep, 0), (0, 0, astep), (0, 0, -astep)):
            trial = (here[0] + dx, here[1] + dy, here[2] + da)
            value = score_at(*trial)
            if value > current:
                current, pose = value, trial
    return (*pose, current)


def surfaces(view, points, pose, window, fullness, noise, tangent=1.0):
    """For each point its surface (mean, inverse covariance) or None."""
    found = []
    for point in view.place(points, pose):
        hits = np.array(view.window_hits(point, window, fullness))
        if len(hits) == 0:
            found.append(None)
            continue
        covariance = spread(hits, noise)
        wide = view.window_hits(point, 3, fullness)
        information = np.linalg.inv(covariance)
        if tangent != 1.0:
            information = tangent * information if len(wide) < 3 else slippery(covariance, spread(wide, noise), tangent)
        found.append((hits.mean(axis=0), information))
    return found


def spread(hits, noise):
    centred = np.array(hits) - np.mean(hits, axis=0)
    return centred.T @ centred / len(hits) + noise**2 * np.eye(2)


def slippery(covariance, wide, tangent):
    """Inverse covariance whose part along the line that the wide window shows counts less, as far as that is a line."""
    variances, axes = np.linalg.eigh(wide)
    line = 1.0 - variances[0] / variances[1]
    across, along = axes[:, 0], axes[:, 1]
    least = (1.0 - (1.0 - tangent) * line) / (along @ covariance @ along)
    return least * np.outer(along, along) + np.outer(across, across) / (across @ covariance @ across)


def alignment_cost(view, points, pose, found, scale, prior, information):
    """What the alignment minimises while each point keeps its surface (Geman and McClure)."""
    cost = 0.5 * float((np.asarray(information) * (np.asarray(pose) - prior) ** 2).sum())
    for point, surface in zip(view.place(points, pose), found, strict=True):
        if surface is not None:
            error = point - surface[0]
            squared = float(error @ surface[1] @ error)
            cost += 0.5 * scale * squared / (scale + squared)
    return cost


def gauss_newton_step(view, points, pose, window, fullness, noise, scale, prior, information, tangent):
    """One step as a weighted least-squares problem with stacked rows; returns it, the quality before it and the normal matrix."""
    rows = [np.diag(np.sqrt(information))]
    values = [-np.sqrt(information) * (np.asarray(pose) - prior)]
    quality = 0.0
    turned = view.place(points, pose) - (np.asarray(pose[:2]) - view.corner)
    for (rx, ry), point, surface in zip(
        turned, view.place(points, pose), surfaces(view, points, pose, window, fullness, noise, tangent), strict=True
    ):
        if surface is None:
            continue
        error = point - surface[0]
        weight = scale / (scale + float(error @ surface[1] @ error))
        quality += weight
        root = weight * np.linalg.cholesky(surface[1]).T
        rows.append(root @ np.array([[1.0, 0.0, -ry], [0.0, 1.0, rx]]))
        values.append(-root @ error)
    stacked = np.vstack(rows)
    step = np.linalg.lstsq(stacked, np.concatenate(values), rcond=None)[0]
    return step, quality / max(len(points), 1), stacked.T @ stacked


def align(view, points, start, prior, information, window, fullness, noise, scale, tangent, max_iterations, normal):
    pose, quality = np.array(start, dtype=float), 0.0
    for _ in range(max_iterations):
        step, quality, normal[:] = gauss_newton_step(
            view, points, pose, window, fullness, noise, scale, np.asarray(prior), np.asarray(information), tangent
        )
        pose += step
        if step[:2] @ step[:2] < 1e-8 and step[2] ** 2 < 1e-8:
            break
    return (*pose, quality)
