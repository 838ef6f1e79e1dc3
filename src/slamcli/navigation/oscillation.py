# SPDX-License-Identifier: MIT
"""Which directions of motion are ruled out because the robot turned back and forth without getting anywhere."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2


class Oscillation:
    """Flags of base_local_planner's ``OscillationCostFunction``.

    A change of sense, forward and backward, left and right, or turning left and right, rules out the former sense until
    the robot has moved `reset_m` or turned `reset_rad`. Sideways and turning motions count only where the forward speed
    is at most min_vel_trans.
    """

    def __init__(self, reset_m: float, reset_rad: float) -> None:
        self._reset_m = reset_m
        self._reset_rad = reset_rad
        self.reset()

    def reset(self) -> None:
        """Allow every direction."""
        self.forbidden = 0
        self._sense = [0, 0, 0]
        self._anchor = np.zeros(3)

    def update(self, pose: NDArray[np.float64], command: NDArray[np.float64], min_vel_trans: float) -> None:
        """Take note of a command (3,), and of where it was given, pose (3,).

        `forbidden` then has bit 2 k for positive and bit 2 k + 1 for negative speeds of axis k: x, y, turn.
        """
        axes = range(3) if abs(command[0]) <= min_vel_trans else range(1)
        turned = False
        for k in axes:
            sense = int(np.sign(command[k]))
            if sense and self._sense[k] == -sense:
                self.forbidden |= (2 if sense > 0 else 1) << (2 * k)
                turned = True
            self._sense[k] = sense or self._sense[k]
        if turned:
            self._anchor = np.array(pose)
        if self.forbidden:
            moved = math.hypot(pose[0] - self._anchor[0], pose[1] - self._anchor[1])
            swung = abs(float(se2.wrap_angle(pose[2] - self._anchor[2])))
            if moved > self._reset_m or swung > self._reset_rad:
                self.reset()
