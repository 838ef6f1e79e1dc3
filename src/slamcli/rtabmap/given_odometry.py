# SPDX-License-Identifier: MIT
"""Odometry that the recording holds, asked at any stamp."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.measurements import Odometry

Floats = NDArray[np.float64]

_LONGEST_GAP_NS = 1_000_000_000
"""Odometry that is silent for longer says nothing of what happened in between: a straight line would be made up."""
_METRES = (0.002, 0.03, 0.01)
"""Standard deviation of a motion's translation: metres, per metre of way, per radian of turn."""
_RADIANS = (0.001, 0.02, 0.03)
"""The same of its rotation, radians."""
_OUT_OF_PLANE = (0.01, 0.01)
"""Standard deviations, m and rad, of what wheels do not measure (z, roll, pitch)."""


class GivenOdometry:
    """A track of odometry poses that grows while the recording is read.

    Between two samples poses are interpolated. Samples whose stamp is not later than the last one are left out.
    """

    def __init__(self, *, planar: bool = False) -> None:
        self._planar = planar
        self._stamps: list[int] = []
        self._poses: list[Floats] = []

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._stamps)

    def add(self, sample: Odometry) -> None:
        """Take the next sample."""
        if not self._stamps or sample.stamp_ns > self._stamps[-1]:
            self._stamps.append(sample.stamp_ns)
            pose = se3.from_position_quaternion(sample.position_m, quaternion.normalise(sample.quat_xyzw))
            self._poses.append(se3.from_se2(se3.to_se2(pose)) if self._planar else pose)

    def covers(self, stamp_ns: int) -> bool:
        """Return whether there is a sample at or after a stamp."""
        return bool(self._stamps) and self._stamps[-1] >= stamp_ns

    def at(self, stamp_ns: int) -> Floats | None:
        """Return the pose T_odom_base (4, 4) at a stamp; None before the first sample, after the last, and in a long gap.

        A tenth of a second before the first and after the last sample counts as standing there.
        """
        if not self._stamps:
            return None
        if stamp_ns <= self._stamps[0] or stamp_ns >= self._stamps[-1]:
            end = 0 if stamp_ns <= self._stamps[0] else -1
            return self._poses[end] if abs(stamp_ns - self._stamps[end]) <= _LONGEST_GAP_NS // 10 else None
        after = bisect_right(self._stamps, stamp_ns)
        first, last = self._stamps[after - 1], self._stamps[after]
        if stamp_ns == first:  # the sample itself, to the bit, however much later it is asked for
            return self._poses[after - 1]
        if last - first > _LONGEST_GAP_NS:
            return None
        share = (stamp_ns - first) / (last - first)
        a, b = self._poses[after - 1], self._poses[after]
        position, quats = se3.to_position_quaternion(np.array([a, b]))
        turned = quaternion.slerp(quats[0], quats[1], share)
        return se3.from_position_quaternion(position[0] + share * (position[1] - position[0]), turned)


def motion_covariance(T_before_after: Floats) -> Floats:
    """Return the covariance (6, 6) of a motion that wheels measured: translation, then rotation vector."""
    turn = math.acos(min(1.0, max(-1.0, (float(np.trace(T_before_after[:3, :3])) - 1.0) / 2.0)))
    way = float(np.linalg.norm(T_before_after[:3, 3]))
    metres = _METRES[0] + _METRES[1] * way + _METRES[2] * turn
    radians = _RADIANS[0] + _RADIANS[1] * turn + _RADIANS[2] * way
    z = metres + _OUT_OF_PLANE[0] * way
    tilt = radians + _OUT_OF_PLANE[1] * way
    return np.diag(np.square([metres, metres, z, tilt, tilt, radians]))
