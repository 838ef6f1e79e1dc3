# SPDX-License-Identifier: MIT
"""How fast the robot moves, and whether its odometry jumps: what forbids a node, or begins a new map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.node_rate import motion_size
from slamcli.rtabmap.parameters import RgbdGroup

Floats = NDArray[np.float64]
_MAX_GAIN_M_S = 10.0
"""Nothing that drives or is carried gains so much speed between two frames."""
_LEAST_JUMP_M = 1.0


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
        self._speed = math.inf
        """Of the last step, metres a second."""
        self._jumps: list[tuple[int, float]] = []
        """Stamps of steps that no robot makes, and their lengths, metres."""

    @property
    def jumps(self) -> str:
        """Steps that no robot makes, in words; empty where there are none."""
        if not self._jumps:
            return ""
        stamp_ns, way = self._jumps[0]
        return (
            f"the odometry jumps {len(self._jumps)} times, first by {way:.1f} m at {stamp_ns / 1e9:.3f} s, and the map with it "
            "(RGBD/NewMapOdomChangeDistance begins a new map there; slamcli.odometry says where the motion is from)"
        )

    def begins_anew(self, step: OdometryStep) -> bool:
        """Take the next frame; return whether odometry jumped so far that a new map begins."""
        before, self._last = self._last, step.T_odom_base
        seconds = (step.stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = step.stamp_ns
        self.too_fast = False
        if before is None or step.T_odom_base is None or step.began_anew:
            self._speed = math.inf
            return False
        way, turn = motion_size(se3.inverse(before) @ step.T_odom_base)
        limits = self._settings
        if seconds > 0.0:
            self.too_fast = (0.0 < limits.linear_speed_update < way / seconds) or (
                0.0 < limits.angular_speed_update < turn / seconds
            )
        speed = way / max(seconds, 1e-3)
        if way > _LEAST_JUMP_M and speed > self._speed + _MAX_GAIN_M_S:
            self._jumps.append((step.stamp_ns, way))
        self._speed = speed
        return 0.0 < limits.new_map_odom_change_distance < way
