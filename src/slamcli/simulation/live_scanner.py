# SPDX-License-Identifier: MIT
"""The planar scanner of a robot that is not on a way known beforehand."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.measurements import LaserScan
from slamcli.simulation import _beam_kernels, laser
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.walls import Walls

Array = NDArray[np.float64]


class LiveScanner:
    """Beams, noise and dropouts of `laser.Scanner`, for poses that are known when the last beam is measured."""

    def __init__(self, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        """Raise UsageError if the limits of ranges make no sense; `rng` draws the noise."""
        p = parameters
        if p.laser_range_min >= p.laser_range_max:
            raise UsageError(
                f"laser.range_min {p.laser_range_min:g} m is not below laser.range_max {p.laser_range_max:g} m"
            )
        self._parameters, self._rng = parameters, rng
        self._pattern = laser.beam_pattern(p)
        self._before: Array = self._pattern.offsets_s - self._pattern.sweep_s
        self._mount = np.array([p.laser_x, p.laser_y])
        lost, beyond = (laser.special_reading(k, p.laser_range_max) for k in (p.laser_dropout_value, p.laser_no_return))
        self._errors = np.array(
            [
                p.laser_range_min, p.laser_range_max, p.laser_noise, p.laser_noise_relative, p.laser_resolution,
                p.laser_dropout, lost, beyond,
            ]
        )  # fmt: skip

    @property
    def sweep_s(self) -> float:
        """Seconds from the first to the last beam."""
        return self._pattern.sweep_s

    @property
    def beam_step_s(self) -> float:
        """Seconds from one beam to the next."""
        return self._pattern.time_increment_s

    def true_ranges(self, poses: Array, walls: Walls, seen: Array, seen_since_s: float) -> Array:
        """Return exact distances (N,), inf beyond range_max.

        `poses` (N, 3) are base_link's at each beam, `seen` (M, 9) what moves, as it was `seen_since_s` before the last.
        """
        ranges = np.empty(len(poses))
        _beam_kernels.true_ranges(
            poses, self._mount, self._pattern.angles_base, self._before + seen_since_s, walls.field, walls.frame,
            walls.segments, walls.circles, walls.starts, walls.members, walls.layout, seen, self._parameters.laser_range_max, ranges,
        )  # fmt: skip
        return ranges

    def scan(self, true_m: Array, now_ns: int) -> LaserScan:
        """Return what the scanner says of true distances (N,) whose last beam is measured at `now_ns`."""
        p, pattern = self._parameters, self._pattern
        noise, lost = self._rng.standard_normal(len(true_m)), self._rng.random(len(true_m))
        ranges = np.empty(len(true_m), np.float32)
        _beam_kernels.measure(true_m, noise, lost, self._errors, ranges)
        return LaserScan(
            stamp_ns=now_ns - round((pattern.sweep_s - p.clock_laser_offset) * 1e9),
            frame_id=laser.FRAME,
            angle_min_rad=pattern.angle_min_rad,
            angle_increment_rad=pattern.increment_rad,
            range_min_m=p.laser_range_min,
            range_max_m=p.laser_range_max,
            ranges_m=ranges,
            time_increment_s=pattern.time_increment_s,
            scan_time_s=1.0 / p.laser_rate,
            topic=laser.TOPIC,
        )

    @property
    def T_base_laser(self) -> Array:  # noqa: N802 - frames as everywhere
        """float64 (3,): the scanner on base_link, seen from above."""
        return np.array([*self._mount, math.radians(self._parameters.laser_yaw)])


def poses_at(history: Array, tick: float, now: int, step: float, poses: Array) -> None:
    """Fill `poses` (N, 3) with those at ticks `tick` + i * `step`; `history` (T, 3) keeps the last T ticks up to `now`."""
    whole = math.floor(tick)
    oldest = max(now - len(history) + 1, 0)
    _beam_kernels.poses_at(history, whole, tick - whole, now, oldest, step, poses)
