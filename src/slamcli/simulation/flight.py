# SPDX-License-Identifier: MIT
"""Motion in space along a curve through given poses, as a hand or a drone carries a rig of sensors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from slamcli.errors import ConfigError, UsageError
from slamcli.geometry import quaternion
from slamcli.simulation.drive import TICK_S, Motion
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.ride import Ride
from slamcli.simulation.space import Space
from slamcli.simulation.world import CarriedPath

Array = NDArray[np.float64]

_STEP_S = 5e-4
_MAX_DURATION_S = 86_400.0
_WAVES = 4
_SWAY_HZ = (0.35, 1.8)


class Flight(Ride):
    """The motion of the base frame along a path: twice differentiable everywhere, at rest first, swaying as a hand does.

    Between the poses of the path it follows cubic splines of position and of roll, pitch and yaw over time, at most as fast as
    `robot.speed` and `robot.turn_rate` from pose to pose.
    """

    def __init__(
        self, path: CarriedPath, parameters: SimulationParameters, duration_s: float | None, rng: np.random.Generator
    ) -> None:
        """Draw the sway.

        Raises
        ------
        UsageError
            If the recording would be longer than a day.
        """
        p = parameters
        poses = np.concatenate([path.poses, path.poses[:1]]) if path.closed else path.poses.copy()
        poses[:, 3:] = np.unwrap(poses[:, 3:], axis=0)
        steps = np.diff(poses, axis=0)
        seconds = np.maximum(
            np.linalg.norm(steps[:, :3], axis=1) / p.robot_speed,
            np.linalg.norm(steps[:, 3:], axis=1) / p.robot_turn_rate,
        )
        if seconds.min() <= 0.0:
            raise ConfigError("path: two poses that follow each other are the same")
        times = np.concatenate([[0.0], np.cumsum(seconds)])
        self._round_s = float(times[-1]) if path.closed else np.inf
        # What a round adds: a full turn of the yaw, perhaps
        self._growth = poses[-1] - poses[0] if path.closed else np.zeros(6)
        drift = (times / times[-1])[:, None] * self._growth
        smooth = poses - drift
        if path.closed:
            smooth[-1] = smooth[0]
        self._spline = CubicSpline(times, smooth, bc_type="periodic" if path.closed else "natural")
        self._rest_s = p.robot_rest
        self._ramp_s = max(p.robot_speed / p.robot_acceleration, 0.2) * 1.5
        way_s = float(times[-1]) * (path.rounds if path.closed else 1.0)
        whole_s = self._rest_s + max(way_s, 2 * self._ramp_s) + self._ramp_s
        self._stop_s = np.inf if path.closed else whole_s
        self._way_s = way_s
        if (whole_s if duration_s is None else duration_s) > _MAX_DURATION_S:
            raise UsageError("the recording would be longer than a day: give a shorter --duration, or fewer rounds")
        self._draw_sway(p, rng)
        count = round((whole_s if duration_s is None else duration_s) / TICK_S) + 1
        super().__init__(self._plan(np.arange(count, dtype=np.float64) * TICK_S), None)

    def at(self, times_s: Array) -> tuple[Array, Array]:
        """Return positions (N, 3) and rotations (N, 3, 3) of the base frame in map at `times_s` (N,)."""
        pose = self._pose(np.asarray(times_s))
        return pose[:, :3], quaternion.to_matrix(quaternion.from_roll_pitch_yaw(pose[:, 3], pose[:, 4], pose[:, 5]))

    def rates(self, times_s: Array) -> tuple[Array, Array]:
        """Return angular velocity (N, 3), rad/s, and acceleration (N, 3), m/s^2, both in the base frame's axes.

        Central differences over a millisecond: exact to 1e-4 m/s^2 and 1e-6 rad/s.
        """
        before, here, after = (self.at(times_s + shift) for shift in (-_STEP_S, 0.0, _STEP_S))
        turn = np.swapaxes(before[1], 1, 2) @ after[1]
        axis = np.stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1
        )
        pull = (after[0] - 2.0 * here[0] + before[0]) / _STEP_S**2
        return axis / (4 * _STEP_S), (pull[:, None] @ here[1])[:, 0]

    def twists(self, times_s: Array) -> tuple[Array, Array]:
        """Return linear and angular velocity (N, 3) in the base frame's axes."""
        before, here, after = (self.at(times_s + shift) for shift in (-_STEP_S, 0.0, _STEP_S))
        speed = (after[0] - before[0]) / (2 * _STEP_S)
        return (speed[:, None] @ here[1])[:, 0], self.rates(times_s)[0]

    @property
    def is_level(self) -> bool:
        """It never is."""
        return False

    def _draw_sway(self, p: SimulationParameters, rng: np.random.Generator) -> None:
        self._hertz = rng.uniform(*_SWAY_HZ, (_WAVES, 6))
        self._phases = rng.uniform(0.0, 2 * np.pi, (_WAVES, 6))
        scale = np.repeat([p.carried_sway, np.radians(p.carried_shake)], 3)
        self._amplitudes = scale * rng.uniform(0.5, 1.0, (_WAVES, 6)) * np.sqrt(2.0 / _WAVES) / self._hertz**0.5

    def _pose(self, times_s: Array) -> Array:
        """Return x, y, z, roll, pitch, yaw (N, 6)."""
        along = self._progress(times_s)
        if np.isfinite(self._round_s):
            rounds = np.floor(along / self._round_s)
            poses = self._spline(along - rounds * self._round_s) + (along / self._round_s)[:, None] * self._growth
        else:
            poses = self._spline(np.clip(along, 0.0, self._way_s))
        ease = _eased(np.clip((times_s - self._rest_s) / self._ramp_s, 0.0, 1.0))
        waves = self._amplitudes * np.sin(2 * np.pi * self._hertz * times_s[:, None, None] + self._phases)
        swaying: Array = poses + ease[:, None] * waves.sum(axis=1)
        return swaying

    def _progress(self, times_s: Array) -> Array:
        """Return how far along the spline (N,), in its seconds: a smooth start, and on an open path a smooth end."""

        def begun(seconds: Array) -> Array:
            x = np.clip(seconds / self._ramp_s, 0.0, 1.0)
            ramp = x**6 - 3 * x**5 + 2.5 * x**4
            return self._ramp_s * ramp + np.maximum(seconds - self._ramp_s, 0.0)

        start = begun(times_s - self._rest_s)
        if not np.isfinite(self._stop_s):
            return start
        middle = (self._rest_s + self._stop_s) / 2
        whole = self._stop_s - self._rest_s - self._ramp_s
        progress: Array = np.where(times_s < middle, start, whole - begun(self._stop_s - times_s))
        return progress * (self._way_s / whole)

    def _plan(self, times_s: Array) -> Motion:
        """Return the motion on the plan: x, y, yaw, and speeds along the nose and about the vertical."""
        pose = self._pose(times_s)
        plan = pose[:, [0, 1, 5]]
        steps = np.gradient(plan, TICK_S, axis=0) if len(plan) > 1 else np.zeros_like(plan)
        forward = np.cos(plan[:, 2]) * steps[:, 0] + np.sin(plan[:, 2]) * steps[:, 1]
        return Motion(plan, np.column_stack([forward, steps[:, 2]]))


def first_crossing(space: Space, points: Array) -> int | None:
    """Return the first of points (N, 3) after which the way to the next passes through something, None if all is clear."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    ranges = space.cast(points[:-1], steps / np.maximum(lengths, 1e-12)[:, None], float(lengths.max(initial=0.0)) + 1.0)
    crossed = np.flatnonzero(ranges[:, 0] <= lengths)
    return int(crossed[0]) if len(crossed) else None


def _eased(x: Array) -> Array:
    return x**3 * (6 * x**2 - 15 * x + 10)
