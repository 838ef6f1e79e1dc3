# SPDX-License-Identifier: MIT
"""Heading and tilt of a robot that an IMU tells: gyroscope, and gravity in the long run (Hess et al., ICRA 2016, IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.trajectory import _attitude_kernels as kernels
from slamcli.trajectory.wheel_odometry import smooth_stamps

GRAVITY_RANGE_M_S2 = (7.0, 13.0)
"""Mean specific force that can be gravity; an IMU whose mean lies outside is used for turns only."""
_START_S = 1.0
_LONGEST_GAP_S = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """Orientation of the base in a frame whose z is up, at the samples of an IMU."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,), strictly increasing, N >= 1."""
    quats_xyzw: NDArray[np.float64]
    """float64 (N, 4)."""
    mean_force_m_s2: float
    """Mean size of the specific force."""
    num_gaps: int
    """How often more than half a second is missing."""

    @property
    def has_gravity(self) -> bool:
        """Whether the forces are those of gravity, so that tilt is known."""
        low, high = GRAVITY_RANGE_M_S2
        return low < self.mean_force_m_s2 < high

    def yaws(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return headings (M,), radians, not wrapped, at stamps (M,); before the first and after the last nothing turns."""
        base = self.stamps_ns[0]
        known = np.unwrap(quaternion.yaw(self.quats_xyzw))
        return np.interp((stamps_ns - base).astype(np.float64), (self.stamps_ns - base).astype(np.float64), known)

    def tilt(self, stamp_ns: int) -> NDArray[np.float64]:
        """Return the rotation (4,) without heading that takes the base at a stamp into a level frame."""
        k = int(np.clip(np.searchsorted(self.stamps_ns, stamp_ns), 0, len(self.stamps_ns) - 1))
        quat = self.quats_xyzw[k]
        return quaternion.multiply(quaternion.from_yaw(-quaternion.yaw(quat)), quat)


def track_attitude(
    stamps_ns: Sequence[int], rates: NDArray[np.float64], forces: NDArray[np.float64], time_constant_s: float
) -> Attitude:
    """Return the attitude that samples tell.

    Parameters
    ----------
    stamps_ns : int64 (N,), in recorded order, N >= 1.
    rates : float64 (N, 3), rad/s in the base frame.
    forces : float64 (N, 3), m/s^2 in the base frame, +9.8 up when at rest.
    time_constant_s : how slowly the direction of gravity follows the forces.
    """
    stamps = smooth_stamps(np.asarray(stamps_ns, dtype=np.int64))
    seconds = (stamps - stamps[0]) / 1e9
    mean_force = float(np.linalg.norm(forces, axis=1).mean())
    first = forces[seconds <= _START_S].mean(axis=0)
    low, high = GRAVITY_RANGE_M_S2
    size = float(np.linalg.norm(first))
    level = first / size if low < mean_force < high and size > 0.0 else np.zeros(3)
    quats = np.empty((len(stamps), 4))
    kernels.track(seconds, np.ascontiguousarray(rates), np.ascontiguousarray(forces), time_constant_s, level, quats)
    return Attitude(stamps, quats, mean_force, int((np.diff(seconds) > _LONGEST_GAP_S).sum()))


def level_rotation(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest rotation (4,), xyzw, that turns a unit vector (3,) to (0, 0, 1)."""
    turned = np.array([up[1], -up[0], 0.0, 1.0 + up[2]])
    size = float(np.linalg.norm(turned))
    # Upside down any axis in the plane will do.
    return turned / size if size > 1e-9 else np.array([1.0, 0.0, 0.0, 0.0])


def warm() -> None:
    """Compile the kernel of this module."""
    kernels.warm()
