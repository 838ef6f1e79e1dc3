# SPDX-License-Identifier: MIT
"""The global planner on the live costmap, as move_base asks it for plans."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.live_planner import LivePlanner

Array = NDArray[np.float64]


class CostmapPlanner:
    """Plans on the global costmap as it is.

    move_base asks again with every control period while there is no plan; as long as neither robot, goal nor costmap
    have changed, hybrid A* (whose failures are its dearest searches) is not asked again.
    """

    def __init__(self, planner: LivePlanner, costmap: LayeredCostmap) -> None:
        self._planner, self._costmap = planner, costmap
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


def _question(window: CostWindow, start: Array, goal: Array) -> tuple[bytes, bytes, int]:
    """Return what an answer depends on."""
    return start.tobytes(), goal.tobytes(), zlib.crc32(window.costs.data)
