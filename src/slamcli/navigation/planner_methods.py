# SPDX-License-Identifier: MIT
"""The planners by name, and the routes they find between two points of one grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation import grid_search, hybrid_astar, navfn, path_shape, potential_search, theta_star
from slamcli.navigation.grid_search import GridSearch
from slamcli.navigation.hybrid_astar import HybridAStar
from slamcli.navigation.navfn import NavFn
from slamcli.navigation.path_shape import anchored, distinct, line_integral, simplify, smooth
from slamcli.navigation.potential_search import PotentialSearch
from slamcli.navigation.search_space import Cell, SearchGrid
from slamcli.navigation.theta_star import ThetaStar

Method = Literal["navfn", "dijkstra", "astar", "theta_star", "hybrid_astar", "global_planner"]
METHODS: tuple[Method, ...] = ("navfn", "dijkstra", "astar", "theta_star", "hybrid_astar", "global_planner")


@dataclass(frozen=True, slots=True, eq=False)
class RouteEnd:
    """Where a route begins or ends."""

    cell: Cell
    point_rc: NDArray[np.float64]
    """float64 (2,), row and column with centres at whole numbers."""
    yaw_rad: float | None
    """Heading about the grid's axes; None where any will do."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """What a planner found, in cells of the grid."""

    points_rc: NDArray[np.float64]
    """float64 (N, 2), row and column with centres at whole numbers."""
    cost: float
    """In cells of free space."""
    yaws_rad: NDArray[np.float64] | None = None
    """float64 (N,) about the grid's axes, from planners that know headings."""
    directions: NDArray[np.int64] | None = None
    """int64 (N,): 1 forward, -1 in reverse, from planners that know directions."""


class Search(Protocol):
    """Finds paths between cells of one grid."""

    def find(self, start: Cell, goal: Cell) -> tuple[NDArray[np.float64], float]:
        """Return rows and columns (N, 2) and the cost in cells; UnreachableError if there is no way."""

    def reached(self, cell: Cell) -> bool:
        """Whether the last search came to a cell."""


class Router:
    """Plans on one grid, whose levels may change between queries.

    Parameters
    ----------
    method
        Which planner.
    grid
        Where.
    footprint
        float64 (F, 2), metres, base frame: the robot's outline (hybrid A* only; others trust the inflated cells).
    resolution_m
        Size of a cell.
    """

    def __init__(self, method: Method, grid: SearchGrid, footprint: NDArray[np.float64], resolution_m: float) -> None:
        self.grid = grid
        self._method = method
        self._footprint_cells = np.asarray(footprint, dtype=np.float64) / resolution_m
        self._resolution_m = resolution_m
        self._hybrid = HybridAStar(grid, grid.parameters.hybrid) if method == "hybrid_astar" else None
        self._search: Search = make_search(method, grid) if self._hybrid is None else self._hybrid.grid_search

    def find(self, start: RouteEnd, goal: RouteEnd) -> Route:
        """Return the route between two free cells.

        Raises
        ------
        UnreachableError
            If they do not hang together, or there is no drivable way.
        """
        if self._hybrid is not None:
            first, last = (_pose(end) for end in (start, goal))
            path = self._hybrid.find(first, last, self._footprint_cells, self._resolution_m)
            return Route(path.poses[:, 1::-1].copy(), path.cost, path.poses[:, 2].copy(), path.directions)
        if isinstance(self._search, PotentialSearch):
            cells, cost = self._search.find(start.cell, goal.cell, start.point_rc)
        else:
            cells, cost = self._search.find(start.cell, goal.cell)
        path_rc = line_through(self._method, self.grid, cells, start.point_rc, goal.point_rc)
        if not math.isfinite(line_integral(self.grid, path_rc)):
            raise PlanningError(f"the {self._method} path touches an obstacle: please report this map")
        return Route(path_rc, cost)

    def reached(self, cell: Cell) -> bool:
        """Whether the last search, which failed, came to a cell."""
        return self._hybrid is None and self._search.reached(cell)

    def prepare_for_many(self, regions: NDArray[np.int32]) -> None:
        """Do now what makes many queries on levels that do not change faster."""
        if isinstance(self._search, GridSearch) and self._hybrid is None:
            self._search.prepare(regions)


def make_search(method: Method, grid: SearchGrid) -> Search:
    """Return the search over cells of a method on a grid."""
    if method == "navfn":
        return NavFn(grid)
    if method == "global_planner":
        return PotentialSearch(grid)
    if method == "theta_star":
        return ThetaStar(grid)
    return GridSearch(grid, guided=method == "astar")


def line_through(
    method: Method,
    grid: SearchGrid,
    cells_rc: NDArray[np.float64],
    start_rc: NDArray[np.float64],
    goal_rc: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return what a search found as a line (N, 2) from point to point, straightened and smoothed as the parameters say."""
    if method in ("dijkstra", "astar"):
        path = anchored(cells_rc, start_rc, goal_rc)
    else:
        path = np.vstack([start_rc, cells_rc[1:-1], goal_rc])
        if method in ("theta_star", "global_planner") and not math.isfinite(line_integral(grid, path)):
            # What the centres of the end cells see, the points in them need not.
            path = np.vstack([start_rc, cells_rc, goal_rc])
    path = distinct(path)
    if grid.parameters.simplify:
        path = simplify(grid, path)
    return smooth(grid, path) if grid.parameters.smooth else path


def _pose(end: RouteEnd) -> NDArray[np.float64]:
    yaw = math.nan if end.yaw_rad is None else end.yaw_rad
    return np.array([end.point_rc[1], end.point_rc[0], yaw])


def warm(method: Method) -> None:
    """Load the compiled code of one method."""
    modules = {
        "navfn": navfn,
        "theta_star": theta_star,
        "hybrid_astar": hybrid_astar,
        "global_planner": potential_search,
    }
    modules.get(method, grid_search).warm()
    path_shape.warm()
