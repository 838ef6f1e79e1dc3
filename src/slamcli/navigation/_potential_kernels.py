# SPDX-License-Identifier: MIT
"""Kernels of global_planner's two expansions; see `slamcli.navigation.potential_search`.

Grids are flat with a blocked border of one cell all around. Potentials are float32 as in the original.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]

UNREACHED = np.float32(1.0e10)
_SIDE = np.float32(0.707106781)


@njit(cache=True, nogil=True)
def potential_of(potential: Singles, width: int, cell: int, toll: np.float32, quadratic: bool) -> np.float32:
    """Return what a cell's neighbours give it: the least of them plus its toll, or the quadratic fit of a planar wave."""
    low = min(potential[cell - 1], potential[cell + 1])
    other = min(potential[cell - width], potential[cell + width])
    difference = abs(low - other)
    low = min(low, other)
    if not quadratic or difference >= toll:
        return np.float32(low + toll)
    d = difference / toll
    return np.float32(low + toll * np.float32(-0.2301 * d * d + 0.5307 * d + 0.7040))


@njit(cache=True, nogil=True)
def spread_wave(
    levels: Bytes, toll: Singles, width: int, sources: Ints, target: int, quadratic: bool, threshold: float,
    increment: float, potential: Singles, pending: Bools,
) -> None:  # fmt: skip
    """Let the wave grow from cells whose potential is set until `target` is reached.

    toll : float32 (256,) by costmap value, inf where a cell blocks; sources : int64 (S,), cells beside those that are set;
    threshold, increment : cells above wait for a later round; pending : bool (N,), false before and after.
    """
    current, following, overflow = sources.copy(), np.empty(4096, dtype=np.int64), np.empty(4096, dtype=np.int64)
    num_current, num_following, num_overflow = 0, 0, 0
    limit = np.float32(threshold)
    for cell in sources:
        if toll[levels[cell]] < np.inf and not pending[cell]:
            current[num_current] = cell
            num_current += 1
            pending[cell] = True
    while num_current > 0 and potential[target] >= UNREACHED:
        if num_following + 4 * num_current > len(following):
            following = np.concatenate((following[:num_following], np.empty(8 * num_current, dtype=np.int64)))
        if num_overflow + 4 * num_current > len(overflow):
            overflow = np.concatenate(
                (overflow[:num_overflow], np.empty(num_overflow + 8 * num_current, dtype=np.int64))
            )
        for i in range(num_current):
            pending[current[i]] = False
        for i in range(num_current):
            cell = current[i]
            value = potential_of(potential, width, cell, toll[levels[cell]], quadratic)
            if not value < potential[cell]:
                continue
            potential[cell] = value
            for k in range(4):
                neighbour = cell + (1 if k == 0 else -1 if k == 1 else width if k == 2 else -width)
                cost = toll[levels[neighbour]]
                if cost == np.inf or pending[neighbour] or not potential[neighbour] > value + _SIDE * cost:
                    continue
                pending[neighbour] = True
                if value < limit:
                    following[num_following] = neighbour
                    num_following += 1
                else:
                    overflow[num_overflow] = neighbour
                    num_overflow += 1
        current, following = following, current
        num_current, num_following = num_following, 0
        if num_current == 0:
            limit += np.float32(increment)
            current, overflow = overflow, current
            num_current, num_overflow = num_overflow, 0
    for i in range(num_current):
        pending[current[i]] = False
    for i in range(num_overflow):
        pending[overflow[i]] = False


@njit(cache=True, nogil=True)
def expand_astar(
    levels: Bytes, toll: Singles, width: int, start: int, goal: int, quadratic: bool, neutral: float, potential: Singles
) -> None:
    """Give potentials to cells in the order of potential plus Manhattan distance times `neutral`, until the goal is taken.

    A cell keeps the first potential it gets. Of equal priorities the earlier goes first.
    """
    keys, items = np.empty(4096, dtype=np.float32), np.empty(4096, dtype=np.int64)
    potential[start] = 0.0
    keys[0], items[0] = 0.0, start
    size = 1
    goal_row, goal_column = goal // width, goal % width
    while size > 0:
        cell = items[0]
        size -= 1
        key, item = keys[size], items[size]
        at = 0
        while True:
            below = 2 * at + 1
            if below >= size:
                break
            if below + 1 < size and keys[below + 1] < keys[below]:
                below += 1
            if keys[below] >= key:
                break
            keys[at], items[at] = keys[below], items[below]
            at = below
        keys[at], items[at] = key, item
        if cell == goal:
            return
        for k in range(4):
            neighbour = cell + (1 if k == 0 else -1 if k == 1 else width if k == 2 else -width)
            cost = toll[levels[neighbour]]
            if potential[neighbour] < UNREACHED or cost == np.inf:
                continue
            if quadratic:
                potential[neighbour] = potential_of(potential, width, neighbour, cost, True)
            else:
                potential[neighbour] = potential[cell] + cost
            far = abs(goal_row - neighbour // width) + abs(goal_column - neighbour % width)
            key = np.float32(potential[neighbour] + far * neutral)
            if size == len(keys):
                keys, items = np.concatenate((keys, keys)), np.concatenate((items, items))
            at = size
            while at > 0:
                above = (at - 1) >> 1
                if keys[above] <= key:
                    break
                keys[at], items[at] = keys[above], items[above]
                at = above
            keys[at], items[at] = key, neighbour
            size += 1


@njit(cache=True, nogil=True)
def clear_endpoint(levels: Bytes, toll: Singles, width: int, goal: int, quadratic: bool, potential: Singles) -> None:
    """Give a potential to free cells around the goal that the expansion left out, within two cells."""
    for row in range(-2, 3):
        for column in range(-2, 3):
            cell = goal + row * width + column
            if cell < width or cell >= len(levels) - width or potential[cell] < UNREACHED:
                continue
            cost = toll[levels[cell]]
            if cost < np.inf:
                value = potential_of(potential, width, cell, cost, quadratic)
                potential[cell] = min(value, UNREACHED)


@njit(cache=True, nogil=True)
def follow_cells(levels: Bytes, toll: Singles, width: int, goal: int, start: int, potential: Singles, out: Ints) -> int:
    """Write the cells from `goal` to `start`, each the lowest of the eight around the one before; return their number.

    No corner is cut. -1: `out` is full; -2: a cell has no lower neighbour.
    """
    cell, count = goal, 0
    while True:
        if count == len(out):
            return -1
        out[count] = cell
        count += 1
        if cell == start:
            return count
        best, lowest = cell, potential[cell]
        for row in range(-1, 2):
            for column in range(-1, 2):
                other = cell + row * width + column
                if potential[other] >= lowest:
                    continue
                beside, above = toll[levels[cell + column]], toll[levels[cell + row * width]]
                if row != 0 and column != 0 and max(beside, above) == np.inf:
                    continue
                best, lowest = other, potential[other]
        if best == cell:
            return -2
        cell = best
