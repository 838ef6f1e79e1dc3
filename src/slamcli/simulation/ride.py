# SPDX-License-Identifier: MIT
"""Where the robot is in space: its motion on the plan, set down on the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation.drive import TICK_S, Motion
from slamcli.simulation.relief import Terrain

Array = NDArray[np.float64]

_WHEELBASE_M = 0.5
_TRACK_M = 0.4


class Ride:
    """The motion of base_link in space; its heading is that on the plan, its height and tilt those of four wheels.

    Without ground it stays level at height 0.
    """

    def __init__(self, motion: Motion, ground: Terrain | None) -> None:
        self.motion, self._ground = motion, ground

    @property
    def is_level(self) -> bool:
        """Whether there is no ground that could rise or fall."""
        return self._ground is None

    def at(self, times_s: Array) -> tuple[Array, Array]:
        """Return positions (N, 3) and rotations (N, 3, 3) of base_link in map at `times_s` (N,), seconds from the start."""
        plan = self.motion.at(times_s)
        c, s = np.cos(plan[:, 2]), np.sin(plan[:, 2])
        z, along, across = self._footing(plan[:, :2], c, s)
        up = np.stack([-along * c + across * s, -along * s - across * c, np.ones_like(c)], axis=1)
        up /= np.sqrt((up * up).sum(axis=1))[:, None]
        forward = np.stack([c, s, along], axis=1) / np.sqrt(1.0 + along * along)[:, None]
        left = np.cross(up, forward)
        return np.column_stack([plan[:, :2], z]), np.stack([forward, left, up], axis=2)

    def ground_at(self, points: Array) -> Array:
        """Return the height (N,) of the ground at points (N, 2) of the map, metres."""
        return np.zeros(len(points)) if self._ground is None else self._ground.at(points)

    def rates(self, times_s: Array) -> tuple[Array, Array]:
        """Return angular velocity (N, 3), rad/s, and acceleration of base_link (N, 3), m/s^2, both in base_link's axes.

        Both are central differences over two ticks of the simulated motion.
        """
        before, here, after = (self.at(times_s + shift) for shift in (-TICK_S, 0.0, TICK_S))
        turn = np.swapaxes(before[1], 1, 2) @ after[1]
        # Of a small turn, the part of the matrix that changes sign when it is transposed is sin(angle) * axis.
        axis = np.stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1
        )
        sine = np.sqrt((axis * axis).sum(axis=1)) / 2
        growth = np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-9), 1.0)
        pull = (after[0] - 2.0 * here[0] + before[0]) / TICK_S**2
        return axis / 2 * growth[:, None] / (2 * TICK_S), (pull[:, None] @ here[1])[:, 0]

    def twists(self, times_s: Array) -> tuple[Array, Array]:
        """Return linear and angular velocity (N, 3) as of a vehicle: along its nose, and about the vertical."""
        speeds, zeros = self.motion.speeds_at(times_s), np.zeros((len(times_s), 2))
        return np.column_stack([speeds[:, 0], zeros]), np.column_stack([zeros, speeds[:, 1]])

    def stretch(self, times_s: Array) -> Array:
        """Return, for each step between `times_s` (N,), how much longer its way in space is than on the plan, (N - 1,)."""
        steps = np.diff(self.at(times_s)[0], axis=0)
        plan = np.hypot(steps[:, 0], steps[:, 1])
        return np.where(plan > 1e-9, np.hypot(plan, steps[:, 2]) / np.maximum(plan, 1e-9), 1.0)

    def _footing(self, points: Array, c: Array, s: Array) -> tuple[Array, Array, Array]:
        """Return height (N,) and slopes forward and to the left of the plane that fits best to the ground at the wheels."""
        if self._ground is None:
            return np.zeros(len(points)), np.zeros(len(points)), np.zeros(len(points))
        forward, left = np.column_stack([c, s]) * (_WHEELBASE_M / 2), np.column_stack([-s, c]) * (_TRACK_M / 2)
        corners = [points + a * forward + b * left for a in (1.0, -1.0) for b in (1.0, -1.0)]
        fl, fr, rl, rr = self.ground_at(np.concatenate(corners)).reshape(4, -1)
        along = (fl + fr - rl - rr) / (2 * _WHEELBASE_M)
        return (fl + fr + rl + rr) / 4, along, (fl + rl - fr - rr) / (2 * _TRACK_M)
