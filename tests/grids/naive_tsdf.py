# SPDX-License-Identifier: MIT
"""Naive twins of the grid of signed distances: normals by complex numbers, one beam and one cell after the other."""

from __future__ import annotations

import cmath
import math

import numpy as np
from naive_probability import crossed


def by_bearing(start, points):
    """Points in the order of their bearing from -pi to pi."""
    order = sorted(range(len(points)), key=lambda k: math.atan2(points[k][1] - start[1], points[k][0] - start[0]))
    return np.array([points[k] for k in order]).reshape(-1, 2)


def normals(start, points, num_samples, radius):
    """Headings of the normals at points that are sorted by bearing."""
    z, origin, found = [complex(*p) for p in points], complex(*start), []
    for k, here in enumerate(z):
        after, before = z[k + 1 : k + 1 + (num_samples + 1) // 2], z[max(k - num_samples // 2, 0) : k][::-1]
        total = 0j
        for side in (before, after):
            for other in side:
                if abs(here - other) >= radius:
                    break
                if here != other:
                    normal = 1j * (here - other) / abs(here - other)
                    facing = (normal * (origin - here).conjugate()).real >= 0
                    total += normal if facing else -normal
        found.append(cmath.phase(total) if total != 0 else cmath.phase(origin - here))
    return found


def bell(x, sigma):
    return math.exp(-0.5 * (x / sigma) ** 2) / (math.sqrt(2 * math.pi) * sigma)


def inserted(tsd, weights, grid, settings, start, points):
    """Distances and weights, metres and as they are, after one scan in the grid's frame; `settings` is a `TsdfInserter`."""
    cut, most, resolution = grid.truncation_distance_m, grid.max_weight, grid.resolution_m
    tsd, weights, done = tsd.copy(), weights.copy(), set()
    points = by_bearing(start, points)
    headings = normals(start, points, settings.num_normal_samples, settings.sample_radius_m)
    for point, heading in zip(points, headings, strict=True):
        beam = point - start
        length = float(np.hypot(*beam))
        if length < cut:
            continue
        weight = length**-settings.update_weight_range_exponent
        if settings.angle_bandwidth_rad > 0:
            angle = math.remainder(heading - math.atan2(-beam[1], -beam[0]), math.tau)
            weight *= bell(angle, settings.angle_bandwidth_rad)
        first = start if settings.update_free_space else start + (1 - cut / length) * beam
        ends = [(end - grid.origin) / resolution for end in (first, start + (1 + cut / length) * beam)]
        for i, j in crossed(*ends) - done:
            centre = np.array(grid.origin) + resolution * np.array([j + 0.5, i + 0.5])
            if settings.project_sdf_distance_to_scan_normal:
                distance = float((centre - point) @ [math.cos(heading), math.sin(heading)])
            else:
                distance = length - float(np.hypot(*(centre - start)))
            distance = min(max(distance, -cut), cut)
            w = weight * (bell(distance, settings.distance_bandwidth_m) if settings.distance_bandwidth_m > 0 else 1.0)
            tsd[i, j] = (tsd[i, j] * weights[i, j] + distance * w) / (weights[i, j] + w)
            weights[i, j] = min(weights[i, j] + w, most)
            done.add((i, j))
    return tsd, weights
