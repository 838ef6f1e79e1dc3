# SPDX-License-Identifier: MIT
"""What inertial alignment takes and gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualPoses:
    """N poses of a camera that carries an IMU, in a map whose metre may be of any length."""

    stamps_ns: Integers
    """int64 (N,), increasing."""
    rotations: Floats
    """float64 (N, 3, 3), from the camera's frame to the map."""
    positions: Floats
    """float64 (N, 3), of the camera, in units of the map."""
    T_camera_imu: Floats
    """float64 (4, 4), metres."""

    def lever(self) -> tuple[Floats, Floats]:
        """Return rotations (N, 3, 3) of the IMU and the vector (3,) from camera to IMU in the IMU's frame."""
        turn = self.T_camera_imu[:3, :3]
        return self.rotations @ turn, turn.T @ self.T_camera_imu[:3, 3]


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentSettings:
    """What is known beforehand."""

    fixed_scale: bool = False
    """Whether units of the map are metres (stereo, RGB-D)."""
    gravity_m_s2: float = 9.80665
    gyroscope_bias_sigma: float = 0.1
    """rad/s, of the prior around zero; the paper's information of 1e2."""
    accelerometer_bias_sigma: float = 0.2
    """m/s^2; the paper holds it at zero at first, which costs 5 % of scale where the bias is 0.1 m/s^2."""
    rotation_sigma_rad: float = 1e-3
    """Of the cameras' poses."""
    position_sigma: float = 5e-3
    """Of the cameras' poses, in units of the map."""
    iterations: int = 25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InertialAlignment:
    """What makes poses of a camera fit an IMU."""

    scale: float
    """Metres per unit of the map."""
    gravity_map: Floats
    """float64 (3,), m/s^2, pointing down."""
    biases: Floats
    """float64 (6,), gyroscope and accelerometer."""
    velocities: Floats
    """float64 (N, 3), m/s in the map's axes, of the IMU."""
    log_scale_sigma: float
    """Standard deviation of the scale's logarithm (its relative error); 0 where it was known."""
    gravity_sigma_rad: float
    biases_sigma: Floats
    """float64 (6,)."""
    excitation_m_s2: float
    """Root mean square of the accelerations around their mean."""
    mean_square: float
    """Mean square of whitened residuals: 1 where noise is as assumed; the deviations above grow with it beyond 1."""
    converged: bool
