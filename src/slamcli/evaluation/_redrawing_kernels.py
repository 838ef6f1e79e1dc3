# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.evaluation.redrawn_map`.

Rays go from cell to cell as J. Amanatides and A. Woo have it, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def count(origins, ends, hits, passes):
    """Count for each cell how many rays ended in it and how many went through it.

    Parameters
    ----------
    origins, ends
        float64 (P, 2), column and row with fractions; rays that begin or end outside of the window are left out.
    hits, passes
        int32 (H, W), out.
    """
    height, width = hits.shape
    for n in range(len(ends)):
        j, i = math.floor(origins[n, 0]), math.floor(origins[n, 1])
        last_j, last_i = math.floor(ends[n, 0]), math.floor(ends[n, 1])
        if min(j, last_j) < 0 or min(i, last_i) < 0 or max(j, last_j) >= width or max(i, last_i) >= height:
            continue
        dx, dy = ends[n, 0] - origins[n, 0], ends[n, 1] - origins[n, 1]
        step_j, step_i = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        per_j = abs(1.0 / dx) if dx != 0.0 else np.inf
        per_i = abs(1.0 / dy) if dy != 0.0 else np.inf
        next_j = (j + (1 if dx > 0.0 else 0) - origins[n, 0]) / dx if dx != 0.0 else np.inf
        next_i = (i + (1 if dy > 0.0 else 0) - origins[n, 1]) / dy if dy != 0.0 else np.inf
        while j != last_j or i != last_i:
            passes[i, j] += 1
            # Rounding must not lead past the column or row of the end.
            if (next_j < next_i and j != last_j) or i == last_i:
                j += step_j
                next_j += per_j
            else:
                i += step_i
                next_i += per_i
        hits[i, j] += 1
