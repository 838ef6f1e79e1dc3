# SPDX-License-Identifier: MIT
"""Whether a start and a goal can be used, and what is nearest where they cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation.costmap import LETHAL, NO_INFORMATION
from slamcli.navigation.search_space import Cell, SearchSpace

_HAIR = 1e-9
"""Cells by which a point may miss a cell's lower edge through rounding and still lie in it."""


class NoPathError(PlanningError):
    """There is no path, and why."""

    def __init__(self, message: str, status: str, nearest_m: tuple[float, float] | None, distance_m: float) -> None:
        super().__init__(message)
        self.status = status
        """start_outside, start_blocked, goal_outside, goal_blocked or unreachable."""
        self.nearest_m = nearest_m
        """x, y of the nearest point that would do, metres, map frame; None if there is none."""
        self.distance_m = distance_m
        """How far it is from the point that was asked for; inf if there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Endpoint:
    """A point that a path can begin or end at."""

    cell: Cell
    point_rc: NDArray[np.float64]
    """float64 (2,), row and column with centres at whole numbers, within the cell by a hair."""
    point_m: tuple[float, float]
    """The point itself: x, y in metres, map frame."""


class Endpoints:
    """Checks starts and goals on one search space."""

    def __init__(self, space: SearchSpace) -> None:
        self._space = space
        self._grid = space.costmap.grid

    def where_free(self, start: Sequence[float], goal: Sequence[float]) -> tuple[Endpoint, Endpoint] | None:
        """Return both ends of a path if both cells are free, without a look at what joins them; None if one is not."""
        source, target = self._locate(start), self._locate(goal)
        return (source, target) if self._is_free(source.cell) and self._is_free(target.cell) else None

    def resolve(self, start: Sequence[float], goal: Sequence[float]) -> tuple[Endpoint, Endpoint]:
        """Return both ends of a path, the goal moved by up to `default_tolerance` where it cannot be reached itself.

        Raises
        ------
        NoPathError
            If one of them cannot be used.
        """
        source = self._locate(start)
        if self._region(source.cell) == 0:
            raise self._failure("start", start, source, None)
        region = self._region(source.cell)
        target = self._locate(goal)
        if self._region(target.cell) != region:
            near = self._within_tolerance(goal, region)
            if near is None:
                raise self._failure("goal", goal, target, region)
            target = near
        return source, target

    def _locate(self, point: Sequence[float]) -> Endpoint:
        grid = self._grid
        dx, dy = point[0] - grid.origin[0], point[1] - grid.origin[1]
        c, s = math.cos(grid.origin[2]), math.sin(grid.origin[2])
        row, column = (c * dy - s * dx) / grid.resolution_m, (c * dx + s * dy) / grid.resolution_m
        cell = (math.floor(row + _HAIR), math.floor(column + _HAIR))
        # Within its cell by more than a rounding error, so that lines from it start in that cell.
        inside = [min(max(v - k, _HAIR), 1.0 - _HAIR) + k - 0.5 for v, k in zip((row, column), cell, strict=True)]
        return Endpoint(cell, np.array(inside), (float(point[0]), float(point[1])))

    def _is_free(self, cell: Cell) -> bool:
        costs = self._space.costmap.costs
        inside = 0 <= cell[0] < costs.shape[0] and 0 <= cell[1] < costs.shape[1]
        return inside and not self._space.blocked[costs[cell]]

    def _region(self, cell: Cell) -> int:
        regions = self._space.regions
        if 0 <= cell[0] < regions.shape[0] and 0 <= cell[1] < regions.shape[1]:
            return int(regions[cell])
        return 0

    def _within_tolerance(self, goal: Sequence[float], region: int) -> Endpoint | None:
        """Return the best point of navfn's search: a square lattice around the goal with the map's resolution."""
        tolerance, step = self._space.parameters.default_tolerance, self._grid.resolution_m
        if tolerance <= 0.0:
            return None
        offsets = np.arange(-tolerance, tolerance + step * 1e-6, step)
        dy, dx = (lattice.ravel() for lattice in np.meshgrid(offsets, offsets, indexing="ij"))
        for k in np.argsort(dx * dx + dy * dy, kind="stable"):
            candidate = self._locate((goal[0] + dx[k], goal[1] + dy[k]))
            if self._region(candidate.cell) == region:
                return candidate
        return None

    def _failure(self, role: str, point: Sequence[float], located: Endpoint, region: int | None) -> NoPathError:
        grid, space = self._grid, self._space
        row, column = located.cell
        inside = 0 <= row < grid.height and 0 <= column < grid.width
        own = self._region(located.cell)
        if not inside:
            status, why = f"{role}_outside", "is outside the map"
        elif own:
            status, why = "unreachable", "cannot be reached from the start"
        else:
            status, why = f"{role}_blocked", self._why_blocked(int(space.costmap.costs[row, column]))
        nearest = space.nearest_free((float(located.point_rc[0]), float(located.point_rc[1])), region)
        what = "reachable from the start" if region else "free"
        if nearest is None:
            tail, place, distance = f"no point of this map is {what}", None, math.inf
        else:
            x, y = (float(v) for v in grid.cell_to_map([nearest])[0])
            place, distance = (x, y), math.dist((x, y), (point[0], point[1]))
            tail = f"the nearest point {what} is {x:.3f},{y:.3f}, {distance:.3f} m away"
        return NoPathError(f"{role} {point[0]:g},{point[1]:g} {why}; {tail}", status, place, distance)

    def _why_blocked(self, cost: int) -> str:
        if cost == LETHAL:
            return "is in an obstacle"
        if cost == NO_INFORMATION:
            return "is in unknown space, and allow_unknown is off"
        return f"is within the robot's inscribed radius ({self._space.costmap.inscribed_radius_m:.3f} m) of an obstacle"
