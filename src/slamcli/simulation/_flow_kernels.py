# SPDX-License-Identifier: MIT
"""Kernel: how far every cell is from a goal, for people who walk there from anywhere."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def distances_to(goal_row, goal_column, prices, far, out):
    """Fill `out` int32 (H, W) with the cost of the best way to the goal's cell, `far` where there is none.

    `prices` uint8 (H, W) are per unit of length, 0 where nobody can walk; a step to a side counts 5 units, a diagonal
    one 7, at the mean price of both cells (halved sums stay whole because all is doubled). Dial's variant of Dijkstra's
    algorithm: cells wait in buckets by cost, as many as the dearest step has units (Dial 1969).
    """
    height, width = prices.shape
    out[:, :] = far
    most = 0
    for row in range(height):
        for column in range(width):
            most = max(most, np.int64(prices[row, column]))
    buckets = 14 * most + 1
    heads = np.full(buckets, -1, np.int64)
    size = 1024
    cells, nexts, spare = np.empty(size, np.int64), np.empty(size, np.int64), -1
    used = 0
    out[goal_row, goal_column] = 0
    cells[0], nexts[0], heads[0], used = goal_row * width + goal_column, -1, 0, 1
    waiting, cost = 1, 0
    while waiting > 0:
        slot = cost % buckets
        entry = heads[slot]
        while entry >= 0:
            heads[slot] = nexts[entry]
            waiting -= 1
            cell = cells[entry]
            nexts[entry] = spare
            spare = entry
            row, column = cell // width, cell % width
            if out[row, column] == cost:
                for dr in range(-1, 2):
                    for dc in range(-1, 2):
                        r, c = row + dr, column + dc
                        if (dr == 0 and dc == 0) or r < 0 or c < 0 or r >= height or c >= width or prices[r, c] == 0:
                            continue
                        unit = 5 if dr == 0 or dc == 0 else 7
                        further = cost + unit * (np.int64(prices[row, column]) + np.int64(prices[r, c]))
                        if further < out[r, c]:
                            out[r, c] = further
                            if spare >= 0:
                                at = spare
                                spare = nexts[at]
                            else:
                                if used == size:
                                    more_cells, more_nexts = np.empty(2 * size, np.int64), np.empty(2 * size, np.int64)
                                    more_cells[:size], more_nexts[:size] = cells, nexts
                                    cells, nexts, size = more_cells, more_nexts, 2 * size
                                at = used
                                used += 1
                            cells[at], nexts[at] = r * width + c, heads[further % buckets]
                            heads[further % buckets] = at
                            waiting += 1
            entry = heads[slot]
        cost += 1
