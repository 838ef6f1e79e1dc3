# SPDX-License-Identifier: MIT
"""Turning in place until the robot faces the way the plan leads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.goal_latch import GoalTolerances, turn_rate

_LOOK_AHEAD_M = 0.4
_DONE_SHARE = 0.25
_BEHIND_RAD = 0.5 * math.pi


class TurnToPlan:
    """Decides when the robot turns in place before it follows a plan.

    Parameters
    ----------
    threshold_rad
        Angle between the robot's heading and the way to a point 0.4 m ahead on the plan from which a slow robot turns, and
        any robot if the way leads backwards; it turns until a quarter of the threshold is left. 0: never.
    limits
        How fast the robot turns and stops.
    """

    def __init__(self, threshold_rad: float, limits: GoalTolerances) -> None:
        self._threshold_rad = threshold_rad
        self._limits = limits
        self._turning = False

    def reset(self) -> None:
        """Forget that the robot was turning."""
        self._turning = False

    def command(
        self, pose: NDArray[np.float64], twist: NDArray[np.float64], plan: NDArray[np.float64], slow_m_s: float
    ) -> NDArray[np.float64] | None:
        """Return the twist (3,) that turns the robot, or None if there is no need.

        Parameters
        ----------
        pose
            float64 (3,).
        twist
            float64 (3,), measured.
        plan
            float64 (N, 3), beginning at the pose nearest to the robot.
        slow_m_s
            Speed up to which the robot begins to turn.
        """
        angle = self._deviation(pose, plan)
        if self._turning:
            self._turning = abs(angle) > _DONE_SHARE * self._threshold_rad
        else:
            slow = math.hypot(twist[0], twist[1]) <= slow_m_s or abs(angle) > _BEHIND_RAD
            self._turning = bool(0.0 < self._threshold_rad < abs(angle) and slow)
        if not self._turning:
            return None
        limits = self._limits
        slower = np.sign(twist) * np.maximum(np.abs(twist) - np.array(limits.acc) * limits.period_s, 0.0)
        return np.array([slower[0], slower[1], turn_rate(angle, float(twist[2]), limits)])

    def _deviation(self, pose: NDArray[np.float64], plan: NDArray[np.float64]) -> float:
        """Return the angle, radians, from the heading to the way to a point ahead; a way of a few centimetres has none."""
        away = np.hypot(plan[:, 0] - pose[0], plan[:, 1] - pose[1])
        beyond = np.flatnonzero(away >= _LOOK_AHEAD_M)
        ahead = int(beyond[0]) if len(beyond) else len(plan) - 1
        if away[ahead] <= 0.5 * self._limits.xy_m:
            return 0.0
        way = math.atan2(plan[ahead, 1] - pose[1], plan[ahead, 0] - pose[0])
        return float(se2.wrap_angle(way - pose[2]))
