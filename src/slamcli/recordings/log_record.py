# SPDX-License-Identifier: MIT
"""What readers of classic logs give: measurements with a topic and a time that keeps the file's order."""

from __future__ import annotations

import math
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import FrameTransform, LaserScan, Odometry
from slamcli.runtime import RunLog


class LogRecord(NamedTuple):
    """One measurement of a classic log."""

    topic: str
    measurement: LaserScan | Odometry | FrameTransform
    log_time_ns: int
    """Strictly increasing in the order of the file, whatever the log's own stamps do."""


class LogClock:
    """Log times out of stamps: the stamp itself, or just after the record before where stamps run backwards."""

    def __init__(self) -> None:
        self._last_ns = -1
        self._last_stamps: dict[str, int] = {}
        self.num_backwards: Counter[str] = Counter()
        """Stamps that are earlier than the one before on the same topic, by topic."""
        self.largest_step_back_ns = 0

    def tick(self, topic: str, stamp_ns: int) -> int:
        """Return the log time of the next record."""
        step_back = self._last_stamps.get(topic, stamp_ns) - stamp_ns
        if step_back > 0:
            self.num_backwards[topic] += 1
            self.largest_step_back_ns = max(self.largest_step_back_ns, step_back)
        self._last_stamps[topic] = stamp_ns
        self._last_ns = max(self._last_ns + 1, stamp_ns)
        return self._last_ns

    def record(self, topic: str, measurement: LaserScan | Odometry | FrameTransform) -> LogRecord:
        """Return the next record."""
        return LogRecord(topic, measurement, self.tick(topic, measurement.stamp_ns))

    def tell(self, name: str, log: RunLog) -> None:
        """Warn of stamps that run backwards."""
        if self.num_backwards:
            where = ", ".join(f"{count} on {topic}" for topic, count in sorted(self.num_backwards.items()))
            log.warn(
                f"{name}: stamps run backwards: {where}, by up to {self.largest_step_back_ns / 1e9:.3f} s; "
                "stamps and order are kept as they are"
            )


def planar_transform(
    stamp_ns: int, parent: str, child: str, x_m: float, y_m: float, yaw_rad: float, *, static: bool = False
) -> FrameTransform:
    """Return ``T_parent_child`` of a planar pose."""
    return FrameTransform(
        stamp_ns=stamp_ns,
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=np.array([x_m, y_m, 0.0]),
        quat_xyzw=_quaternion(yaw_rad),
        static=static,
    )


def planar_odometry(
    stamp_ns: int,
    frame: str,
    pose: tuple[float, float, float],
    velocity: tuple[float, float] = (0.0, 0.0),
    child: str = "base_link",
) -> Odometry:
    """Return odometry of a planar pose (x, y in metres, yaw in radians) with forward and turning velocity."""
    return Odometry(
        stamp_ns=stamp_ns,
        frame_id=frame,
        child_frame_id=child,
        position_m=np.array([pose[0], pose[1], 0.0]),
        quat_xyzw=_quaternion(pose[2]),
        linear_m_s=np.array([velocity[0], 0.0, 0.0]),
        angular_rad_s=np.array([0.0, 0.0, velocity[1]]),
    )


def _quaternion(yaw_rad: float) -> NDArray[np.float64]:
    """Return the quaternion of a turn about z, float64 (4,); one at a time this is faster than `quaternion.from_yaw`."""
    return np.array([0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)])
