# SPDX-License-Identifier: MIT
"""Dijkstra and A* on the 8-connected grid: the cheapest path there is."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _search_kernels as kernels
from slamcli.navigation.search_space import Cell, SearchGrid, UnreachableError, sample_space

_BUCKET = 0.02
"""Width of a priority bucket in cells: cells of one bucket may be taken up again, so A* in wide halls asks for narrow ones."""
_MAX_BUCKETS = 1 << 20
_NUM_LANDMARKS = 16
_MAX_LANDMARK_CELLS = 1 << 21


class GridSearch:
    """Finds cheapest paths on one search space; keeps its work space from query to query.

    Steps go to the eight neighbours, sqrt(2) long on diagonals, which need both cells beside them (no corner cutting).
    An edge costs its length times the mean weight of its two cells, with weights from `SearchGrid`. A* is guided by the
    octile distance, which never overestimates because no weight is below 1, and after `prepare` by landmarks: both find
    the same cost.

    References
    ----------
    Hart, Nilsson, Raphael: A Formal Basis for the Heuristic Determination of Minimum Cost Paths, 1968.
    Goldberg, Harrelson: Computing the Shortest Path: A* Search Meets Graph Theory, 2005 (landmarks).
    """

    def __init__(self, space: SearchGrid, *, guided: bool) -> None:
        self._space = space
        self._guided = guided
        size = space.levels.size
        self._levels = np.ascontiguousarray(space.levels).reshape(-1)
        self._weight = np.where(space.blocked, np.inf, space.weight)
        self._g = np.empty(size, dtype=np.float64)
        self._state = np.zeros(size, dtype=np.uint8)
        self._parent = np.empty(size, dtype=np.uint8)
        self._generation = 0
        rise = kernels.SQRT2 * 2.0 * float(space.weight[~space.blocked].max(initial=1.0))
        self._bucket = max(_BUCKET, rise / (_MAX_BUCKETS - 4))
        self._num_buckets = math.ceil(rise / self._bucket) + 4

        self._landmarks = np.empty((size, 0), dtype=np.float64)

    def prepare(self, regions: NDArray[np.int32]) -> None:
        """Spend the time of about sixteen full searches to make A* faster from now on (worth it for many queries).

        Landmarks are cells far from each other in the largest region; the costs from them to all cells bound the cost
        between any two from below, much closer than the octile distance does in mazes and buildings. `regions` are those
        of the search space; its levels must not change afterwards.
        """
        space = self._space
        counts = np.bincount(regions.ravel())
        if not self._guided or self._landmarks.shape[1] or self._g.size > _MAX_LANDMARK_CELLS or len(counts) < 2:
            return
        region = int(np.argmax(counts[1:])) + 1
        at = space.flat(tuple(np.argwhere(regions == region)[0].tolist()))
        landmarks = np.zeros((self._g.size, _NUM_LANDMARKS), dtype=np.float64)
        # The first search only finds a cell on the rim to begin from.
        at = int(np.argmax(self._costs_from(at)))
        nearest = np.full(self._g.size, np.inf)
        for k in range(_NUM_LANDMARKS):
            landmarks[:, k] = self._costs_from(at)
            nearest = np.minimum(nearest, landmarks[:, k])
            at = int(np.argmax(nearest))
        self._landmarks = landmarks

    def _costs_from(self, source: int) -> NDArray[np.float64]:
        """Return float64 (N,), the cost from a flat cell to each; 0 where there is no way."""
        self._run(source, 0, guided=False)  # cell 0 is on the border: the search goes on until all is reached
        return np.where(self._state >= 2 * self._generation, self._g, 0.0)

    def find(self, start: Cell, goal: Cell) -> tuple[NDArray[np.float64], float]:
        """Return the path, float64 (N, 2) row and column of cell centres, and its cost in cells.

        Both cells must be free ones of the space.

        Raises
        ------
        UnreachableError
            If they do not hang together.
        """
        space = self._space
        source, target = space.flat(start), space.flat(goal)
        cost = self._run(source, target, guided=self._guided)
        if not math.isfinite(cost):
            raise UnreachableError(f"no path from cell {start} to cell {goal}")
        path = kernels.trace(self._parent, source, target, space.stride)
        return space.cells(path).astype(np.float64), float(cost)

    def costs_to(self, cell: Cell) -> NDArray[np.float64]:
        """Return float64, flat as the levels: the cost in cells from each cell to a free one, inf where there is no way."""
        self._run(self._space.flat(cell), 0, guided=False)
        return np.where(self._state >= 2 * self._generation, self._g, np.inf)

    def reached(self, cell: Cell) -> bool:
        """Whether the last search came to a cell."""
        return bool(self._state[self._space.flat(cell)] >= 2 * self._generation)

    def _run(self, source: int, target: int, *, guided: bool) -> float:
        space = self._space
        if self._generation == kernels.GENERATIONS:
            self._state[:] = 0
            self._generation = 0
        self._generation += 1
        cost: float = kernels.search(
            self._levels,
            self._weight,
            space.stride,
            source,
            target,
            guided,
            self._landmarks,
            self._bucket,
            self._num_buckets,
            self._g,
            self._state,
            self._parent,
            self._generation,
        )
        return cost


def warm() -> None:
    """Compile the kernels of this module."""
    space = sample_space()
    search = GridSearch(space, guided=True)
    search.prepare(space.regions)
    search.find((0, 0), (3, 3))
