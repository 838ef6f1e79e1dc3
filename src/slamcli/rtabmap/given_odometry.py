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

LONGEST_GAP_NS = 1_000_000_000
"""Odometry that is silent for longer says nothing of what happened in between: a straight line would be made up."""
_STANDS_NS = 100_000_000
"""So long before and after a sample beside which there is no other the robot counts as standing there."""
_METRES = (0.0005, 0.03, 0.01)
"""Standard deviation of a motion's translation: metres, per root of a metre of way, per root of a radian of turn."""
_RADIANS = (0.0002, 0.02, 0.04)
"""The same of its rotation, radians."""
_OUT_OF_PLANE = (0.01, 0.01)
"""What wheels do not measure (z; roll and pitch) adds to them, per root of a metre of way."""


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
        self.add_pose(
            sample.stamp_ns, se3.from_position_quaternion(sample.position_m, quaternion.normalise(sample.quat_xyzw))
        )

    def add_pose(self, stamp_ns: int, pose: Floats) -> bool:
        """Take the next pose T_odom_base (4, 4); return False for one that is left out."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            return False
        self._stamps.append(stamp_ns)
        self._poses.append(se3.from_se2(se3.to_se2(pose)) if self._planar else pose)
        return True

    def covers(self, stamp_ns: int) -> bool:
        """Return whether there is a sample at or after a stamp."""
        return bool(self._stamps) and self._stamps[-1] >= stamp_ns

    def at(self, stamp_ns: int) -> Floats | None:
        """Return the pose T_odom_base (4, 4) at a stamp; None before the first sample, after the last, and in a long gap.

        A tenth of a second before the first and after the last sample, and at both ends of a gap, counts as standing there.
        """
        if not self._stamps:
            return None
        if stamp_ns <= self._stamps[0] or stamp_ns >= self._stamps[-1]:
            end = 0 if stamp_ns <= self._stamps[0] else -1
            return self._poses[end] if abs(stamp_ns - self._stamps[end]) <= _STANDS_NS else None
        after = bisect_right(self._stamps, stamp_ns)
        first, last = self._stamps[after - 1], self._stamps[after]
        if stamp_ns == first:  # the sample itself, to the bit, however much later it is asked for
            return self._poses[after - 1]
        if last - first > LONGEST_GAP_NS:
            if stamp_ns - first <= _STANDS_NS:
                return self._poses[after - 1]
            return self._poses[after] if last - stamp_ns <= _STANDS_NS else None
        share = (stamp_ns - first) / (last - first)
        a, b = self._poses[after - 1], self._poses[after]
        position, quats = se3.to_position_quaternion(np.array([a, b]))
        turned = quaternion.slerp(quats[0], quats[1], share)
        return se3.from_position_quaternion(position[0] + share * (position[1] - position[0]), turned)


def motion_covariance(T_before_after: Floats) -> Floats:
    """Return the covariance (6, 6) of a motion that wheels measured: translation, then rotation vector.

    Their errors are a random walk (variance grows with way and turn), so that motions in small steps are as sure as in large ones.
    """
    turn = math.acos(min(1.0, max(-1.0, (float(np.trace(T_before_after[:3, :3])) - 1.0) / 2.0)))
    way = float(np.linalg.norm(T_before_after[:3, 3]))
    metres = _METRES[0] ** 2 + _METRES[1] ** 2 * way + _METRES[2] ** 2 * turn
    radians = _RADIANS[0] ** 2 + _RADIANS[1] ** 2 * way + _RADIANS[2] ** 2 * turn
    z = metres + _OUT_OF_PLANE[0] ** 2 * way
    tilt = radians + _OUT_OF_PLANE[1] ** 2 * way
    return np.diag([metres, metres, z, tilt, tilt, radians])
