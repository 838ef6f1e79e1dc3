# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.grids.rays`.

Rays go from cell to cell as J. Amanatides and A. Woo have it, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FREE, HIT = 1, 2


@njit(cache=True, nogil=True)
def trace_plane(start, ends, window):
    """Mark the cells of `window` (H, W) from `start` (x, y) up to each of `ends` (N, 2) free, no farther than the first hit.

    Positions are in cells from the window's corner; the cells of `ends` lie within it.
    """
    for n in range(len(ends)):
        j, i = math.floor(start[0]), math.floor(start[1])
        last_j, last_i = math.floor(ends[n, 0]), math.floor(ends[n, 1])
        dx, dy = ends[n, 0] - start[0], ends[n, 1] - start[1]
        step_j, step_i = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        # Along the ray, as a share of it: how far one cell is, and how far the next border is.
        per_j = abs(1.0 / dx) if dx != 0.0 else np.inf
        per_i = abs(1.0 / dy) if dy != 0.0 else np.inf
        next_j = (j + (1 if dx > 0.0 else 0) - start[0]) / dx if dx != 0.0 else np.inf
        next_i = (i + (1 if dy > 0.0 else 0) - start[1]) / dy if dy != 0.0 else np.inf
        for _ in range(abs(last_j - j) + abs(last_i - i) + 1):
            if window[i, j] == HIT:
                break
            window[i, j] = FREE
            if j == last_j and i == last_i:
                break
            # Rounding must not lead past the column or row of the end.
            if (next_j < next_i and j != last_j) or i == last_i:
                j += step_j
                next_j += per_j
            else:
                i += step_i
                next_i += per_i
