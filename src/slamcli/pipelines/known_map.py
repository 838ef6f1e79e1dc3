# SPDX-License-Identifier: MIT
"""What the map alone says, before any sensor has: whether there is a way, and how short one can be."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.live_planner import LivePath, LivePlanner
from slamcli.navigation.planner_methods import Method
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.shortest_path import shortest_length


class KnownMap:
    """A global costmap as it is before the robot has seen anything.

    Parameters
    ----------
    parameters
        How is planned.
    window
        The costmap; copied.
    method
        Of planning; hybrid_astar: whether NavFn finds a way is asked first, because it is fast and complete.
    """

    def __init__(self, parameters: PlannerParameters, window: CostWindow, method: Method = "navfn") -> None:
        self.window = dataclasses.replace(window, costs=window.costs.copy())
        self._planners = [LivePlanner(parameters)]
        if method == "hybrid_astar":
            self._planners.append(LivePlanner(parameters, method))
        self._through_unknown = parameters.allow_unknown is not False

    def cost(self, x: float, y: float) -> int | None:
        """Return the cost (0 to 255) at a place, metres; None outside."""
        window = self.window
        column = math.floor((x - window.origin_m[0]) / window.resolution_m)
        row = math.floor((y - window.origin_m[1]) / window.resolution_m)
        if not (0 <= row < window.costs.shape[0] and 0 <= column < window.costs.shape[1]):
            return None
        return int(window.costs[row, column])

    def plan(self, start: Sequence[float], goal: Sequence[float]) -> LivePath:
        """Return the path: NavFn's, or hybrid A*'s where that is the method.

        Raises
        ------
        NoPathError
            If there is none; it says why.
        """
        return [planner.plan(self.window, start, goal) for planner in self._planners][-1]

    def shortest_m(self, start: Sequence[float], goal: Sequence[float]) -> float:
        """Return the length of the shortest way for the inflated robot, through unknown cells only if there is no other."""
        length = shortest_length(self.window, start, goal)
        if math.isinf(length) and self._through_unknown:
            length = shortest_length(self.window, start, goal, allow_unknown=True)
        return length
