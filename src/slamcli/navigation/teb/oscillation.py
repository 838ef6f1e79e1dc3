# SPDX-License-Identifier: MIT
"""What the planner tries by itself when it fails: a shorter horizon, one turning direction."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.teb.parameters import TebParameters

Array = NDArray[np.float64]
_MANY_FAILURES = 9


class OscillationRecovery:
    """Notices that the robot swings to and fro, and then prefers one turning direction for a while.

    It does where, over the last seconds, mean speed and mean turning rate are near zero and the rate changes its sign more
    than once.
    """

    def __init__(self, parameters: TebParameters, control_period_s: float) -> None:
        self._rules, self._robot = parameters.recovery, parameters.robot
        size = max(2, round(self._rules.oscillation_filter_duration / control_period_s))
        self._speeds: deque[tuple[float, float]] = deque(maxlen=size)
        self.clear()

    def clear(self) -> None:
        """Forget what was."""
        self._speeds.clear()
        self.turning = 0
        """+1 or -1 to prefer turning left or right, 0 for neither."""
        self._noticed_s = -np.inf

    def observe(self, twist: Array, time_s: float) -> None:
        """Take the command of this cycle."""
        if not self._rules.oscillation_recovery:
            return
        robot = self._robot
        top = robot.max_vel_x if twist[0] > 0.0 else robot.max_vel_x_backwards
        self._speeds.append((float(twist[0]) / top, float(twist[2]) / robot.max_vel_theta))
        if self._is_swinging():
            if self.turning == 0:
                self.turning = 1 if twist[2] > 0.0 else -1
            self._noticed_s = time_s
        elif time_s - self._noticed_s > self._rules.oscillation_recovery_min_duration:
            self.turning = 0

    def _is_swinging(self) -> bool:
        if 2 * len(self._speeds) < (self._speeds.maxlen or 0):
            return False
        speeds = np.array(self._speeds)
        mean_v, mean_w = np.abs(speeds.mean(axis=0))
        changes = np.count_nonzero(np.diff(np.sign(speeds[:, 1])))
        return bool(
            mean_v < self._rules.oscillation_v_eps and mean_w < self._rules.oscillation_omega_eps and changes > 1
        )


class HorizonBackup:
    """Shortens the local plan after bands that could not be driven."""

    def __init__(self, parameters: TebParameters) -> None:
        self._rules = parameters.recovery
        self.clear()

    def clear(self) -> None:
        """Forget what was."""
        self._failures = 0
        self._failed_s = -np.inf

    def observe(self, *, feasible: bool, time_s: float) -> None:
        """Take whether the band of this cycle could be driven."""
        self._failures = 0 if feasible else self._failures + 1
        if not feasible:
            self._failed_s = time_s

    def shortened(self, path: Array, *, reaches_goal: bool, time_s: float) -> Array:
        """Return the local plan, half of it after bands failed (three quarters after many); all where it ends at the goal."""
        recent = time_s - self._failed_s < self._rules.shrink_horizon_min_duration
        if not self._rules.shrink_horizon_backup or reaches_goal or not (self._failures or recent):
            return path
        share = 4 if self._failures > _MANY_FAILURES else 2
        return path[: max(2, len(path) - len(path) // share)]
