# SPDX-License-Identifier: MIT
"""Kernels of the search for frontiers; see `slamcli.navigation.frontiers`.

Costs are flat, row by row, with an obstacle all around (one cell wide), so that no neighbour lies outside; cells are given by their
flat numbers. `reach` (int64, of the same length) holds for each cell the length of the way to it, -1 where it could be crossed and there is
no way, -2 less the number of the cell where the robot stands for cells that it can look into, _CLOSED for all others, and in the end _TAKEN for
cells of frontiers.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

STRAIGHT, DIAGONAL = 5, 7
"""Lengths of steps: 1.4 instead of the root of two."""
_BUCKETS = 8
_LETHAL, _UNKNOWN = 254, 255
_TAKEN = np.iinfo(np.int64).min
_CLOSED = _TAKEN + 1


@njit(cache=True, nogil=True)
def wave(costs, width, start, through, reach, pending):
    """Write to `reach` how long the way from a cell to each cell is, over costs up to `through`.

    Dial's algorithm with a bucket for each length that can be pending; `pending` (8, cells) is room for them. A diagonal step needs both
    cells beside it. Returns the first and the last cell that was reached.
    """
    for cell in range(costs.shape[0]):
        reach[cell] = -1 if costs[cell] <= through else _CLOSED
    counts = np.zeros(_BUCKETS, np.int64)
    pending[0, 0], counts[0] = start, 1
    reach[start] = 0
    lowest, highest = start, start
    now, idle = 0, 0
    while idle < _BUCKETS:
        bucket = now % _BUCKETS
        idle += 1
        straight, diagonal = now + STRAIGHT, now + DIAGONAL
        to_straight, to_diagonal = straight % _BUCKETS, diagonal % _BUCKETS
        for k in range(counts[bucket]):
            cell = pending[bucket, k]
            if reach[cell] != now:
                continue
            idle = 0
            lowest, highest = min(lowest, cell), max(highest, cell)
            below, above = cell - width, cell + width
            south, north, west, east = reach[below], reach[above], reach[cell - 1], reach[cell + 1]
            for other, length in ((below, south), (above, north), (cell - 1, west), (cell + 1, east)):
                if length == -1 or length > straight:
                    reach[other] = straight
                    pending[to_straight, counts[to_straight]] = other
                    counts[to_straight] += 1
            for other, beside, along in (
                (below - 1, south, west),
                (below + 1, south, east),
                (above - 1, north, west),
                (above + 1, north, east),
            ):
                if beside >= -1 and along >= -1 and (reach[other] == -1 or reach[other] > diagonal):
                    reach[other] = diagonal
                    pending[to_diagonal, counts[to_diagonal]] = other
                    counts[to_diagonal] += 1
        counts[bucket] = 0
        now += 1
    return lowest, highest


@njit(cache=True, nogil=True)
def look_in(costs, width, lowest, highest, reach, queue):
    """Note in `reach` the cells behind the reached ones where the robot does not fit, with the reached cell in front.

    Such cells are known, no obstacles, too dear to be crossed, and tied to a reached cell by others like them over their
    sides; the fewest steps decide in front of which, then the order of the cells. Takes and returns the first and the last cell of what is noted; `queue` is room for cells.
    """
    end = 0
    for cell in range(lowest, highest + 1):
        if reach[cell] < 0:
            continue
        for side in range(4):
            other = cell + (-width if side == 0 else width if side == 1 else -1 if side == 2 else 1)
            if reach[other] == _CLOSED and costs[other] < _LETHAL:
                reach[other] = -2 - cell
                queue[end] = other
                end += 1
    first = 0
    while first < end:
        cell = queue[first]
        first += 1
        lowest, highest = min(lowest, cell), max(highest, cell)
        for side in range(4):
            other = cell + (-width if side == 0 else width if side == 1 else -1 if side == 2 else 1)
            if reach[other] == _CLOSED and costs[other] < _LETHAL:
                reach[other] = reach[cell]
                queue[end] = other
                end += 1
    return lowest, highest


@njit(cache=True, nogil=True)
def groups(costs, width, lowest, highest, reach, cells, near, firsts):
    """Write the frontier cells, group after group, to `cells`, the nearest reached cell of each to `near`.

    A frontier cell is unknown and has at one of its sides a cell that was reached, or looked into; of several the one
    with the shortest way counts. Groups hold together over sides and corners, and come in the order of their first
    cells, row by row; `firsts` (one more than groups) gets where each begins, and where the last one ends. Returns the
    number of groups.
    """
    end, count = 0, 0
    for begin in range(lowest - width, highest + width + 1):
        if costs[begin] != _UNKNOWN or reach[begin] == _TAKEN:
            continue
        found = _front(reach, begin, width)
        if found < 0:
            continue
        firsts[count] = end
        count += 1
        reach[begin] = _TAKEN
        cells[end], near[end] = begin, found
        next_, end = end, end + 1
        while next_ < end:
            cell = cells[next_]
            next_ += 1
            for di in range(-1, 2):
                for other in range(cell + di * width - 1, cell + di * width + 2):
                    if costs[other] != _UNKNOWN or reach[other] == _TAKEN:
                        continue
                    found = _front(reach, other, width)
                    if found >= 0:
                        reach[other] = _TAKEN
                        cells[end], near[end] = other, found
                        end += 1
    firsts[count] = end
    return count


@njit(cache=True, nogil=True)
def _front(reach, cell, width):
    """Return the reached cell nearest to the start of those at, or in front of those at, a cell's sides; -1 for none."""
    best = -1
    for side in range(4):
        other = cell + (-width if side == 0 else width if side == 1 else -1 if side == 2 else 1)
        value = reach[other]
        if value == -1 or value <= _CLOSED:
            continue
        found = other if value >= 0 else -2 - value
        if best < 0 or reach[found] < reach[best]:
            best = found
    return best


@njit(cache=True, nogil=True)
def visible_unknown(costs, width, cell, range_cells, rays, seen, mark):
    """Return how many unknown cells lie within `range_cells` of a cell and in its sight: rays end at obstacles.

    Cells that were counted get `mark` in `seen`, so that none counts twice.
    """
    count = 0
    row, column = cell // width, cell % width
    for k in range(rays):
        angle = 2.0 * math.pi * k / rays
        dx, dy = math.cos(angle), math.sin(angle)
        for step in range(1, int(range_cells) + 1):
            other = int(np.floor(row + 0.5 + step * dy)) * width + int(np.floor(column + 0.5 + step * dx))
            if costs[other] == _LETHAL:
                break
            if costs[other] == _UNKNOWN and seen[other] != mark:
                seen[other] = mark
                count += 1
    return count
