# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.grids.first_seen`.

Rays go from cell to cell as J. Amanatides and A. Woo have it, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def mark_rays(start, ends, stop_at, cells, index, seen):
    """Set `seen` (H, W) to `index` in the known cells that rays go through and that nothing has seen before.

    Rays lead from `start` (x, y) to each of `ends` (N, 2), in cells from the grid's corner, and leave out what lies beyond the grid.
    They end behind the first of `cells` (H, W) that is `stop_at` or more.
    """
    height, width = cells.shape
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
            if 0 <= i < height and 0 <= j < width:
                if cells[i, j] >= 0 and seen[i, j] < 0:
                    seen[i, j] = index
                if cells[i, j] >= stop_at:
                    break
            if j == last_j and i == last_i:
                break
            # Rounding must not lead past the column or row of the end.
            if (next_j < next_i and j != last_j) or i == last_i:
                j += step_j
                next_j += per_j
            else:
                i += step_i
                next_i += per_i
