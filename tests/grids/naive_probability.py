# SPDX-License-Identifier: MIT
"""Naive twins of the probability grid: the odds formula cell by cell, and rays by where they cross the lines between cells."""

from __future__ import annotations

import itertools
import math

import numpy as np

LOW, HIGH, STEPS = 0.1, 0.9, 32766.0


def probability_of(value):
    """Probability of a stored value from 1 on."""
    return 1.0 - (LOW + (value - 1) * (HIGH - LOW) / STEPS)


def odds(probability):
    return probability / (1.0 - probability)


def updated(value, observed):
    """Stored value after an observation, equation 3 of Hess et al."""
    together = odds(observed) if value == 0 else odds(probability_of(value)) * odds(observed)
    cost = min(max(1.0 - together / (1.0 + together), LOW), HIGH)
    return round((cost - LOW) * STEPS / (HIGH - LOW)) + 1


def crossed(start, end):
    """Cells (row, column) that the segment between two points, in cells, crosses: the middles between all its crossings."""
    (x0, y0), (x1, y1) = start, end
    cuts = [0.0, 1.0]
    for a, b in ((x0, x1), (y0, y1)):
        if a != b:
            cuts += [(line - a) / (b - a) for line in range(math.ceil(min(a, b)), math.floor(max(a, b)) + 1)]
    cuts = sorted(t for t in cuts if 0.0 <= t <= 1.0)
    middles = [0.5 * (a + b) for a, b in itertools.pairwise(cuts) if b - a > 1e-12]
    cells = {(math.floor(y0 + t * (y1 - y0)), math.floor(x0 + t * (x1 - x0))) for t in middles}
    return cells | {(math.floor(y0), math.floor(x0))}


def inserted(cells, origin, resolution, pose, start, points, misses, hit, miss, free_space=True):
    """The grid after one scan: every cell changes once, hits go before misses."""
    found = cells.astype(np.int64)
    c, s = math.cos(pose[2]), math.sin(pose[2])

    def place(point):
        x, y = pose[0] + c * point[0] - s * point[1], pose[1] + s * point[0] + c * point[1]
        return (x - origin[0]) / resolution, (y - origin[1]) / resolution

    def cell(point):
        x, y = place(point)
        return math.floor(y), math.floor(x)

    hits = {cell(point) for point in points}
    freed = set()
    if free_space:
        for end in (*points, *misses):
            freed |= crossed(place(start), place(end))
    for where in hits:
        found[where] = updated(found[where], hit)
    for where in freed - hits:
        found[where] = updated(found[where], miss)
    return found
