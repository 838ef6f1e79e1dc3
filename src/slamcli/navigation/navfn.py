# SPDX-License-Identifier: MIT
"""NavFn: a navigation function by wave propagation, and the path down its gradient, as in ROS' default planner."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation import _navfn_kernels as kernels
from slamcli.navigation.costmap import INSCRIBED, NO_INFORMATION
from slamcli.navigation.search_space import Cell, SearchGrid, UnreachableError, sample_space

STEP_CELLS = 0.5
"""Length of a step down the gradient."""


class NavFn:
    """Finds NavFn's paths on one search space; keeps its work space from query to query.

    The space's levels may change between queries, its shape may not; a query costs what its wave touches.

    The wave grows from the start until it reaches the goal; the path goes down from the goal and is turned round. A cell
    costs 50 + 0.8 times its costmap value, cut to whole numbers, at most 253; unknown cells cost 253.

    Differences from the original, which are deliberate: no limit on rounds, waiting cells and path length (the original
    gives up in large mazes); cells on the border of the map may be used; coordinates mean cell centres (the original
    shifts paths by half a cell); a step that would leave the free cells is replaced by one to a neighbour.

    References
    ----------
    Brock, Khatib: High-Speed Navigation Using the Global Dynamic Window Approach, 1999; ROS package navfn.
    """

    def __init__(self, space: SearchGrid) -> None:
        self._space = space
        self._levels = space.levels.reshape(-1)
        self._toll = traversal_costs(space)
        self.potential = np.empty(self._levels.size, dtype=np.float32)
        self._pending = np.empty(self._levels.size, dtype=np.bool_)
        self._extent = np.array([0, self._levels.size])

    def find(self, start: Cell, goal: Cell) -> tuple[NDArray[np.float64], float]:
        """Return the path, float64 (N, 2) row and column with centres at whole numbers, and its cost in cells.

        The cost is the goal's potential over the neutral cost. Both cells must be free ones of the space.

        Raises
        ------
        UnreachableError
            If they do not hang together.
        """
        space = self._space
        source, target = space.flat(start), space.flat(goal)
        if source == target:
            return np.array([start, goal], dtype=np.float64), 0.0
        self.compute_potential(start, goal)
        if self.potential[target] >= kernels.UNREACHED:
            raise UnreachableError(f"no path from cell {start} to cell {goal}")
        points = np.empty((4096, 2), dtype=np.float64)
        while True:
            count = kernels.descend(
                self._levels, self._toll, self.potential, space.stride, target, source, STEP_CELLS, points
            )
            if count >= 0:
                break
            if len(points) > 8 * self._levels.size:
                raise PlanningError(f"no way down from cell {goal} to cell {start}")
            points = np.empty((4 * len(points), 2), dtype=np.float64)
        path = points[:count][::-1, ::-1] - 1.0
        return np.ascontiguousarray(path), float(self.potential[target]) / space.parameters.neutral_cost

    def reached(self, cell: Cell) -> bool:
        """Whether the last wave came to a cell."""
        return bool(self.potential[self._space.flat(cell)] < kernels.UNREACHED)

    def compute_potential(self, origin: Cell, target: Cell) -> NDArray[np.float32]:
        """Return float32 (H, W), the potential after the wave from `origin` has reached `target` (1e10: not reached)."""
        space = self._space
        kernels.propagate(
            self._levels,
            self._toll,
            space.stride,
            space.flat(origin),
            space.flat(target),
            self.potential,
            self._pending,
            self._extent,
        )
        return self.potential.reshape(space.levels.shape)[1:-1, 1:-1]


def traversal_costs(space: SearchGrid) -> NDArray[np.uint8]:
    """Return uint8 (256,), NavFn's cost of a cell by costmap value; 254 is an obstacle."""
    value = np.arange(256)
    parameters = space.parameters
    cost = np.minimum((parameters.neutral_cost + parameters.factor * value).astype(np.int64), kernels.OBSTACLE - 1)
    cost[INSCRIBED:] = kernels.OBSTACLE
    if not space.blocked[NO_INFORMATION]:
        cost[NO_INFORMATION] = kernels.OBSTACLE - 1
    return cost.astype(np.uint8)


def warm() -> None:
    """Compile the kernels of this module."""
    NavFn(sample_space()).find((0, 0), (3, 3))
