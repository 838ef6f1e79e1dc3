# SPDX-License-Identifier: MIT
"""Which frames become nodes: by the time since the last one, and by how far the robot has moved."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3

Floats = NDArray[np.float64]


class NodeRate:
    """Lets frames through at Rtabmap/DetectionRate, by their stamps (0: all of them)."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz) if rate_hz > 0.0 else 0
        self._next_ns: int | None = None

    def due(self, stamp_ns: int) -> bool:
        """Return whether a frame is to be handed to the memory; the clock starts anew where stamps run back."""
        if self._next_ns is None or stamp_ns >= self._next_ns or stamp_ns < self._next_ns - 2 * self._period_ns:
            late = 0 if self._next_ns is None else stamp_ns - self._next_ns
            # a frame that comes late must not slow the rate down
            self._next_ns = stamp_ns + self._period_ns - (late if 0 <= late < self._period_ns // 2 else 0)
            return True
        return False


def has_moved(T_last_now: Floats, linear_m: float, angular_rad: float) -> bool:
    """Return whether a motion exceeds RGBD/LinearUpdate or RGBD/AngularUpdate; with both 0 every motion does."""
    if linear_m <= 0.0 and angular_rad <= 0.0:
        return True
    way, turn = motion_size(T_last_now)
    return (linear_m > 0.0 and way >= linear_m) or (angular_rad > 0.0 and turn >= angular_rad)


def motion_size(T_a_b: Floats) -> tuple[float, float]:
    """Return length (m) and angle (rad) of a motion."""
    turn = math.acos(min(1.0, max(-1.0, (float(np.trace(T_a_b[:3, :3])) - 1.0) / 2.0)))
    return float(np.linalg.norm(T_a_b[:3, 3])), turn


def flattened(T_a_b: Floats) -> Floats:
    """Return a pose without height, roll and pitch (Reg/Force3DoF)."""
    return se3.from_se2(se3.to_se2(T_a_b))
