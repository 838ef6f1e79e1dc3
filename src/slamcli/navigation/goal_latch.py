# SPDX-License-Identifier: MIT
"""The last stretch: stop within the goal's tolerance, turn to its heading, and say when it is reached."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.local_planner import NoCommandError


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalTolerances:
    """When a goal counts as reached, and how fast the robot stops and turns."""

    xy_m: float
    yaw_rad: float
    latch: bool
    """Once within `xy_m`, the position counts as reached for good."""
    stopped_m_s: float
    stopped_rad_s: float
    acc: tuple[float, float, float]
    """m/s², m/s², rad/s²."""
    min_vel_theta: float
    max_vel_theta: float
    period_s: float


class GoalLatch:
    """base_local_planner's ``LatchedStopRotateController``.

    Parameters
    ----------
    tolerances
        When the goal is reached.
    """

    def __init__(self, tolerances: GoalTolerances) -> None:
        self._tolerances = tolerances
        self.reset()

    def reset(self) -> None:
        """Forget that the goal's position was reached."""
        self._latched = False
        self._rotating = False

    def position_reached(self, pose: NDArray[np.float64], goal: NDArray[np.float64]) -> bool:
        """Whether the robot is, or with `latch` has been, within `xy_m` of the goal; poses (3,) in one frame."""
        near = math.hypot(goal[0] - pose[0], goal[1] - pose[1]) <= self._tolerances.xy_m
        if near or (self._latched and self._tolerances.latch):
            self._latched = True
            return True
        return False

    def goal_reached(self, pose: NDArray[np.float64], goal: NDArray[np.float64], twist: NDArray[np.float64]) -> bool:
        """Whether position and heading are reached and the robot stands."""
        return self.position_reached(pose, goal) and self._heading_reached(pose, goal) and self._stopped(twist)

    def command(
        self,
        pose: NDArray[np.float64],
        goal: NDArray[np.float64],
        twist: NDArray[np.float64],
        is_free: Callable[[NDArray[np.float64]], bool],
    ) -> NDArray[np.float64]:
        """Return the twist (3,) that stops the robot, then turns it to the goal's heading, then is zero.

        Parameters
        ----------
        pose, goal
            float64 (3,), in one frame.
        twist
            float64 (3,), measured.
        is_free
            Whether a motion at a twist (3,) hits nothing.

        Raises
        ------
        NoCommandError
            If the motion would hit an obstacle.
        """
        if self._heading_reached(pose, goal):
            self._rotating = False
            return np.zeros(3)
        if not self._rotating and not self._stopped(twist):
            slower = np.sign(twist) * np.maximum(
                np.abs(twist) - np.array(self._tolerances.acc) * self._tolerances.period_s, 0.0
            )
            if not is_free(slower):
                raise NoCommandError("stopping at the goal would hit an obstacle")
            return slower
        self._rotating = True
        turn = np.array(
            [0.0, 0.0, turn_rate(float(se2.wrap_angle(goal[2] - pose[2])), float(twist[2]), self._tolerances)]
        )
        if not is_free(turn):
            raise NoCommandError("turning to the goal's heading would hit an obstacle")
        return turn

    def _heading_reached(self, pose: NDArray[np.float64], goal: NDArray[np.float64]) -> bool:
        return abs(float(se2.wrap_angle(goal[2] - pose[2]))) <= self._tolerances.yaw_rad

    def _stopped(self, twist: NDArray[np.float64]) -> bool:
        speed = max(abs(twist[0]), abs(twist[1]))
        return bool(speed <= self._tolerances.stopped_m_s and abs(twist[2]) <= self._tolerances.stopped_rad_s)


def turn_rate(angle: float, measured: float, limits: GoalTolerances) -> float:
    """Return the turn rate, rad/s, towards a heading `angle` away: as fast as the angle is great, within the limits.

    It can be reached from the measured rate in one period and stopped before the heading, unless that means less than
    the lowest rate.
    """
    acc = limits.acc[2]
    rate = min(limits.max_vel_theta, max(limits.min_vel_theta, abs(angle)))
    rate = min(max(rate, abs(measured) - acc * limits.period_s), abs(measured) + acc * limits.period_s)
    rate = min(rate, math.sqrt(2.0 * acc * abs(angle)))
    return math.copysign(min(limits.max_vel_theta, max(limits.min_vel_theta, rate)), angle)
