# SPDX-License-Identifier: MIT
"""Orientation from gyroscope and accelerometer by gradient descent (Madgwick, 2010, section 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.trajectory.attitude import level_rotation

_LONGEST_STEP_S = 0.5
"""After a longer gap the orientation is that of the accelerometer again."""

Quaternion = tuple[float, float, float, float]


class MadgwickFilter:
    """Orientation of an IMU in a frame whose z is up; the heading is what the gyroscope makes of it.

    Parameters
    ----------
    gain
        How strongly the accelerometer corrects, rad/s (beta of the paper).
    drift
        How fast the gyroscope's bias is learnt, rad/s^2 (zeta of the paper); 0: not at all.

    References
    ----------
    Madgwick, "An efficient orientation filter for inertial and inertial/magnetic sensor arrays", 2010.
    """

    def __init__(self, gain: float, drift: float = 0.0) -> None:
        self._gain, self._drift = gain, drift
        self._stamp_ns: int | None = None
        self._quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
        """Scalar first, as in the paper: of the frame with z up in the IMU's."""
        self._bias = [0.0, 0.0, 0.0]

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """Return the orientation of the IMU in the level frame, float64 (4,)."""
        w, x, y, z = self._quat
        return np.array([x, y, z, w])

    def step(self, stamp_ns: int, rates: Sequence[float], forces: Sequence[float]) -> None:
        """Take a sample: angular velocity (3,), rad/s, and specific force (3,), m/s^2; stamps increase."""
        size = math.sqrt(forces[0] ** 2 + forces[1] ** 2 + forces[2] ** 2)
        elapsed = math.inf if self._stamp_ns is None else (stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = stamp_ns
        if not 0.0 < elapsed <= _LONGEST_STEP_S:
            if elapsed > 0.0 and size > 0.0:
                x, y, z, w = level_rotation(np.array(forces) / size).tolist()
                self._quat = (w, x, y, z)
            return
        error = self._error(forces[0] / size, forces[1] / size, forces[2] / size) if size > 0.0 else (0.0,) * 4
        turn = self._turn(error, rates, elapsed)
        # eq. 44: half the turn by the gyroscope, less the step down the gradient
        moved = [q + elapsed * (t - self._gain * e) for q, t, e in zip(self._quat, turn, error, strict=True)]
        norm = math.sqrt(sum(q * q for q in moved))
        self._quat = (moved[0] / norm, moved[1] / norm, moved[2] / norm, moved[3] / norm)

    def _turn(self, error: Sequence[float], rates: Sequence[float], elapsed: float) -> Quaternion:
        """Return the derivative of the orientation by the gyroscope without its bias (eq. 12, 47 to 49)."""
        w, x, y, z = self._quat
        if self._drift > 0.0:
            a, b, c, d = error
            learnt = (
                2.0 * (w * b - x * a - y * d + z * c),
                2.0 * (w * c + x * d - y * a - z * b),
                2.0 * (w * d - x * c + y * b - z * a),
            )
            for axis in range(3):
                self._bias[axis] += self._drift * elapsed * learnt[axis]
        p, q, r = rates[0] - self._bias[0], rates[1] - self._bias[1], rates[2] - self._bias[2]
        return (
            0.5 * (-x * p - y * q - z * r),
            0.5 * (w * p + y * r - z * q),
            0.5 * (w * q - x * r + z * p),
            0.5 * (w * r + x * q - y * p),
        )

    def _error(self, x: float, y: float, z: float) -> Quaternion:
        """Return the direction of the gradient of the accelerometer's error, a unit quaternion or zeros (eq. 25, 26, 34)."""
        a, b, c, d = self._quat
        f = (2.0 * (b * d - a * c) - x, 2.0 * (a * b + c * d) - y, 1.0 - 2.0 * (b * b + c * c) - z)
        gradient = (
            -2.0 * c * f[0] + 2.0 * b * f[1],
            2.0 * d * f[0] + 2.0 * a * f[1] - 4.0 * b * f[2],
            -2.0 * a * f[0] + 2.0 * d * f[1] - 4.0 * c * f[2],
            2.0 * b * f[0] + 2.0 * c * f[1],
        )
        norm = math.sqrt(sum(g * g for g in gradient))
        if norm < 1e-12:
            return (0.0, 0.0, 0.0, 0.0)
        return (gradient[0] / norm, gradient[1] / norm, gradient[2] / norm, gradient[3] / norm)
