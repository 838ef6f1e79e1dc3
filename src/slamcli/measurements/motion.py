# SPDX-License-Identifier: MIT
"""Poses, velocities and transforms that a recording holds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.geometry import quaternion


def check_pose(what: str, stamp_ns: int, position: NDArray[np.float64], quat_xyzw: NDArray[np.float64]) -> None:
    """Refuse a pose of wrong shape, that is not finite, or that lies beyond 1e15 m.

    Raises
    ------
    DataError
        Naming `what` and when.
    """
    if position.shape != (3,) or quat_xyzw.shape != (4,):
        raise DataError(
            f"{what} at {stamp_ns} ns: position {position.shape}, orientation {quat_xyzw.shape}, not (3,) and (4,)"
        )
    if not (np.isfinite(position).all() and np.isfinite(quat_xyzw).all()):
        raise DataError(f"{what} at {stamp_ns} ns: pose is not finite")
    if np.abs(position).max() > 1e15:
        raise DataError(f"{what} at {stamp_ns} ns: position is farther away than 1e15 m")


def _zeros() -> NDArray[np.float64]:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedPose:
    """Pose of `child_frame_id` in `frame_id` at one time (PoseStamped, PoseWithCovarianceStamped, one pose of a Path)."""

    stamp_ns: int
    frame_id: str
    position_m: NDArray[np.float64]
    """float64 (3,), metres."""
    quat_xyzw: NDArray[np.float64]
    """float64 (4,)."""
    child_frame_id: str = ""
    covariance: NDArray[np.float64] | None = None
    """float64 (6, 6), x, y, z in metres then rotations about x, y, z in radians, or None."""
    topic: str = ""

    def __post_init__(self) -> None:
        check_pose("pose", self.stamp_ns, self.position_m, self.quat_xyzw)

    @property
    def pose_se2(self) -> NDArray[np.float64]:
        """float64 (3,), the planar part x, y, yaw."""
        return np.array([self.position_m[0], self.position_m[1], float(quaternion.yaw(self.quat_xyzw))])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry(StampedPose):
    """What the wheels (or another dead reckoning) say: pose in `frame_id`, velocity in `child_frame_id`."""

    linear_m_s: NDArray[np.float64] = field(default_factory=_zeros)
    """float64 (3,), metres per second in the child frame."""
    angular_rad_s: NDArray[np.float64] = field(default_factory=_zeros)
    """float64 (3,), radians per second in the child frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedTwist:
    """A velocity (Twist or TwistStamped): commanded or measured."""

    stamp_ns: int
    frame_id: str
    linear_m_s: NDArray[np.float64]
    """float64 (3,)."""
    angular_rad_s: NDArray[np.float64]
    """float64 (3,)."""
    topic: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameTransform:
    """One edge of the frame tree at one time: ``T_parent_child``; static ones hold for all times."""

    stamp_ns: int
    parent_frame_id: str
    child_frame_id: str
    position_m: NDArray[np.float64]
    """float64 (3,), metres."""
    quat_xyzw: NDArray[np.float64]
    """float64 (4,)."""
    static: bool = False
    topic: str = ""

    def __post_init__(self) -> None:
        check_pose(
            f"transform {self.parent_frame_id} -> {self.child_frame_id}", self.stamp_ns, self.position_m, self.quat_xyzw
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionStart:
    """A recording ends and another begins: the robot may be elsewhere, and odometry begins anew."""

    stamp_ns: int
    """Of the first measurement that follows; it may lie before those of the recording before."""
    source: str = ""
    """Name of the recording that begins, for messages."""
