# SPDX-License-Identifier: MIT
"""From a start to a goal on a costmap: endpoints, search, headings, figures."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry.se2 import wrap_angle
from slamcli.grids.distance import least_distance
from slamcli.navigation import planner_methods
from slamcli.navigation.costmap import NO_INFORMATION, Costmap
from slamcli.navigation.endpoints import Endpoint, Endpoints, NoPathError
from slamcli.navigation.path_shape import dense, headings
from slamcli.navigation.planner_methods import METHODS, Method, Route, RouteEnd, Router
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.search_space import SearchSpace, UnreachableError

__all__ = ["METHODS", "GlobalPlanner", "Method", "NoPathError", "PlannedPath"]


_REACH_ALL_THAT_HANGS_TOGETHER: tuple[Method, ...] = ("navfn", "dijkstra", "astar")


@dataclass(frozen=True, slots=True, eq=False)
class _Finder:
    space: SearchSpace
    endpoints: Endpoints
    router: Router


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedPath:
    """A path in the map frame."""

    points_m: NDArray[np.float64]
    """float64 (N, 2), x and y in metres, from the start to the goal, N >= 2."""
    yaws_rad: NDArray[np.float64]
    """float64 (N,)."""
    length_m: float
    """Length of the line through `points_m`."""
    cost: float
    """What the planner minimised, in metres of free cells that would cost as much."""
    clearance_m: float
    """Least distance from the path to the edge of an occupied cell; inf on a map without any."""
    unknown_m: float
    """Length of the path through unknown cells."""
    goal_offset_m: float
    """Distance of the path's end from the goal that was asked for (default_tolerance)."""
    method: Method
    directions: NDArray[np.int64] | None = None
    """int64 (N,): 1 forward, -1 in reverse; None from planners that do not know."""

    @property
    def reverse_m(self) -> float:
        """Length that is driven in reverse; 0 from planners that do not know directions."""
        if self.directions is None:
            return 0.0
        steps = np.linalg.norm(np.diff(self.points_m, axis=0), axis=1)
        return float(steps[self.directions[1:] < 0].sum())


class GlobalPlanner:
    """Plans any number of paths on one costmap.

    Parameters
    ----------
    costmap
        Where to plan.
    parameters
        How.
    method
        navfn, dijkstra, astar, theta_star, hybrid_astar or global_planner.
    """

    def __init__(self, costmap: Costmap, parameters: PlannerParameters | None = None, method: Method = "navfn") -> None:
        self.parameters = parameters or PlannerParameters()
        self.costmap = costmap
        self.method = method
        self._lethal = costmap.lethal
        self._has_unknown = bool((costmap.costs == NO_INFORMATION).any())
        self._finders: dict[bool, _Finder] = {}

    def plan(self, start: Sequence[float], goal: Sequence[float]) -> PlannedPath:
        """Return the path from `start` to `goal`, each x, y or x, y, yaw in metres and radians, map frame.

        The path keeps to cells that are neither lethal nor within the inscribed radius (nor unknown, see
        `allow_unknown`), and begins and ends exactly where it was asked to, `default_tolerance` apart.

        Raises
        ------
        NoPathError
            If an endpoint is outside the map or blocked, or no way joins them; it knows the nearest point that would do.
        """
        allow = self.parameters.allow_unknown
        if allow is not None:
            return self._plan(start, goal, allow_unknown=allow)
        try:
            return self._plan(start, goal, allow_unknown=False)
        except NoPathError as known:
            if not self._has_unknown:
                raise
            try:
                return self._plan(start, goal, allow_unknown=True)
            except NoPathError as any_way:
                raise (known if known.status == any_way.status else any_way) from None

    def prepare(self) -> None:
        """Load compiled code and prepare the search space now, so that the first query is as fast as the next."""
        self._finder(bool(self.parameters.allow_unknown))
        planner_methods.warm(self.method)

    def prepare_for_many(self) -> None:
        """Do now what makes many queries faster; a single one is not worth it."""
        finder = self._finder(bool(self.parameters.allow_unknown))
        finder.router.prepare_for_many(finder.space.regions)

    def _plan(self, start: Sequence[float], goal: Sequence[float], *, allow_unknown: bool) -> PlannedPath:
        finder = self._finder(allow_unknown)
        if self.method in _REACH_ALL_THAT_HANGS_TOGETHER and not finder.space.knows_regions:
            # On a large map what hangs together takes as long to find as a path, and a path that is found tells.
            ends = finder.endpoints.where_free(start, goal)
            if ends is not None:
                with contextlib.suppress(UnreachableError):
                    return self._describe(self._route(finder, ends, start, goal), ends, start, goal)
        ends = finder.endpoints.resolve(start, goal)
        try:
            route = self._route(finder, ends, start, goal)
        except UnreachableError as failure:
            # The cells hang together, so it is the robot's shape or turning radius that finds no way.
            message = f"no path from {_show(start)} to {_show(goal)}: {failure}"
            raise NoPathError(message, "unreachable", None, math.inf) from failure
        return self._describe(route, ends, start, goal)

    def _route(
        self, finder: _Finder, ends: tuple[Endpoint, Endpoint], start: Sequence[float], goal: Sequence[float]
    ) -> Route:
        return finder.router.find(self._route_end(ends[0], start), self._route_end(ends[1], goal))

    def _route_end(self, endpoint: Endpoint, pose: Sequence[float]) -> RouteEnd:
        yaw = float(pose[2]) - self.costmap.grid.origin[2] if len(pose) > 2 else None
        return RouteEnd(endpoint.cell, endpoint.point_rc, yaw)

    def _finder(self, allow_unknown: bool) -> _Finder:
        """Return what plans with or without unknown cells; built when it is first needed."""
        if allow_unknown not in self._finders:
            space = SearchSpace.build(self.costmap, self.parameters, allow_unknown=allow_unknown)
            self._finders[allow_unknown] = _Finder(
                space,
                Endpoints(space),
                Router(self.method, space, self.costmap.footprint, self.costmap.grid.resolution_m),
            )
        return self._finders[allow_unknown]

    def _describe(
        self,
        route: Route,
        ends: tuple[Endpoint, Endpoint],
        start: Sequence[float],
        goal: Sequence[float],
    ) -> PlannedPath:
        grid, path_rc = self.costmap.grid, route.points_rc
        points = grid.cell_to_map(path_rc)
        points[0], points[-1] = ends[0].point_m, ends[1].point_m
        if route.yaws_rad is None:
            yaws = headings(
                points,
                self.parameters.orientation,
                self.parameters.orientation_window_size,
                start[2] if len(start) > 2 else None,
                goal[2] if len(goal) > 2 else None,
            )
        else:
            yaws = wrap_angle(route.yaws_rad + grid.origin[2])
        samples = dense(path_rc, 0.5)
        cells = np.clip(np.floor(samples + 0.5).astype(np.int64), 0, np.array(grid.cells.shape) - 1)
        steps = np.linalg.norm(np.diff(samples, axis=0), axis=1)
        unknown = self.costmap.costs[cells[:-1, 0], cells[:-1, 1]] == NO_INFORMATION
        clearance = least_distance(self._lethal, self.costmap.squared_distance, samples)
        return PlannedPath(
            points_m=points,
            yaws_rad=yaws,
            length_m=float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
            cost=route.cost * grid.resolution_m,
            clearance_m=clearance * grid.resolution_m,
            unknown_m=float(steps[unknown].sum()) * grid.resolution_m,
            goal_offset_m=float(math.dist(points[-1], goal[:2])),
            method=self.method,
            directions=route.directions,
        )


def _show(point: Sequence[float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"
