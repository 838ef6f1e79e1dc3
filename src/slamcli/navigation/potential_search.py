# SPDX-License-Identifier: MIT
"""ROS' global_planner: Dijkstra's wave or its own A*, with a plain or quadratic potential, along the grid or the gradient."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation import _navfn_kernels as navfn_kernels
from slamcli.navigation import _potential_kernels as kernels
from slamcli.navigation.costmap import LETHAL, NO_INFORMATION
from slamcli.navigation.navfn import STEP_CELLS
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.search_space import Cell, SearchGrid, UnreachableError, sample_space

COST_FACTOR = 3.0
"""global_planner's default of cost_factor; the other planners' is 0.8."""

_ALL = slice(None)
_RIM: tuple[tuple[int | slice, int | slice], ...] = ((1, _ALL), (-2, _ALL), (_ALL, 1), (_ALL, -2))
"""The outermost cells of the map in a grid with a border."""


class PotentialSearch:
    """Finds global_planner's paths on one search grid; keeps its work space from query to query.

    The options are those of `PlannerParameters`. With `use_dijkstra` a cell costs `neutral_cost + cost_factor * value`, at most
    ``lethal_cost - 1``, and blocks from a value of ``lethal_cost - 1`` on; A* takes `neutral_cost + value` whatever the
    factor, blocks from `lethal_cost` on, guides by Manhattan distance and keeps the first potential a cell gets, so that
    its paths are not the cheapest: all as in the original. As there, the wave begins at the start's exact place within its cell
    unless `old_navfn_behavior` is on (Dijkstra only), and `outline_map` blocks the map's outermost cells.

    Differences, deliberate: no limit on cycles; paths never cut the corner of a blocked cell; coordinates mean cell centres; of
    equal priorities A* takes what its own heap gives.

    References
    ----------
    ROS package global_planner (noetic).
    """

    def __init__(self, space: SearchGrid) -> None:
        self._space = space
        self._parameters = space.parameters
        self._levels = space.levels.reshape(-1)
        self._toll = potential_tolls(space)
        # What NavFn's gradient descent asks: free or not.
        self._free_or_not = np.where(np.isfinite(self._toll), 0, navfn_kernels.OBSTACLE).astype(np.uint8)
        self._potential = np.empty(self._levels.size, dtype=np.float32)
        self._pending = np.zeros(self._levels.size, dtype=np.bool_)

    def find(
        self, start: Cell, goal: Cell, start_rc: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float64], float]:
        """Return the path, float64 (N, 2) row and column with centres at whole numbers, and its cost in cells.

        `start_rc` is the start's exact place, row and column; by default the centre of its cell.

        Raises
        ------
        UnreachableError
            If they do not hang together.
        """
        if not self._parameters.outline_map:
            return self._find(start, goal, start_rc)
        levels, own = self._space.levels, self._space.levels[start[0] + 1, start[1] + 1]
        rim = [levels[at].copy() for at in _RIM]
        try:
            for at in _RIM:
                levels[at] = LETHAL
            levels[start[0] + 1, start[1] + 1] = own
            return self._find(start, goal, start_rc)
        finally:
            for place, before in zip(_RIM, rim, strict=True):
                levels[place] = before

    def _find(self, start: Cell, goal: Cell, start_rc: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], float]:
        space, parameters = self._space, self._parameters
        source, target = space.flat(start), space.flat(goal)
        if source == target:
            return np.array([start, goal], dtype=np.float64), 0.0
        self._potential[:] = kernels.UNREACHED
        quadratic = parameters.use_quadratic
        if parameters.use_dijkstra:
            sources = self._seed(start, start_rc)
            kernels.spread_wave(
                self._levels, self._toll, space.stride, sources, target, quadratic, float(parameters.lethal_cost),
                2.0 * parameters.neutral_cost, self._potential, self._pending,
            )  # fmt: skip
        else:
            kernels.expand_astar(
                self._levels, self._toll, space.stride, source, target, quadratic, parameters.neutral_cost, self._potential
            )  # fmt: skip
        if self._potential[target] >= kernels.UNREACHED:
            raise UnreachableError(f"no path from cell {start} to cell {goal}")
        cost = float(self._potential[target]) / parameters.neutral_cost
        if not parameters.old_navfn_behavior:
            kernels.clear_endpoint(self._levels, self._toll, space.stride, target, quadratic, self._potential)
        # Every way ends at the start, also where a cell beside it has been given a potential of 0, too.
        self._potential[source] = -1.0
        return (self._grid_path if parameters.use_grid_path else self._gradient_path)(source, target), cost

    def reached(self, cell: Cell) -> bool:
        """Whether the last search came to a cell."""
        return bool(self._potential[self._space.flat(cell)] < kernels.UNREACHED)

    def _seed(self, start: Cell, start_rc: NDArray[np.float64] | None) -> NDArray[np.int64]:
        """Set the first potentials and return the cells beside them."""
        space, width = self._space, self._space.stride
        if self._parameters.old_navfn_behavior or start_rc is None:
            seeds = {space.flat(start): 0.0}
        else:
            row, column = (math.floor(v) for v in start_rc)
            dy, dx = (round(float(v) - math.floor(v), 2) for v in start_rc)
            first = (row + 1) * width + column + 1
            weight = 2.0 * self._parameters.neutral_cost
            seeds = {
                first: weight * dx * dy,
                first + 1: weight * (1.0 - dx) * dy,
                first + width: weight * dx * (1.0 - dy),
                first + width + 1: weight * (1.0 - dx) * (1.0 - dy),
            }
            seeds = {cell: value for cell, value in seeds.items() if self._joined(space.flat(start), cell)}
        for cell, value in seeds.items():
            self._potential[cell] = value
        around = {cell + step for cell in seeds for step in (1, -1, width, -width)} - set(seeds)
        inside = [cell for cell in sorted(around) if width < cell < self._levels.size - width]
        return np.array(inside, dtype=np.int64)

    def _joined(self, own: int, cell: int) -> bool:
        """Whether one step leads from the start's cell to a free one around it without cutting a corner."""
        if cell == own:
            return True
        row = (cell // self._space.stride - own // self._space.stride) * self._space.stride
        between = {cell, own + row, cell - row} - {own}
        return bool(np.isfinite(self._toll[self._levels[list(between)]]).all())

    def _grid_path(self, source: int, target: int) -> NDArray[np.float64]:
        out = np.empty(4096, dtype=np.int64)
        while True:
            count = kernels.follow_cells(
                self._levels, self._toll, self._space.stride, target, source, self._potential, out
            )
            if count >= 0:
                return self._space.cells(out[:count][::-1]).astype(np.float64)
            if count == -2 or len(out) > 4 * self._levels.size:
                raise PlanningError("global_planner: the potential has no way down to the start")
            out = np.empty(4 * len(out), dtype=np.int64)

    def _gradient_path(self, source: int, target: int) -> NDArray[np.float64]:
        points = np.empty((4096, 2), dtype=np.float64)
        while True:
            count = navfn_kernels.descend(
                self._levels, self._free_or_not, self._potential, self._space.stride, target, source, STEP_CELLS, points
            )
            if count >= 0:
                return np.ascontiguousarray(points[:count][::-1, ::-1] - 1.0)
            if len(points) > 8 * self._levels.size:
                raise PlanningError("global_planner: the potential has no way down to the start")
            points = np.empty((4 * len(points), 2), dtype=np.float64)


def potential_tolls(space: SearchGrid) -> NDArray[np.float32]:
    """Return float32 (256,): what crossing a cell costs by its costmap value, inf where it blocks."""
    parameters = space.parameters
    value = np.arange(256, dtype=np.float64)
    lethal = float(parameters.lethal_cost)
    known = not space.blocked[NO_INFORMATION]
    if parameters.use_dijkstra:
        factor = COST_FACTOR if parameters.cost_factor is None else parameters.cost_factor
        toll = np.minimum(parameters.neutral_cost + factor * value, lethal - 1.0)
        open_cells = value < lethal - 1.0
    else:
        toll = parameters.neutral_cost + value
        open_cells = value < lethal
    open_cells[NO_INFORMATION] = known
    # The robot's own cells stay blocked even where lethal_cost is set higher.
    open_cells &= ~space.blocked
    return np.where(open_cells, toll, np.inf).astype(np.float32)


def warm() -> None:
    """Compile the kernels of this module."""
    for dijkstra in (True, False):
        for grid_path in (True, False):
            parameters = PlannerParameters(outline_map=False, use_dijkstra=dijkstra, use_grid_path=grid_path)
            PotentialSearch(sample_space(parameters)).find((0, 0), (3, 3))
