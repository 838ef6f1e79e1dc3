# SPDX-License-Identifier: MIT
"""Kernel of the drawing of submaps; see `slamcli.grids.submap_drawing`."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def add_submap(cells, grid_corner, grid_m, table, T_map_local, map_corner, map_m, box, sign, sums, weights):
    """Add what a submap (h, w) says of each cell of the map (H, W) within `box` (first row, column, past the last).

    The cell's centre is taken into the submap and what the table says of the stored values of the four cells around it is
    weighted bilinearly; unknown cells have no weight. With `sign` -1.0 instead of 1.0 what was added before is taken away.
    """
    height, width = cells.shape
    c, s = np.cos(T_map_local[2]), np.sin(T_map_local[2])
    for row in range(box[0], box[2]):
        y = map_corner[1] + (row + 0.5) * map_m - T_map_local[1]
        for column in range(box[1], box[3]):
            x = map_corner[0] + (column + 0.5) * map_m - T_map_local[0]
            u = (c * x + s * y - grid_corner[0]) / grid_m - 0.5
            v = (c * y - s * x - grid_corner[1]) / grid_m - 0.5
            if u <= -1.0 or v <= -1.0 or u >= width or v >= height:
                continue
            i, j = int(np.floor(v)), int(np.floor(u))
            right, upper = u - j, v - i
            for di in range(2):
                if i + di < 0 or i + di >= height:
                    continue
                share = upper if di == 1 else 1.0 - upper
                for dj in range(2):
                    if j + dj < 0 or j + dj >= width:
                        continue
                    value = cells[i + di, j + dj]
                    if value == 0:
                        continue
                    weight = sign * share * (right if dj == 1 else 1.0 - right)
                    sums[row, column] += weight * table[value]
                    weights[row, column] += weight
