# SPDX-License-Identifier: MIT
"""The searches by name, and the line through what they find."""

from __future__ import annotations

import math
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import grid_search, navfn, path_shape, theta_star
from slamcli.navigation.grid_search import GridSearch
from slamcli.navigation.navfn import NavFn
from slamcli.navigation.path_shape import anchored, distinct, line_integral, simplify
from slamcli.navigation.search_space import Cell, SearchGrid
from slamcli.navigation.theta_star import ThetaStar

Method = Literal["navfn", "dijkstra", "astar", "theta_star"]
METHODS: tuple[Method, ...] = ("navfn", "dijkstra", "astar", "theta_star")


class Search(Protocol):
    """Finds paths between cells of one grid."""

    def find(self, start: Cell, goal: Cell) -> tuple[NDArray[np.float64], float]:
        """Return rows and columns (N, 2) and the cost in cells; UnreachableError if there is no way."""

    def reached(self, cell: Cell) -> bool:
        """Whether the last search came to a cell."""


def make_search(method: Method, grid: SearchGrid) -> Search:
    """Return the search of a method on a grid."""
    if method == "navfn":
        return NavFn(grid)
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
    """Return what a search found as a line (N, 2) from point to point, simplified where the parameters say so."""
    if method in ("dijkstra", "astar"):
        path = anchored(cells_rc, start_rc, goal_rc)
    else:
        path = np.vstack([start_rc, cells_rc[1:-1], goal_rc])
        if method == "theta_star" and not math.isfinite(line_integral(grid, path)):
            # What the centres of the end cells see, the points in them need not.
            path = np.vstack([start_rc, cells_rc, goal_rc])
    path = distinct(path)
    return simplify(grid, path) if grid.parameters.simplify else path


def warm(method: Method) -> None:
    """Load the compiled code of one method."""
    if method == "navfn":
        navfn.warm()
    elif method == "theta_star":
        theta_star.warm()
    else:
        grid_search.warm()
    path_shape.warm()
