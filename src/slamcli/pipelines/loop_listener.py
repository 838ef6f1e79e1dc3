# SPDX-License-Identifier: MIT
"""What a closed loop tells those who record, draw or count it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.measurements import LaserScan, Odometry
from slamcli.navigation.cost_window import CostWindow

Array = NDArray[np.float64]


class LoopListener:
    """Is told everything that happens in a closed loop, in the order of simulated time; each method does nothing by itself.

    Arrays are only valid during the call: copy what is kept. Times are simulated seconds from the start of the loop.
    """

    def on_truth(self, time_s: float, pose_map: Array, twist: Array) -> None:
        """Where the robot truly is: pose (3,), x, y, yaw in the world (metres, radians), and body velocity (3,)."""

    def on_odometry(self, time_s: float, odometry: Odometry) -> None:
        """What the wheels told."""

    def on_scan(self, time_s: float, scan: LaserScan) -> None:
        """What the scanner saw."""

    def on_localisation(self, time_s: float, T_map_odom: Array, covariance: Array, particles: Array) -> None:
        """The localiser's correction (3,), covariance (3, 3) of the pose in map (x, y, yaw), and particles (N, 3), N may be 0."""

    def on_command(self, time_s: float, twist: Array) -> None:
        """The velocity (3,) that the robot is asked for."""

    def on_costmap(self, time_s: float, name: str, costmap: CostWindow) -> None:
        """A costmap (``global`` or ``local``) after an update."""

    def on_plan(self, time_s: float, plan: Array) -> None:
        """A new global plan, float64 (N, 3) in map."""

    def on_local_plan(self, time_s: float, trajectory: Array) -> None:
        """What the local planner expects, float64 (N, 3) in odom."""

    def on_map(self, time_s: float, grid: OccupancyGrid) -> None:
        """The map: once when it is known beforehand, at every update when it is being made."""

    def on_people(self, time_s: float, discs: Array) -> None:
        """What else moves: float64 (D, 5) x, y, radius, vx, vy in the world."""

    def on_goal(self, time_s: float, goal: Array) -> None:
        """A goal (3,) in map was given to move_base."""

    def on_status(self, time_s: float, state: str, message: str) -> None:
        """move_base changed its state (planning, controlling, clearing, succeeded, aborted), and why."""
