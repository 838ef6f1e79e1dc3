# SPDX-License-Identifier: MIT
"""Kernels of hybrid A*; see `slamcli.navigation.hybrid_astar`.

Positions are x, y in cells of a grid with a border, centres at whole numbers; levels are flat. A search keeps its state in
arrays, so that it can be left for a try to reach the goal in one curve and taken up again.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EXHAUSTED, GOOD_ENOUGH, LIMIT = -1, -2, -3
NUM_NODES, HEAP_SIZE, POPS, COUNTDOWN = 0, 1, 2, 3
X, Y, YAW, G, DIRECTION, CURVATURE = 0, 1, 2, 3, 4, 5
_TURN = 2.0 * math.pi


@njit(cache=True, nogil=True)
def pose_cost(
    levels: Bytes,
    stride: int,
    blocked: Bools,
    hit: Bools,
    weight: Floats,
    outline: Floats,
    x: float,
    y: float,
    yaw: float,
) -> float:
    """Return the weight of the cell under a pose; inf if the robot must not stand there.

    blocked, hit : bool (256,), levels that the centre and any part of the robot must not touch; outline : float64 (S, 2),
    points all over the robot, cells, base frame.
    """
    height = len(levels) // stride
    row, column = math.floor(y + 0.5), math.floor(x + 0.5)
    if row < 0 or row >= height or column < 0 or column >= stride:
        return np.inf
    level = levels[row * stride + column]
    if blocked[level]:
        return np.inf
    cosine, sine = math.cos(yaw), math.sin(yaw)
    for k in range(len(outline)):
        row = math.floor(y + sine * outline[k, 0] + cosine * outline[k, 1] + 0.5)
        column = math.floor(x + cosine * outline[k, 0] - sine * outline[k, 1] + 0.5)
        if row < 0 or row >= height or column < 0 or column >= stride or hit[levels[row * stride + column]]:
            return np.inf
    return weight[level]


@njit(cache=True, nogil=True)
def drive(
    levels: Bytes, stride: int, blocked: Bools, hit: Bools, weight: Floats, outline: Floats, pose: Floats,
    curvature: float, length: float, spacing: float,
) -> float:  # fmt: skip
    """Move `pose` (3,) along an arc of signed length and return the weighted length; inf if the robot touches something."""
    pieces = max(1, math.ceil(abs(length) / spacing - 1e-9))
    step = length / pieces
    total = 0.0
    for _ in range(pieces):
        turn = curvature * step
        # The chord of an arc leads half of the turn aside.
        chord = step if abs(turn) < 1e-9 else 2.0 * math.sin(0.5 * turn) / curvature
        pose[0] += chord * math.cos(pose[2] + 0.5 * turn)
        pose[1] += chord * math.sin(pose[2] + 0.5 * turn)
        pose[2] += turn
        there = pose_cost(levels, stride, blocked, hit, weight, outline, pose[0], pose[1], pose[2])
        if there == np.inf:
            return np.inf
        total += abs(step) * there
    return total


@njit(cache=True, nogil=True)
def _push(keys: Floats, items: Ints, size: int, key: float, item: int) -> None:
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
def _slot(table: Ints, codes: Ints, code: int) -> int:
    """Return where a state is in the open hash table, or the empty place for it."""
    mask = len(table) - 1
    at = (code * 2654435761) & mask
    while table[at] >= 0 and codes[table[at]] != code:
        at = (at + 1) & mask
    return at


@njit(cache=True, nogil=True)
def _code(x: float, y: float, yaw: float, stride: int, bins: int) -> int:
    """Return the number of the cell and heading bin that a pose lies in."""
    heading = math.floor((yaw % _TURN) / _TURN * bins + 0.5) % bins
    return (math.floor(y + 0.5) * stride + math.floor(x + 0.5)) * bins + heading


@njit(cache=True, nogil=True)
def begin(
    start: Floats, stride: int, bins: int, ahead: float, nodes: Floats, parents: Ints, codes: Ints, table: Ints,
    keys: Floats, items: Ints, counts: Ints,
) -> None:  # fmt: skip
    """Put the start pose (3,) into an empty search; `ahead` is its estimated cost to the goal."""
    table[:] = -1
    nodes[0, X], nodes[0, Y], nodes[0, YAW] = start[0], start[1], start[2]
    nodes[0, G], nodes[0, DIRECTION], nodes[0, CURVATURE] = 0.0, 0.0, 0.0
    parents[0] = -1
    codes[0] = _code(start[0], start[1], start[2], stride, bins)
    table[_slot(table, codes, codes[0])] = 0
    keys[0], items[0] = ahead, 0
    counts[NUM_NODES], counts[HEAP_SIZE], counts[POPS], counts[COUNTDOWN] = 1, 1, 0, 1


@njit(cache=True, nogil=True)
def resume(
    levels: Bytes, stride: int, blocked: Bools, hit: Bools, weight: Floats, outline: Floats, field: Floats, bins: int,
    motions: Floats, penalties: Floats, step: float, ratio: float, best: float, limit: int, nodes: Floats,
    parents: Ints, codes: Ints, table: Ints, keys: Floats, items: Ints, counts: Ints,
) -> int:  # fmt: skip
    """Go on until a node is due for a try at the goal, and return its number; or EXHAUSTED, GOOD_ENOUGH, LIMIT.

    Parameters
    ----------
    levels : uint8 (N,) with a border; blocked, hit, weight, outline : see `pose_cost`; field : float64 (N,), estimated cost from
    each cell to the goal, inf where there is no way; bins : headings per turn; motions : float64 (M, 3), curvature and direction of
    a step and the factor on its cost; penalties : (1,) cost of a change of direction; step : length of a step; ratio : how often the goal is
    tried, more often near it; best : cost of the best way that is known; limit : states after which the
    search ends; nodes : float64 (C, 6), parents, codes : int64 (C,), table : int64 (power of two >= 2 C), keys, items : (D,) heap, counts : int64
    (4,): the state of the search.
    """
    pose = np.empty(3)
    while counts[HEAP_SIZE] > 0:
        key, node = keys[0], items[0]
        if key >= best or counts[POPS] > limit:
            return GOOD_ENOUGH
        x, y, yaw, g = nodes[node, X], nodes[node, Y], nodes[node, YAW], nodes[node, G]
        cell = math.floor(y + 0.5) * stride + math.floor(x + 0.5)
        if key > g + field[cell] + 1e-9 or table[_slot(table, codes, codes[node])] != node:
            _drop_first(keys, items, counts[HEAP_SIZE])
            counts[HEAP_SIZE] -= 1
            continue
        counts[COUNTDOWN] -= 1
        if counts[COUNTDOWN] == 0:
            # The node stays: it is taken off when the search comes back.
            return node
        if counts[COUNTDOWN] < 0:
            counts[COUNTDOWN] = 1 + int(field[cell] / (ratio * step))
        _drop_first(keys, items, counts[HEAP_SIZE])
        counts[HEAP_SIZE] -= 1
        counts[POPS] += 1
        if counts[NUM_NODES] + len(motions) > len(nodes) or counts[HEAP_SIZE] + len(motions) > len(keys):
            return LIMIT
        for m in range(len(motions)):
            curvature, direction = motions[m, 0], motions[m, 1]
            pose[0], pose[1], pose[2] = x, y, yaw
            way = drive(levels, stride, blocked, hit, weight, outline, pose, curvature, direction * step, 1.0)
            if way == np.inf:
                continue
            cost = g + way * motions[m, 2]
            if nodes[node, DIRECTION] * direction < 0.0:
                cost += penalties[0]
            there = field[math.floor(pose[1] + 0.5) * stride + math.floor(pose[0] + 0.5)]
            if cost + there >= best:
                continue
            code = _code(pose[0], pose[1], pose[2], stride, bins)
            slot = _slot(table, codes, code)
            if table[slot] >= 0 and nodes[table[slot], G] <= cost + 1e-9:
                continue
            fresh = counts[NUM_NODES]
            nodes[fresh, X], nodes[fresh, Y], nodes[fresh, YAW] = pose[0], pose[1], pose[2]
            nodes[fresh, G], nodes[fresh, DIRECTION], nodes[fresh, CURVATURE] = cost, direction, curvature
            parents[fresh], codes[fresh] = node, code
            table[slot] = fresh
            counts[NUM_NODES] += 1
            _push(keys, items, counts[HEAP_SIZE], cost + there, fresh)
            counts[HEAP_SIZE] += 1
    return EXHAUSTED
