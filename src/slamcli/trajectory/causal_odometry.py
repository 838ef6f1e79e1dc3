# SPDX-License-Identifier: MIT
"""What wheels say while the robot drives: nothing that comes later is known."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.measurements import Odometry

_KEPT = 256
"""Messages that are kept: two seconds of a fast source, and a scan is not older than that."""
_LONGEST_AHEAD_S = 0.2
"""So far the motion goes on beyond the newest message; then the robot is taken to stand."""
_LEAST_SPAN_S = 0.04
"""Velocities are taken over at least this long, so that jitter of stamps does not count."""
_STEP_NS = 1000


class CausalOdometry:
    """Poses and velocities of the base in the odometry frame, from the messages that have come so far."""

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=_KEPT)
        self._poses: deque[NDArray[np.float64]] = deque(maxlen=_KEPT)

    @property
    def is_known(self) -> bool:
        """Whether a message has come."""
        return bool(self._stamps)

    def add(self, odometry: Odometry) -> None:
        """Take the next message; a stamp that runs backwards counts as just after the one before."""
        stamp = odometry.stamp_ns
        if self._stamps and stamp <= self._stamps[-1]:
            stamp = self._stamps[-1] + _STEP_NS
        self._stamps.append(stamp)
        self._poses.append(odometry.pose_se2)

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """Return the pose (3,) at a time: between two messages, or led on by the newest velocity; zero without any message."""
        if not self._stamps:
            return np.zeros(3)
        if stamp_ns >= self._stamps[-1]:
            ahead_s = (stamp_ns - self._stamps[-1]) / 1e9
            if ahead_s == 0.0 or ahead_s > _LONGEST_AHEAD_S:
                return self._poses[-1]
            return np.asarray(se2.compose(self._poses[-1], ahead_s * self.twist()))
        if stamp_ns <= self._stamps[0]:
            return self._poses[0]
        k = len(self._stamps) - 1
        while self._stamps[k - 1] > stamp_ns:
            k -= 1
        share = (stamp_ns - self._stamps[k - 1]) / (self._stamps[k] - self._stamps[k - 1])
        pose = self._poses[k - 1] + share * (self._poses[k] - self._poses[k - 1])
        turn = math.remainder(float(self._poses[k][2] - self._poses[k - 1][2]), math.tau)
        pose[2] = math.remainder(float(self._poses[k - 1][2]) + share * turn, math.tau)
        return pose

    def twist(self) -> NDArray[np.float64]:
        """Return the newest velocity (3,), metres and radians per second in the base frame; zero where none is known."""
        k = len(self._stamps) - 1
        first = k - 1
        while first > 0 and (self._stamps[k] - self._stamps[first]) / 1e9 < _LEAST_SPAN_S:
            first -= 1
        if first < 0:
            return np.zeros(3)
        seconds = (self._stamps[k] - self._stamps[first]) / 1e9
        if seconds < 1e-3 or seconds > 1.0:
            return np.zeros(3)
        return np.asarray(se2.between(self._poses[first], self._poses[k])) / seconds
