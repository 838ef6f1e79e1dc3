# SPDX-License-Identifier: MIT
"""Kernels of shortest any-angle lengths over the corners of cells; see `slamcli.navigation.shortest_path`.

Cells are flat with a blocked border of one cell all around. Corner (row, column) is the lower left one of that cell and has the
same flat number; points are x, y in cells from the lower left corner of the border.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_HAIR = 1e-9
_SOURCE = -1


@njit(cache=True, nogil=True)
def visible(free: Bools, width: int, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Return whether the segment lies in free cells; edges and corners of blocked cells may be touched.

    A segment along an edge needs one free side, and one through a corner must not slip between two blocked cells.
    """
    dx, dy = x1 - x0, y1 - y0
    length = math.sqrt(dx * dx + dy * dy)
    if length < _HAIR:
        return True
    # Cells in which the segment begins: on an edge those in its direction, beside an edge along it both.
    if abs(dx) < _HAIR and abs(x0 - np.floor(x0 + 0.5)) < _HAIR:
        column = int(np.floor(x0 + 0.5))
        first, last = int(np.floor(min(y0, y1) + _HAIR)), int(np.ceil(max(y0, y1) - _HAIR))
        blocked = 0
        for row in range(first, last):
            blocked += not (free[row * width + column] or free[row * width + column - 1])
        return blocked == 0
    if abs(dy) < _HAIR and abs(y0 - np.floor(y0 + 0.5)) < _HAIR:
        row = int(np.floor(y0 + 0.5))
        first, last = int(np.floor(min(x0, x1) + _HAIR)), int(np.ceil(max(x0, x1) - _HAIR))
        blocked = 0
        for column in range(first, last):
            blocked += not (free[row * width + column] or free[(row - 1) * width + column])
        return blocked == 0
    step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    column = int(np.floor(x0 + _HAIR)) if dx > 0.0 else int(np.ceil(x0 - _HAIR)) - 1
    row = int(np.floor(y0 + _HAIR)) if dy > 0.0 else int(np.ceil(y0 - _HAIR)) - 1
    per_x = 1.0 / abs(dx) if abs(dx) > _HAIR else np.inf
    per_y = 1.0 / abs(dy) if abs(dy) > _HAIR else np.inf
    next_x = abs((column + (1 if dx > 0.0 else 0)) - x0) * per_x if per_x < np.inf else np.inf
    next_y = abs((row + (1 if dy > 0.0 else 0)) - y0) * per_y if per_y < np.inf else np.inf
    end = 1.0 - _HAIR / length
    while True:
        if not free[row * width + column]:
            return False
        if min(next_x, next_y) >= end:
            return True
        if abs(next_x - next_y) * length < _HAIR:
            if not (free[row * width + column + step_x] or free[(row + step_y) * width + column]):
                return False
            column, row = column + step_x, row + step_y
            next_x, next_y = next_x + per_x, next_y + per_y
        elif next_x < next_y:
            column, next_x = column + step_x, next_x + per_x
        else:
            row, next_y = row + step_y, next_y + per_y


@njit(cache=True, nogil=True)
def _push(keys: Floats, items: Ints, size: int, key: float, item: int) -> None:
    """Put an item on a binary heap of `size` entries that has room for one more."""
    at = size
    while at > 0:
        above = (at - 1) >> 1
        if keys[above] <= key:
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item


@njit(cache=True, nogil=True)
def _drop_first(keys: Floats, items: Ints, size: int) -> None:
    """Take the first item off a binary heap of `size` entries."""
    last = size - 1
    key, item = keys[last], items[last]
    at = 0
    while True:
        below = 2 * at + 1
        if below >= last:
            break
        if below + 1 < last and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[at], items[at] = keys[below], items[below]
        at = below
    keys[at], items[at] = key, item


@njit(cache=True, nogil=True)
def spread(free: Bools, width: int, start: Floats, goal: Floats, to_goal: bool, reached: Floats, roots: Ints) -> float:
    """Fill `reached` with the lengths of short any-angle paths from a point to all corners, or up to a goal.

    free : bool (N,), border false; start, goal : float64 (2,), x and y, in free cells; to_goal : stop when the goal's length is known, else fill everything; reached : float64 (N,), inf before; roots : int64 (N,), where the
    path to a corner last turned, -1 for the start itself. Returns the length to the goal, inf where there is none or
    none is asked for.
    """
    keys, items = np.empty(4096), np.empty(4096, dtype=np.int64)
    size = 0
    best = np.inf
    if to_goal and visible(free, width, start[0], start[1], goal[0], goal[1]):
        return math.sqrt((goal[0] - start[0]) ** 2 + (goal[1] - start[1]) ** 2)
    goal_column, goal_row = int(np.floor(goal[0])), int(np.floor(goal[1]))
    column, row = int(np.floor(start[0])), int(np.floor(start[1]))
    for k in range(4):
        x, y = column + k % 2, row + k // 2
        corner = y * width + x
        reached[corner] = math.sqrt((x - start[0]) ** 2 + (y - start[1]) ** 2)
        roots[corner] = _SOURCE
        _push(keys, items, size, reached[corner], corner)
        size += 1
    while size > 0:
        key, node = keys[0], items[0]
        _drop_first(keys, items, size)
        size -= 1
        if key >= best:
            break
        x, y = node % width, node // width
        here = reached[node]
        if key > here + _HAIR:
            continue
        root = roots[node]
        root_x, root_y = (start[0], start[1]) if root == _SOURCE else (float(root % width), float(root // width))
        base = 0.0 if root == _SOURCE else reached[root]
        if to_goal and 0 <= x - goal_column <= 1 and 0 <= y - goal_row <= 1:
            best = min(best, here + math.sqrt((x - goal[0]) ** 2 + (y - goal[1]) ** 2))
            if visible(free, width, root_x, root_y, goal[0], goal[1]):
                best = min(best, base + math.sqrt((root_x - goal[0]) ** 2 + (root_y - goal[1]) ** 2))
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if dx == 0 and dy == 0:
                    continue
                # The cells that a step touches: one on a diagonal, two beside an edge.
                above = (y if dy >= 0 else y - 1) * width + (x if dx >= 0 else x - 1)
                if not free[above]:
                    beside = above
                    if dx == 0:
                        beside = above - 1
                    elif dy == 0:
                        beside = above - width
                    if not free[beside]:
                        continue
                neighbour = node + dy * width + dx
                nx, ny = x + dx, y + dy
                known = reached[neighbour]
                direct = base + math.sqrt((nx - root_x) ** 2 + (ny - root_y) ** 2)
                if direct >= known - _HAIR:
                    continue
                if visible(free, width, root_x, root_y, float(nx), float(ny)):
                    length, via = direct, root
                else:
                    length, via = here + math.sqrt(float(dx * dx + dy * dy)), node
                    if length >= known - _HAIR:
                        continue
                reached[neighbour] = length
                roots[neighbour] = via
                if size == len(keys):
                    keys, items = np.concatenate((keys, keys)), np.concatenate((items, items))
                _push(keys, items, size, length, neighbour)
                size += 1
    return best


@njit(cache=True, nogil=True)
def length_to(free: Bools, width: int, start: Floats, goal: Floats, reached: Floats, roots: Ints) -> float:
    """Return the length to a goal, x and y in a free cell, from what `spread` has filled."""
    if visible(free, width, start[0], start[1], goal[0], goal[1]):
        return math.sqrt((goal[0] - start[0]) ** 2 + (goal[1] - start[1]) ** 2)
    column, row = int(np.floor(goal[0])), int(np.floor(goal[1]))
    best = np.inf
    for k in range(4):
        x, y = column + k % 2, row + k // 2
        corner = y * width + x
        if reached[corner] == np.inf:
            continue
        best = min(best, reached[corner] + math.sqrt((x - goal[0]) ** 2 + (y - goal[1]) ** 2))
        root = roots[corner]
        root_x, root_y = (start[0], start[1]) if root == _SOURCE else (float(root % width), float(root // width))
        base = 0.0 if root == _SOURCE else reached[root]
        if visible(free, width, root_x, root_y, goal[0], goal[1]):
            best = min(best, base + math.sqrt((root_x - goal[0]) ** 2 + (root_y - goal[1]) ** 2))
    return best
