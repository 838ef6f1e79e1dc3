# SPDX-License-Identifier: MIT
"""The global planner on the live costmap, as move_base asks it for plans."""

from __future__ import annotations

import dataclasses
import zlib

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.live_planner import LivePlanner

Array = NDArray[np.float64]
_INSIDE = 0.7
"""Share of the tolerance up to which places by the goal are looked for along x and y: their corners lie within it."""


class CostmapPlanner:
    """Plans on the global costmap as it is.

    A goal that stands too near to an obstacle by what the sensors say (a wall that the scanner sees a cell before the map has it)
    is planned to by the nearest free place from which it counts as reached.

    move_base asks again with every control period while there is no plan; as long as neither robot, goal nor costmap
    have changed, hybrid A* (whose failures are its dearest searches) is not asked again.
    """

    def __init__(self, planner: LivePlanner, costmap: LayeredCostmap, goal_tolerance_m: float = 0.0) -> None:
        self._planner, self._costmap = planner, costmap
        near = dataclasses.replace(
            planner.parameters, default_tolerance=max(_INSIDE * goal_tolerance_m, planner.parameters.default_tolerance)
        )
        self._near_planner = LivePlanner(near, planner.method)
        self._failed: tuple[tuple[bytes, bytes, int], NoPathError] | None = None

    def make_plan(self, start: Array, goal: Array) -> Array:
        """Return a plan (N, 3) in map.

        Raises
        ------
        NoPathError
            If there is none.
        """
        window = self._costmap.window()
        if self._failed is not None and self._failed[0] == _question(window, start, goal):
            raise self._failed[1]
        try:
            return self._planner.plan(window, start.tolist(), goal.tolist()).poses
        except NoPathError as failure:
            self._failed = None
            if self._planner.method == "hybrid_astar":
                self._failed = _question(window, start, goal), failure
                raise
            if failure.status != "goal_blocked":
                raise
            return self._near(window, start, goal, failure)

    def _near(self, window: CostWindow, start: Array, goal: Array, failure: NoPathError) -> Array:
        """Return a plan to a free place by the goal, and from there to the goal, which the robot need not get to."""
        try:
            path = self._near_planner.plan(window, start.tolist(), goal.tolist())
        except NoPathError:
            raise failure from None
        return np.vstack([path.poses, goal])


def _question(window: CostWindow, start: Array, goal: Array) -> tuple[bytes, bytes, int]:
    """Return what an answer depends on."""
    return start.tobytes(), goal.tobytes(), zlib.crc32(window.costs.data)
