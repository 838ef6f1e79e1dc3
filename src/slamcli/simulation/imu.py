# SPDX-License-Identifier: MIT
"""The inertial measurement unit: turn rate and specific force with bias and noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation.drive import TICK_S, Motion
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.ride import Ride

Array = NDArray[np.float64]

FRAME = "imu"
TOPIC = "/imu"
GRAVITY_M_S2 = 9.80665


def inertial(
    ride: Ride, times_s: Array, parameters: SimulationParameters, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return angular velocity and specific force, each (N, 3), in the IMU's frame (axes as base_link's).

    The force at rest on level ground is +9.80665 m/s^2 up (REP 145). Biases are drawn once; white noise has the deviation
    density * sqrt(rate); the biases' random walks begin at zero.
    """
    p = parameters
    angular, force = _planar(ride, times_s, p) if ride.is_level else _spatial(ride, times_s, p)
    biases = rng.standard_normal(6)
    noise = rng.standard_normal((len(times_s), 6)) * np.sqrt(p.imu_rate)
    angular = angular + biases[:3] * p.imu_gyro_bias + noise[:, :3] * p.imu_gyro_noise
    force = force + biases[3:] * p.imu_accel_bias + noise[:, 3:] * p.imu_accel_noise
    walks = np.cumsum(rng.standard_normal((len(times_s), 6)), axis=0) / np.sqrt(p.imu_rate)
    return angular + walks[:, :3] * p.imu_gyro_walk, force + walks[:, 3:] * p.imu_accel_walk


def _planar(ride: Ride, times_s: Array, parameters: SimulationParameters) -> tuple[Array, Array]:
    """Return what a perfect IMU on a level floor says, exact for the simulated speeds."""
    p, motion = parameters, ride.motion
    speed, turn = motion.speeds_at(times_s).T
    accelerations = np.gradient(motion.speeds, TICK_S, axis=0) if len(motion.speeds) > 1 else np.zeros((1, 2))
    forward, turning = Motion(motion.poses, accelerations).speeds_at(times_s).T
    angular = np.column_stack([np.zeros((len(turn), 2)), turn])
    force = np.column_stack(
        [
            forward - turning * p.imu_y - turn**2 * p.imu_x,
            speed * turn + turning * p.imu_x - turn**2 * p.imu_y,
            np.full(len(turn), GRAVITY_M_S2),
        ]
    )
    return angular, force


def _spatial(ride: Ride, times_s: Array, parameters: SimulationParameters) -> tuple[Array, Array]:
    """Return what a perfect IMU says on ground that rises and falls."""
    lever = np.array([parameters.imu_x, parameters.imu_y, parameters.imu_z])
    angular, force = ride.rates(times_s)
    turning = (ride.rates(times_s + TICK_S)[0] - ride.rates(times_s - TICK_S)[0]) / (2 * TICK_S)
    force = force + np.cross(turning, lever) + np.cross(angular, np.cross(angular, lever))
    up = ride.at(times_s)[1][:, 2]  # the map's upward direction in base_link
    return angular, force + GRAVITY_M_S2 * up
