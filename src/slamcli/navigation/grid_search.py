# SPDX-License-Identifier: MIT
"""Dijkstra and A* on the 8-connected grid: the cheapest path there is."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation import _search_kernels as kernels
from slamcli.navigation.search_space import Cell, SearchSpace

_BUCKET = 0.5
_MAX_BUCKETS = 1 << 20


class GridSearch:
    """Finds cheapest paths on one search space; keeps its work space from query to query.

    Steps go to the eight neighbours, sqrt(2) long on diagonals, which need both cells beside them (no corner cutting).
    An edge costs its length times the mean weight of its two cells, with weights from `SearchSpace`. A* is guided by the
    octile distance, which never overestimates because no weight is below 1: both find the same cost.

    References
    ----------
    Hart, Nilsson, Raphael: A Formal Basis for the Heuristic Determination of Minimum Cost Paths, 1968.
    """

    def __init__(self, space: SearchSpace, *, guided: bool) -> None:
        self._space = space
        self._guided = guided
        size = space.levels.size
        self._levels = np.ascontiguousarray(space.levels).reshape(-1)
        self._g = np.empty(size, dtype=np.float64)
        self._state = np.zeros(size, dtype=np.int64)
        self._parent = np.empty(size, dtype=np.uint8)
        self._generation = 0
        rise = kernels.SQRT2 * (float(space.weight[~space.blocked].max(initial=1.0)) + 1.0)
        self._bucket = max(_BUCKET, rise / (_MAX_BUCKETS - 4))
        self._num_buckets = math.ceil(rise / self._bucket) + 4

    def find(self, start: Cell, goal: Cell) -> tuple[NDArray[np.float64], float]:
        """Return the path, float64 (N, 2) row and column of cell centres, and its cost in cells.

        Both cells must be free ones of the space.

        Raises
        ------
        PlanningError
            If they do not hang together.
        """
        space = self._space
        source, target = space.flat(start), space.flat(goal)
        self._generation += 1
        cost = kernels.search(
            self._levels,
            space.weight,
            space.blocked,
            space.stride,
            source,
            target,
            self._guided,
            self._bucket,
            self._num_buckets,
            self._g,
            self._state,
            self._parent,
            self._generation,
        )
        if not math.isfinite(cost):
            raise PlanningError(f"no path from cell {start} to cell {goal}")
        path = kernels.trace(self._parent, source, target, space.stride)
        return space.cells(path).astype(np.float64), float(cost)
