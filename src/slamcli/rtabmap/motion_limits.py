# SPDX-License-Identifier: MIT
"""How fast the robot moves, and whether its odometry jumps: what forbids a node, or begins a new map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.node_rate import motion_size
from slamcli.rtabmap.parameters import RgbdGroup

Floats = NDArray[np.float64]


class MotionLimits:
    """Watches odometry frame by frame.

    Parameters
    ----------
    settings
        ``RGBD/LinearSpeedUpdate``, ``RGBD/AngularSpeedUpdate`` and ``RGBD/NewMapOdomChangeDistance`` are read.
    """

    def __init__(self, settings: RgbdGroup) -> None:
        self._settings = settings
        self._stamp_ns = 0
        self._last: Floats | None = None
        self.too_fast = False
        """Whether no node is made of the last frame, as the robot moved faster than allowed."""

    def begins_anew(self, step: OdometryStep) -> bool:
        """Take the next frame; return whether odometry jumped so far that a new map begins."""
        before, self._last = self._last, step.T_odom_base
        seconds = (step.stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = step.stamp_ns
        self.too_fast = False
        if before is None or step.T_odom_base is None or step.began_anew:
            return False
        way, turn = motion_size(se3.inverse(before) @ step.T_odom_base)
        limits = self._settings
        if seconds > 0.0:
            self.too_fast = (0.0 < limits.linear_speed_update < way / seconds) or (
                0.0 < limits.angular_speed_update < turn / seconds
            )
        return 0.0 < limits.new_map_odom_change_distance < way
