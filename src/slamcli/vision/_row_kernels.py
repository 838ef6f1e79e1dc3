# SPDX-License-Identifier: MIT
"""Compiled search along rows; see `slamcli.vision.row_matching`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _window_cost(left, right, x, y, place, half_width, half_height, squared):
    """Sum of squared or absolute differences of two windows."""
    cost = np.int64(0)
    for v in range(y - half_height, y + half_height + 1):
        for u in range(-half_width, half_width + 1):
            difference = np.int64(left[v, x + u]) - np.int64(right[v, place + u])
            cost += difference * difference if squared else abs(difference)
    return cost


@njit(cache=True, nogil=True)
def block_match(left, right, columns, rows, half_width, half_height, least, most, squared):
    """Return the disparity in [least, most] at which windows differ least, float64 (N,), refined by a parabola.

    NaN where the best lies at an end of the range, or a window leaves the images.
    """
    found = np.full(len(columns), math.nan)
    costs = np.empty(most - least + 1, np.int64)
    height, width = left.shape
    for i in range(len(columns)):
        x, y = columns[i], rows[i]
        if y < half_height or y >= height - half_height or x < half_width or x >= width - half_width:
            continue
        last = min(most, x - half_width)
        count = last - least + 1
        if count < 3:
            continue
        best = 0
        for k in range(count):
            costs[k] = _window_cost(left, right, x, y, x - least - k, half_width, half_height, squared)
            if costs[k] < costs[best]:
                best = k
        if best == 0 or best == count - 1:
            continue
        before, here, after = float(costs[best - 1]), float(costs[best]), float(costs[best + 1])
        bend = before + after - 2.0 * here
        found[i] = least + best + (0.5 * (before - after) / bend if bend > 0.0 else 0.0)
    return found
