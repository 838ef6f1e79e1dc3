# SPDX-License-Identifier: MIT
"""Kernels for lines across cells and Theta*; see `slamcli.navigation.path_shape` and `slamcli.navigation.theta_star`."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


@njit(cache=True)
def line_cost(
    levels: Bytes, blocked: Bools, weight: Floats, stride: int, r0: float, c0: float, r1: float, c1: float
) -> float:
    """Return the sum over a line's cells of length inside times weight; inf if it touches a blocked cell.

    levels : uint8 (N,) flat with a border of one cell; points in rows and columns of that grid, centres at whole
    numbers. Where the line passes exactly through a corner, both cells beside it count as touched.
    """
    row, column = int(np.floor(r0 + 0.5)), int(np.floor(c0 + 0.5))
    last_row, last_column = int(np.floor(r1 + 0.5)), int(np.floor(c1 + 0.5))
    dr, dc = r1 - r0, c1 - c0
    length = np.sqrt(dr * dr + dc * dc)
    if blocked[levels[row * stride + column]]:
        return np.inf
    step_r = 1 if dr > 0 else -1
    step_c = 1 if dc > 0 else -1
    next_r = (row + 0.5 * step_r - r0) / dr if dr != 0.0 else np.inf
    next_c = (column + 0.5 * step_c - c0) / dc if dc != 0.0 else np.inf
    delta_r = abs(1.0 / dr) if dr != 0.0 else np.inf
    delta_c = abs(1.0 / dc) if dc != 0.0 else np.inf
    left = abs(last_row - row) + abs(last_column - column)
    at, total = 0.0, 0.0
    while left > 0:
        here = weight[levels[row * stride + column]]
        to_r = row != last_row
        to_c = column != last_column
        if to_r and to_c and abs(next_r - next_c) < 1e-9:
            if blocked[levels[(row + step_r) * stride + column]] or blocked[levels[row * stride + column + step_c]]:
                return np.inf
            total += (next_r - at) * here
            at = next_r
            row, column = row + step_r, column + step_c
            next_r, next_c = next_r + delta_r, next_c + delta_c
            left -= 2
        elif to_r and (next_r < next_c or not to_c):
            total += (next_r - at) * here
            at = next_r
            row, next_r = row + step_r, next_r + delta_r
            left -= 1
        else:
            total += (next_c - at) * here
            at = next_c
            column, next_c = column + step_c, next_c + delta_c
            left -= 1
        if blocked[levels[row * stride + column]]:
            return np.inf
    total += (1.0 - at) * weight[levels[row * stride + column]]
    return total * length


@njit(cache=True)
def path_cost(levels: Bytes, blocked: Bools, weight: Floats, stride: int, points: Floats) -> float:
    """Return the sum of `line_cost` along points (N, 2)."""
    total = 0.0
    for i in range(len(points) - 1):
        total += line_cost(
            levels, blocked, weight, stride, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        )
    return total


@njit(cache=True)
def shortcut(levels: Bytes, blocked: Bools, weight: Floats, stride: int, points: Floats, keep: Bools) -> None:
    """Mark in `keep` (N,) bool the points that remain when stretches become lines that are free and cost no more."""
    count = len(points)
    along = np.zeros(count)
    for i in range(count - 1):
        along[i + 1] = along[i] + line_cost(
            levels, blocked, weight, stride, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        )
    keep[:] = False
    i = 0
    keep[0] = True
    while i < count - 1:
        reach = i + 1
        for j in range(i + 2, count):
            line = line_cost(levels, blocked, weight, stride, points[i, 0], points[i, 1], points[j, 0], points[j, 1])
            if line > along[j] - along[i] + 1e-9:
                break
            reach = j
        i = reach
        keep[i] = True


@njit(cache=True)
def relax(
    levels: Bytes, blocked: Bools, weight: Floats, stride: int, points: Floats, rounds: int, settled: float
) -> int:
    """Move points (N, 2) half way to the middle of their neighbours where that is free and costs no more, in place.

    Goes on until no point moves by `settled` cells, at most for `rounds` rounds; returns how many there were.
    """
    count = len(points)
    costs = np.empty(count - 1)
    for i in range(count - 1):
        costs[i] = line_cost(
            levels, blocked, weight, stride, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        )
    for done in range(rounds):
        most = 0.0
        for i in range(1, count - 1):
            dr = 0.25 * (points[i - 1, 0] + points[i + 1, 0]) - 0.5 * points[i, 0]
            dc = 0.25 * (points[i - 1, 1] + points[i + 1, 1]) - 0.5 * points[i, 1]
            move = max(abs(dr), abs(dc))
            if move < 0.1 * settled:
                continue
            r, c = points[i, 0] + dr, points[i, 1] + dc
            before = line_cost(levels, blocked, weight, stride, points[i - 1, 0], points[i - 1, 1], r, c)
            after = line_cost(levels, blocked, weight, stride, r, c, points[i + 1, 0], points[i + 1, 1])
            if before + after > costs[i - 1] + costs[i]:
                continue
            points[i, 0], points[i, 1] = r, c
            costs[i - 1], costs[i] = before, after
            most = max(most, move)
        if most < settled:
            return done + 1
    return rounds


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def search_any_angle(
    levels: Bytes,
    blocked: Bools,
    weight: Floats,
    stride: int,
    start: int,
    goal: int,
    g: Floats,
    state: Ints,
    parent: Ints,
    generation: int,
) -> float:
    """Fill `g` and `parent` by Theta* until the way from `start` to `goal` is known; return its cost, inf if none.

    levels : uint8 (N,) with a border; g : float64 (N,), state : int64 (N,), parent : int64 (N,), work space that is kept from
    call to call; generation : a number that grows by one from call to call, from 1. `parent` is the cell from which a
    straight line leads to a cell. Cells are taken up again when they get cheaper.
    """
    keys, items = np.empty(4096), np.empty(4096, dtype=np.int64)
    goal_row, goal_column = goal // stride, goal % stride
    g[start], state[start], parent[start] = 0.0, generation, start
    _push(keys, items, 0, 0.0, start)
    size = 1
    best = 0.0 if start == goal else np.inf
    while size > 0:
        key, node = keys[0], items[0]
        _drop_first(keys, items, size)
        size -= 1
        if key >= best:
            break
        row, column = node // stride, node % stride
        here = g[node]
        ahead = np.sqrt(float((row - goal_row) ** 2 + (column - goal_column) ** 2))
        if node != start and key > here + ahead + 1e-9:
            continue
        root = parent[node]
        root_row, root_column = root // stride, root % stride
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                neighbour = node + dr * stride + dc
                if neighbour == node or blocked[levels[neighbour]]:
                    continue
                if dr != 0 and dc != 0 and (blocked[levels[node + dc]] or blocked[levels[node + dr * stride]]):
                    continue
                known = g[neighbour] if state[neighbour] == generation else np.inf
                r, c = row + dr, column + dc
                step = np.sqrt(float(dr * dr + dc * dc))
                cost = here + step * 0.5 * (weight[levels[node]] + weight[levels[neighbour]])
                via = node
                straight = g[root] + np.sqrt(float((r - root_row) ** 2 + (c - root_column) ** 2))
                if straight < min(known, cost):
                    line = g[root] + line_cost(
                        levels, blocked, weight, stride, float(root_row), float(root_column), float(r), float(c)
                    )
                    if line <= cost:
                        cost, via = line, root
                if cost >= known - 1e-9:
                    continue
                g[neighbour], state[neighbour], parent[neighbour] = cost, generation, via
                if neighbour == goal:
                    best = cost
                if size == len(keys):
                    keys, items = np.concatenate((keys, keys)), np.concatenate((items, items))
                rest = np.sqrt(float((r - goal_row) ** 2 + (c - goal_column) ** 2))
                _push(keys, items, size, cost + rest, neighbour)
                size += 1
    return best
