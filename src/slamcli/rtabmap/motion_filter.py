# SPDX-License-Identifier: MIT
"""Smoothing of the motion that odometry gives out, and motion of robots that cannot move sideways."""

from __future__ import annotations

import math

import numpy as np

from slamcli.geometry import se3
from slamcli.rtabmap.local_map import Floats
from slamcli.rtabmap.odometry_settings import Filtering, OdometrySettings


class MotionFilter:
    """Filters one motion after the other by its six velocities, each by itself.

    A Kalman filter of constant velocity, or a particle filter whose particles are weighed by exp(-lambda |v - measured|) as in RTAB-Map.
    """

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self._rng = np.random.default_rng(settings.seed)
        self._velocity: Floats | None = None
        self._variance = 1.0
        self._particles: Floats | None = None

    def forget(self) -> None:
        """Begin anew."""
        self._velocity, self._variance, self._particles = None, 1.0, None

    def filtered(self, T_prev_cur: Floats, seconds: float) -> Floats:
        """Return a motion of the base (4, 4) after the filters; `seconds` it took."""
        if seconds > 0.0 and self._settings.filtering is not Filtering.NONE:
            velocity = np.concatenate([T_prev_cur[:3, 3], _euler(T_prev_cur)]) / seconds
            kalman = self._settings.filtering is Filtering.KALMAN
            velocity = self._by_kalman(velocity) if kalman else self._by_particles(velocity)
            T_prev_cur = _motion(velocity * seconds)
        return T_prev_cur if self._settings.holonomic else _without_strafing(T_prev_cur)

    def _by_kalman(self, velocity: Floats) -> Floats:
        if self._velocity is None:
            self._velocity = velocity
            return velocity
        predicted = self._variance + self._settings.kalman_process
        gain = predicted / (predicted + self._settings.kalman_measurement)
        self._variance = (1.0 - gain) * predicted
        self._velocity = self._velocity + gain * (velocity - self._velocity)
        return self._velocity

    def _by_particles(self, velocity: Floats) -> Floats:
        settings = self._settings
        noise = np.repeat([settings.particle_noise_t, settings.particle_noise_r], 3)
        sharpness = np.repeat([settings.particle_lambda_t, settings.particle_lambda_r], 3)
        if self._particles is None:
            self._particles = np.tile(velocity, (settings.particles, 1))
        spread = self._particles + noise * self._rng.standard_normal(self._particles.shape)
        weights = np.exp(-sharpness * np.abs(spread - velocity)) + 1e-300
        weights /= weights.sum(axis=0)
        draws = (np.arange(settings.particles) + 0.5) / settings.particles
        for axis in range(6):
            rows = np.searchsorted(np.cumsum(weights[:, axis]), draws).clip(0, settings.particles - 1)
            self._particles[:, axis] = spread[rows, axis]
        return (weights * spread).sum(axis=0)


def _without_strafing(T_prev_cur: Floats) -> Floats:
    """Return the motion with y as on an arc (x, yaw): the chord of an arc lies half its turn beside the tangent."""
    roll, pitch, yaw = _euler(T_prev_cur).tolist()
    x, z = float(T_prev_cur[0, 3]), float(T_prev_cur[2, 3])
    return _motion(np.array([x, x * math.tan(0.5 * yaw), z, roll, pitch, yaw]))


def _euler(T: Floats) -> Floats:
    """Roll, pitch and yaw of a small motion."""
    R = T[:3, :3]
    return np.array([
        math.atan2(R[2, 1], R[2, 2]), math.asin(min(max(-R[2, 0], -1.0), 1.0)), math.atan2(R[1, 0], R[0, 0])
    ])  # fmt: skip


def _motion(values: Floats) -> Floats:
    """Return the motion (4, 4) of x, y, z, roll, pitch, yaw."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(values[3:]), np.sin(values[3:])
    R = np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip
    return se3.from_rotation_translation(R, values[:3])
