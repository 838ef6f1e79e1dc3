# SPDX-License-Identifier: MIT
"""Which way is up at a node, from an IMU."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.trajectory.madgwick import MadgwickFilter

Floats = NDArray[np.float64]

_FARTHEST_NS = 50_000_000
"""A sample farther in time from a node says nothing about it."""
_KEPT_NS = 20_000_000_000
"""How long samples wait for the images and scans of their time."""
_MEAN_FORCE_M_S2 = (7.0, 13.0)
"""Mean size of what can be gravity."""


class GravityTrack:
    """Orientation of the base in a level frame over time: the device's own where it gives one, else by the Madgwick filter.

    Parameters
    ----------
    parameters
        ``ImuFilter/*`` and ``Mem/UseOdomGravity`` are read.
    T_base_sensor
        Mount of each sensor by topic, float64 (4, 4).
    """

    def __init__(self, parameters: RtabmapParameters, T_base_sensor: Mapping[str, Floats]) -> None:
        settings = parameters.imu_filter
        self._filter = MadgwickFilter(settings.madgwick_gain, settings.madgwick_zeta)
        self._mounts = T_base_sensor
        self._stamps: deque[int] = deque()
        self._levels: deque[Floats] = deque()
        self._force_sum, self._num_samples = 0.0, 0
        self._by_odometry = parameters.mem.use_odom_gravity

    def add(self, sample: ImuSample) -> None:
        """Take the next sample; one that is not later than the last is left out."""
        if self._stamps and sample.stamp_ns <= self._stamps[-1]:
            return
        quat = sample.quat_xyzw
        if quat is None:
            self._filter.step(sample.stamp_ns, sample.angular_rad_s.tolist(), sample.acceleration_m_s2.tolist())
            quat = self._filter.quat_xyzw
            self._force_sum += float(np.linalg.norm(sample.acceleration_m_s2))
            self._num_samples += 1
        mount = self._mounts.get(sample.topic)
        R_level_base = quaternion.to_matrix(quat) if mount is None else quaternion.to_matrix(quat) @ mount[:3, :3].T
        self._stamps.append(sample.stamp_ns)
        self._levels.append(R_level_base)
        while self._stamps[-1] - self._stamps[0] > _KEPT_NS:
            self._stamps.popleft()
            self._levels.popleft()

    def at(self, stamp_ns: int, T_odom_base: Floats) -> Floats | None:
        """Return the rotation (3, 3) of the base in a level frame at a stamp; its heading means nothing.

        With ``Mem/UseOdomGravity`` that of the odometry's pose T_odom_base (4, 4), whose z is up then. None where no sample
        is near, or what was felt is no gravity.
        """
        if self._by_odometry:
            return T_odom_base[:3, :3]
        low, high = _MEAN_FORCE_M_S2
        if not self._stamps or (self._num_samples and not low < self._force_sum / self._num_samples < high):
            return None
        after = bisect_left(self._stamps, stamp_ns)
        near = [k for k in (after - 1, after) if 0 <= k < len(self._stamps)]
        nearest = min(near, key=lambda k: abs(self._stamps[k] - stamp_ns))
        if abs(self._stamps[nearest] - stamp_ns) > _FARTHEST_NS:
            return None
        return self._levels[nearest]


def gravity_track(parameters: RtabmapParameters, setup: Setup) -> GravityTrack | None:
    """Return what takes an IMU's samples; None where gravity does not count (Optimizer/GravitySigma 0, Reg/Force3DoF)."""
    if parameters.optimizer.gravity_sigma <= 0.0 or parameters.reg.force_3dof:
        return None
    return GravityTrack(parameters, setup.T_base_sensor)


def gravity_link(node_id: int, R_level_base: Floats) -> Link:
    """Return the link that tells which way is up at a node; Optimizer/GravitySigma says how surely."""
    T = np.eye(4)
    T[:3, :3] = R_level_base
    return Link(from_id=node_id, to_id=node_id, kind=LinkKind.GRAVITY, T_from_to=T, information=np.eye(6))
