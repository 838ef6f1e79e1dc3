# SPDX-License-Identifier: MIT
"""Odometry of clouds in space for images that are taken between them."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.measurements import PointCloud
from slamcli.rtabmap.cloud_odometry import CloudOdometry
from slamcli.rtabmap.given_odometry import GivenOdometry
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]


class SweptOdometry:
    """Aligns each cloud as it comes, and tells poses at any stamp between two clouds.

    Parameters
    ----------
    clouds
        What aligns them.
    wheels
        The recording's odometry, which guides that; may be empty.
    """

    def __init__(self, clouds: CloudOdometry, wheels: GivenOdometry, no_return: str) -> None:
        self._clouds, self._wheels, self._no_return = clouds, wheels, no_return
        self._poses = GivenOdometry()
        self._stamps: list[int] = []
        self._sums: list[Floats] = []
        """Covariances of all motions up to each cloud, added up."""
        self._resets: list[int] = []
        self._last_cloud_ns: int | None = None
        self._last: tuple[int, Floats] | None = None
        """Stamp and sum of the last frame that had a pose."""

    @property
    def num_lost(self) -> int:
        """Clouds without a pose so far."""
        return self._clouds.num_lost

    def take(self, cloud: PointCloud, T_base_sensor: Floats) -> NodeScan:
        """Align the next cloud; return it freed of the motion while it was measured."""
        motion = None
        if self._last_cloud_ns is not None:
            then, now = self._wheels.at(self._last_cloud_ns), self._wheels.at(cloud.stamp_ns)
            motion = None if then is None or now is None else se3.inverse(then) @ now
        step, scan = self._clouds.step(cloud, T_base_sensor, motion, self._no_return)
        self._last_cloud_ns = cloud.stamp_ns
        if step.T_odom_base is not None and self._poses.add_pose(step.stamp_ns, step.T_odom_base):
            before = self._sums[-1] if self._sums else np.zeros((6, 6))
            self._stamps.append(step.stamp_ns)
            self._sums.append(before + step.covariance)
            if step.began_anew:
                self._resets.append(step.stamp_ns)
        return scan

    def covers(self, stamp_ns: int) -> bool:
        """Return whether a cloud at or after a stamp has been placed."""
        return self._poses.covers(stamp_ns)

    def at(self, stamp_ns: int) -> Floats | None:
        """Return the pose T_odom_base (4, 4) at a stamp; None where no clouds near by have one."""
        return self._poses.at(stamp_ns)

    def step(self, stamp_ns: int) -> OdometryStep:
        """Return where the robot was at the stamp of the next frame; without a pose where no clouds near by have one."""
        pose = self._poses.at(stamp_ns)
        if pose is None:
            return OdometryStep(stamp_ns=stamp_ns, T_odom_base=None, covariance=np.zeros((6, 6)))
        total = self._sum_at(stamp_ns)
        last_ns, before = (stamp_ns, total) if self._last is None else self._last
        self._last = (stamp_ns, total)
        anew = any(last_ns < reset <= stamp_ns for reset in self._resets)
        return OdometryStep(
            stamp_ns=stamp_ns, T_odom_base=pose, covariance=total - before if stamp_ns >= last_ns else np.zeros((6, 6)),
            began_anew=anew,
        )  # fmt: skip

    def _sum_at(self, stamp_ns: int) -> Floats:
        after = bisect_right(self._stamps, stamp_ns)
        if after in (0, len(self._stamps)):
            return self._sums[0 if after == 0 else -1]
        first, last = self._stamps[after - 1], self._stamps[after]
        share = (stamp_ns - first) / (last - first)
        return (1.0 - share) * self._sums[after - 1] + share * self._sums[after]
