# SPDX-License-Identifier: MIT
"""What move_base asks of a local planner: nav_core's ``BaseLocalPlanner``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.robot_state import RobotState


class NoCommandError(PlanningError):
    """No velocity is safe and sensible now; the message says why."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalCommand:
    """A velocity and how it came about."""

    twist: NDArray[np.float64]
    """float64 (3,): forward and leftward m/s and turn rad/s that the robot is asked for, base frame."""
    trajectory: NDArray[np.float64]
    """float64 (N, 3), poses in odom that the planner expects; N may be 0 (turning to the goal's heading)."""
    cost: float
    """What the planner minimised."""


class LocalPlanner(Protocol):
    """Follows a global plan around what the local costmap shows."""

    def set_plan(self, plan: NDArray[np.float64]) -> None:
        """Take a new global plan, float64 (N, 3), N >= 1, poses in the map frame; its last pose is the goal.

        A plan to the same goal as before (replanning) keeps what was latched, a new goal resets it.
        """

    def compute_command(self, state: RobotState, costmap: CostWindow) -> LocalCommand:
        """Return the velocity for the next control period.

        Raises
        ------
        NoCommandError
            If there is none: blocked, off the plan, or no plan.
        """

    def is_goal_reached(self, state: RobotState) -> bool:
        """Whether the robot stands at the goal, within tolerances."""

    def reset(self) -> None:
        """Forget plan and latches."""
