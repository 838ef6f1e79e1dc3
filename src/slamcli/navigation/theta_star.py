# SPDX-License-Identifier: MIT
"""Theta*: cheap paths whose lines run at any angle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _path_kernels as kernels
from slamcli.navigation.search_space import Cell, SearchGrid, UnreachableError, sample_space


class ThetaStar:
    """Finds any-angle paths on one search space; keeps its work space from query to query.

    A* on the 8-connected grid in which a cell's predecessor may be any cell that it sees: the line to it replaces the steps
    where it costs no more. A line costs the sum over its cells of the length inside times their weight, so costs are respected
    exactly; a line touches no blocked cell. Not optimal in theory, usually within a percent of it, never dearer than A* by much:
    the turning points are cell centres.

    References
    ----------
    Nash, Daniel, Koenig, Felner: Theta*: Any-Angle Path Planning on Grids, AAAI 2007. Costs as in nav2's theta_star_planner.
    """

    def __init__(self, space: SearchGrid) -> None:
        self._space = space
        size = space.levels.size
        self._g = np.empty(size, dtype=np.float64)
        self._state = np.zeros(size, dtype=np.int64)
        self._parent = np.empty(size, dtype=np.int64)
        self._generation = 0

    def find(self, start: Cell, goal: Cell) -> tuple[NDArray[np.float64], float]:
        """Return the turning points, float64 (N, 2) row and column of cell centres, and the cost in cells.

        Both cells must be free ones of the space.

        Raises
        ------
        UnreachableError
            If they do not hang together.
        """
        space = self._space
        source, target = space.flat(start), space.flat(goal)
        self._generation += 1
        cost = kernels.search_any_angle(
            space.levels.reshape(-1),
            space.blocked,
            space.weight,
            space.stride,
            source,
            target,
            self._g,
            self._state,
            self._parent,
            self._generation,
        )
        if not math.isfinite(cost):
            raise UnreachableError(f"no path from cell {start} to cell {goal}")
        path = [target]
        while path[-1] != source:
            path.append(int(self._parent[path[-1]]))
        return space.cells(np.array(path[::-1])).astype(np.float64), float(cost)

    def reached(self, cell: Cell) -> bool:
        """Whether the last search came to a cell."""
        return bool(self._state[self._space.flat(cell)] == self._generation)


def warm() -> None:
    """Compile the kernels of this module."""
    ThetaStar(sample_space()).find((0, 0), (3, 3))
