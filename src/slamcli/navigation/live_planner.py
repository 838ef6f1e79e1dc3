# SPDX-License-Identifier: MIT
"""Global planning on a costmap that changes while the robot drives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation import live_endpoints as ends
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import LETHAL, NO_INFORMATION
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.path_shape import dense, headings
from slamcli.navigation.planner_methods import METHODS, Method, Route, RouteEnd, Router
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.search_space import SearchGrid, UnreachableError

_SPACING_CELLS = 1.5
"""Points of a path are no farther apart: a diagonal step stays one."""
_Candidates = Callable[[SearchGrid], Iterator[ends.LiveEndpoint]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LivePath:
    """A path in the frame of the costmap it was planned on."""

    points_m: NDArray[np.float64]
    """float64 (N, 2), x and y in metres, from the start to the goal, at most 1.5 cells apart, N >= 2."""
    yaws_rad: NDArray[np.float64]
    """float64 (N,)."""
    length_m: float
    cost: float
    """What the planner minimised, in metres of free cells that would cost as much."""
    goal_offset_m: float
    """Distance of the path's end from the goal that was asked for (default_tolerance, make_plan)."""
    through_unknown: bool
    """Whether unknown cells were allowed (with allow_unknown auto: no way through known cells exists)."""
    method: Method
    directions: NDArray[np.int64] | None = None
    """int64 (N,): 1 forward, -1 in reverse; None from planners that do not know."""

    @property
    def poses(self) -> NDArray[np.float64]:
        """float64 (N, 3): x, y, yaw, as local planners take them."""
        return np.column_stack([self.points_m, self.yaws_rad])


class LivePlanner:
    """Plans on one costmap again and again.

    Nothing is prepared for the whole map: of each window one copy with a border is made, and a search costs what it
    touches until the goal is reached. Work arrays are kept as long as the window's shape stays.

    Parameters
    ----------
    parameters
        How to plan.
    method
        navfn, dijkstra, astar, theta_star, hybrid_astar or global_planner.
    """

    def __init__(self, parameters: PlannerParameters | None = None, method: Method = "navfn") -> None:
        if method not in METHODS:
            raise PlanningError(f"no planner {method!r}: choose one of {', '.join(METHODS)}")
        self.parameters = parameters or PlannerParameters()
        self.method = method
        self._levels = np.empty((0, 0), dtype=np.uint8)
        self._routers: dict[bool, Router] = {}

    def plan(self, window: CostWindow, start: Sequence[float], goal: Sequence[float]) -> LivePath:
        """Return the path from `start` to `goal`, each x, y, yaw in the window's frame.

        The start's own cell counts as free whatever the costmap says (navfn's ``clearRobotCell``), and where it lies
        among cells that are too near to an obstacle, so does the shortest way out of them (see
        `slamcli.navigation.live_endpoints.free_start`).

        Raises
        ------
        NoPathError
            If an endpoint is outside the window or blocked, or no way joins them.
        """
        self._load(window)
        tolerance = self.parameters.default_tolerance

        def candidates(grid: SearchGrid) -> Iterator[ends.LiveEndpoint]:
            return ends.goal_candidates(grid, window, goal, tolerance)

        return self._plan(window, start, goal, candidates)

    def make_plan(
        self,
        window: CostWindow,
        start: Sequence[float],
        goal: Sequence[float],
        *,
        tolerance_m: float,
        add_unreachable_goal: bool = True,
    ) -> LivePath:
        """Return a path to the goal, or to the first reachable point around it that move_base's service would find.

        Points lie on squares around the goal that grow by three cells up to `tolerance_m`. With `add_unreachable_goal`
        (``make_plan_add_unreachable_goal``) the goal itself is the path's last point all the same.

        Raises
        ------
        NoPathError
            If neither the goal nor a point around it can be reached; it is about the goal itself.
        """
        try:
            return self.plan(window, start, goal)
        except NoPathError as failure:
            if failure.status.startswith("start") or tolerance_m <= 0.0:
                raise

            def candidates(grid: SearchGrid) -> Iterator[ends.LiveEndpoint]:
                return ends.surrounding_candidates(grid, window, goal, tolerance_m)

            try:
                path = self._plan(window, start, goal, candidates)
            except NoPathError:
                raise failure from None
            return _prolonged(path, goal) if add_unreachable_goal else path

    def _load(self, window: CostWindow) -> None:
        height, width = window.costs.shape
        if self._levels.shape != (height + 2, width + 2):
            self._levels = np.full((height + 2, width + 2), LETHAL, dtype=np.uint8)
            self._routers = {}
        self._levels[1:-1, 1:-1] = window.costs

    def _router(self, window: CostWindow, allow_unknown: bool) -> Router:
        if allow_unknown not in self._routers:
            grid = SearchGrid.over(self._levels, self.parameters, allow_unknown=allow_unknown)
            self._routers[allow_unknown] = Router(self.method, grid, window.footprint, window.resolution_m)
        return self._routers[allow_unknown]

    def _plan(
        self, window: CostWindow, start: Sequence[float], goal: Sequence[float], candidates: _Candidates
    ) -> LivePath:
        """Return the path to the first candidate that can be reached; unknown cells only as `allow_unknown` says."""
        allow = self.parameters.allow_unknown
        if allow is not None:
            return self._plan_over(window, start, goal, candidates, allow_unknown=allow)
        try:
            return self._plan_over(window, start, goal, candidates, allow_unknown=False)
        except NoPathError as known:
            if known.status.endswith("_outside") or not (window.costs == NO_INFORMATION).any():
                raise
            try:
                return self._plan_over(window, start, goal, candidates, allow_unknown=True)
            except NoPathError as any_way:
                raise (known if known.status == any_way.status else any_way) from None

    def _plan_over(
        self,
        window: CostWindow,
        start: Sequence[float],
        goal: Sequence[float],
        candidates: _Candidates,
        *,
        allow_unknown: bool,
    ) -> LivePath:
        router = self._router(window, allow_unknown)
        grid = router.grid
        source = ends.locate(window, start, "start")
        way_out = ends.free_start(grid, window, source.cell)
        if way_out is None:
            raise ends.start_blocked(window, start, source.cell)
        if self.method == "hybrid_astar":
            way_out += ends.free_outline(grid, window, start, source.cell)
        try:
            flooded, why = False, ""
            for target in candidates(grid):
                # A search that failed has been everywhere: the others need not be tried.
                if flooded and not router.reached(target.cell):
                    continue
                try:
                    route = router.find(_route_end(source, start), _route_end(target, goal))
                except UnreachableError as failure:
                    flooded, why = True, str(failure)
                    continue
                return self._describe(route, window, (source, target), start, goal, allow_unknown)
            raise ends.goal_failure(grid, window, start, goal, why if self.method == "hybrid_astar" else "")
        finally:
            for cell, value in reversed(way_out):
                self._levels[cell[0] + 1, cell[1] + 1] = value

    def _describe(
        self,
        route: Route,
        window: CostWindow,
        endpoints: tuple[ends.LiveEndpoint, ends.LiveEndpoint],
        start: Sequence[float],
        goal: Sequence[float],
        through_unknown: bool,
    ) -> LivePath:
        path = route.points_rc if route.yaws_rad is not None else dense(route.points_rc, _SPACING_CELLS)
        points = (path[:, ::-1] + 0.5) * window.resolution_m + np.array(window.origin_m)
        points[0], points[-1] = endpoints[0].point_m, endpoints[1].point_m
        yaws = route.yaws_rad
        if yaws is None:
            yaws = headings(
                points,
                self.parameters.orientation,
                self.parameters.orientation_window_size,
                float(start[2]) if len(start) > 2 else None,
                float(goal[2]) if len(goal) > 2 else None,
            )
        return LivePath(
            points_m=points,
            yaws_rad=yaws,
            length_m=_length(points),
            cost=route.cost * window.resolution_m,
            goal_offset_m=math.dist(points[-1], goal[:2]),
            through_unknown=through_unknown,
            method=self.method,
            directions=route.directions,
        )


def _route_end(endpoint: ends.LiveEndpoint, pose: Sequence[float]) -> RouteEnd:
    return RouteEnd(endpoint.cell, endpoint.point_rc, float(pose[2]) if len(pose) > 2 else None)


def _prolonged(path: LivePath, goal: Sequence[float]) -> LivePath:
    """Return the path with the goal as its last point."""
    points = np.vstack([path.points_m, [goal[:2]]])
    yaw = goal[2] if len(goal) > 2 else path.yaws_rad[-1]
    return replace(
        path,
        points_m=points,
        yaws_rad=np.append(path.yaws_rad, yaw),
        length_m=_length(points),
        goal_offset_m=0.0,
        directions=None if path.directions is None else np.append(path.directions, 1),
    )


def _length(points: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
