# SPDX-License-Identifier: MIT
"""Kernels of the shortest-path search on the 8-connected grid; see `slamcli.navigation.grid_search`.

Grids are flat with a blocked border of one cell all around, so that no neighbour lies outside.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

SQRT2 = 1.4142135623730951
HAIR = 1e-9
"""Costs that differ by less are the same."""
GENERATIONS = 127
"""Searches after which the work space is full of their marks."""


@njit(cache=True)
def lower_bound(landmarks: Floats, a: int, b: int, down: int, across: int) -> float:
    """Return a cost that no path between two flat cells can undercut: octile distance, or what a landmark tells.

    landmarks : float64 (N, K), the cost from each of K cells to each cell, 0 where there is no way; down, across : rows and
    columns between the cells.
    """
    bound = max(down, across) + (SQRT2 - 1.0) * min(down, across)
    for k in range(landmarks.shape[1]):
        bound = max(bound, abs(landmarks[a, k] - landmarks[b, k]))
    return bound


@njit(cache=True)
def _doubled(values: Ints) -> Ints:
    return np.concatenate((values, values))


@njit(cache=True)
def search(
    cost: Bytes, weight: Floats, width: int, start: int, goal: int, guided: bool, landmarks: Floats, bucket: float,
    num_buckets: int, g: Floats, state: Bytes, parent: Bytes, generation: int,
) -> float:  # fmt: skip
    """Fill `g` and `parent` until the cheapest way from `start` to `goal` is known; return its cost, inf if none.

    Parameters
    ----------
    cost : uint8 (N,) costs with a blocked border; weight : float64 (256,) weight of a cell per unit length, at least
    1, inf where blocked; width : columns with border; guided : A* with `lower_bound`, else
    Dijkstra; landmarks : see `lower_bound`; bucket : width of a priority bucket; num_buckets : more than the greatest rise of the priority over one
    edge, in buckets; g : float64 (N,), state : uint8 (N,), parent : uint8 (N,) work space that is kept from call to
    call; generation : a number that grows by one from call to call, from 1 to `GENERATIONS`; `state` is all 0 before the first.

    Notes
    -----
    An edge costs its length times the mean weight of its two cells. Cells wait in buckets of priorities; those of one
    bucket are taken newest first and again where they got cheaper, and are dropped where they cannot beat the cheapest way
    to the goal that is known. So the result is exact: the search ends when the goal's own bucket is empty, and then no
    waiting cell can be on a cheaper way.
    """
    rows, columns = np.array([-1, -1, -1, 0, 0, 1, 1, 1]), np.array([-1, 0, 1, -1, 1, -1, 0, 1])
    steps = rows * width + columns
    lengths = np.sqrt((rows * rows + columns * columns).astype(np.float64))
    heads = np.full(num_buckets, -1)
    nodes, links, hopes = np.zeros(1024, dtype=np.int64), np.zeros(1024, dtype=np.int64), np.zeros(1024)
    known = 0.0 if start == goal else np.inf
    used, spare, waiting = 0, -1, 1
    opened, done = 2 * generation, 2 * generation + 1
    g[start] = 0.0
    state[start] = opened
    parent[start] = 255
    goal_row, goal_column = goal // width, goal % width
    current = 0
    if guided:
        down, across = abs(start // width - goal_row), abs(start % width - goal_column)
        current = int(lower_bound(landmarks, start, goal, down, across) / bucket)
    nodes[0], links[0], hopes[0], used = start, -1, 0.0, 1
    slot = current % num_buckets
    heads[slot] = 0
    while waiting > 0:
        entry = heads[slot]
        if entry < 0:
            if int(min(known, 1e15) / bucket) <= current:
                break
            current += 1
            slot = slot + 1 if slot + 1 < num_buckets else 0
            continue
        heads[slot] = links[entry]
        links[entry] = spare
        spare = entry
        waiting -= 1
        node = nodes[entry]
        if state[node] == done or hopes[entry] > known - HAIR:
            continue
        state[node] = done
        base = g[node]
        half = 0.5 * weight[cost[node]]
        row, column = node // width - goal_row, node % width - goal_column
        for k in range(8):
            neighbour = node + steps[k]
            toll = weight[cost[neighbour]]
            if toll == np.inf:
                continue
            cheaper = base + lengths[k] * (half + 0.5 * toll)
            if state[neighbour] >= opened and g[neighbour] <= cheaper + HAIR:
                continue
            if (
                lengths[k] > 1.0
                and max(weight[cost[node + columns[k]]], weight[cost[node + rows[k] * width]]) == np.inf
            ):
                continue
            g[neighbour] = cheaper
            state[neighbour] = opened
            parent[neighbour] = k
            priority = cheaper
            if guided:
                priority += lower_bound(landmarks, neighbour, goal, abs(row + rows[k]), abs(column + columns[k]))
            if neighbour == goal:
                known = cheaper
            if priority > known - HAIR:
                continue
            # Rounding may put a priority a hair below the current bucket.
            into = slot + max(0, int(priority / bucket) - current)
            if into >= num_buckets:
                into -= num_buckets
            if spare < 0:
                if used == len(nodes):
                    nodes, links, hopes = _doubled(nodes), _doubled(links), np.concatenate((hopes, hopes))
                fresh = used
                used += 1
            else:
                fresh = spare
                spare = links[spare]
            nodes[fresh] = neighbour
            hopes[fresh] = priority
            links[fresh] = heads[into]
            heads[into] = fresh
            waiting += 1
    return g[goal] if state[goal] >= opened else np.inf


@njit(cache=True)
def trace(parent: Bytes, start: int, goal: int, width: int) -> Ints:
    """Return int64 (M,), the flat cells from `start` to `goal` by the parents that `search` left."""
    steps = np.array([-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1])
    count = 1
    node = goal
    while node != start:
        node -= steps[parent[node]]
        count += 1
    path = np.empty(count, dtype=np.int64)
    node = goal
    for i in range(count - 1, -1, -1):
        path[i] = node
        if i > 0:
            node -= steps[parent[node]]
    return path
