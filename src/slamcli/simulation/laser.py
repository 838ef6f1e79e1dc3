# SPDX-License-Identifier: MIT
"""The laser scanner: beams one after the other while the robot moves, with noise, dropouts and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.measurements import LaserScan
from slamcli.simulation import raycast
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.people import Crowd
from slamcli.simulation.ride import Ride
from slamcli.simulation.space import Space, shorten
from slamcli.simulation.world import World

Array = NDArray[np.float64]

FRAME = "laser"
TOPIC = "/scan"


@dataclass(frozen=True, slots=True, eq=False)
class BeamPattern:
    """Where the beams of a scan point and when, as `laser.*` settings have it."""

    angle_min_rad: float
    increment_rad: float
    time_increment_s: float
    angles_base: Array
    """float64 (N,): directions in base_link."""
    offsets_s: Array
    """float64 (N,): time of each beam from the first."""

    @property
    def sweep_s(self) -> float:
        """Seconds from the first to the last beam."""
        return float(self.offsets_s[-1])


def beam_pattern(p: SimulationParameters) -> BeamPattern:
    """Return the beams of a scan in the order in which they are measured."""
    fov = math.radians(p.laser_fov)
    gaps = p.laser_beams if p.laser_fov >= 360.0 else max(p.laser_beams - 1, 1)
    way = -1.0 if p.laser_clockwise else 1.0
    increment = way * fov / gaps if fov > 0 else way * 1e-3
    first = -way * fov / 2
    whole = fov / (2 * math.pi) / p.laser_rate
    step = (whole if p.laser_sweep is None else min(p.laser_sweep, 1 / p.laser_rate)) / gaps
    side = -1.0 if p.laser_upside_down else 1.0
    numbers: Array = np.arange(p.laser_beams, dtype=np.float64)
    angles = math.radians(p.laser_yaw) + side * (first + numbers * increment)
    return BeamPattern(first, increment, step, angles, numbers * step)


def special_reading(kind: str, farthest_m: float) -> float:
    """Return the number that a setting such as `laser.no_return` means."""
    return {"nan": math.nan, "inf": math.inf, "zero": 0.0, "max": farthest_m}[kind]


class Scanner:
    """A planar scanner on the robot; `scan` gives what it measures from a time on."""

    def __init__(
        self, world: World, ride: Ride, space: Space | None, crowd: Crowd, parameters: SimulationParameters,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._world, self._ride, self._space, self._crowd = world, ride, space, crowd
        self._parameters, self._rng = parameters, rng
        pattern = beam_pattern(parameters)
        self.angle_min_rad, self.increment_rad = pattern.angle_min_rad, pattern.increment_rad
        self.time_increment_s = pattern.time_increment_s
        self._angles_base, self._offsets_s = pattern.angles_base, pattern.offsets_s

    @property
    def sweep_s(self) -> float:
        """Seconds from the first to the last beam."""
        return float(self._offsets_s[-1])

    def mount(self) -> tuple[Array, Array]:
        """Return position (3,) and quaternion (4,) of the scanner in base_link."""
        p = self._parameters
        roll = math.pi if p.laser_upside_down else 0.0
        return np.array([p.laser_x, p.laser_y, p.laser_z]), quaternion.from_roll_pitch_yaw(
            roll, 0.0, math.radians(p.laser_yaw)
        )

    def rays(self, time_s: float) -> tuple[Array, Array]:
        """Return origins and directions (N, 2), map frame, of the beams of a scan that begins at `time_s`."""
        base = self._ride.motion.at(time_s + self._offsets_s)
        c, s = np.cos(base[:, 2]), np.sin(base[:, 2])
        x, y = self._parameters.laser_x, self._parameters.laser_y
        angles = base[:, 2] + self._angles_base
        origins = np.column_stack([base[:, 0] + c * x - s * y, base[:, 1] + s * x + c * y])
        return origins, np.column_stack([np.cos(angles), np.sin(angles)])

    def true_ranges(self, time_s: float) -> Array:
        """Return exact distances (N,) along the beams of a scan that begins at `time_s`; inf beyond range_max."""
        if self._space is not None:
            return self._ranges_in_space(self._space, time_s)
        origins, directions = self.rays(time_s)
        ranges = raycast.cast(self._world, origins, directions, self._parameters.laser_range_max)
        discs = self._crowd.discs(time_s)
        return raycast.cast_moving(origins, directions, self._offsets_s, discs, ranges) if len(discs) else ranges

    def _ranges_in_space(self, space: Space, time_s: float) -> Array:
        """Return the same in a world with heights, where the plane of the scan tilts with the robot."""
        positions, rotations = self._ride.at(time_s + self._offsets_s)
        mount, _ = self.mount()
        level = np.column_stack(
            [np.cos(self._angles_base), np.sin(self._angles_base), np.zeros(len(self._angles_base))]
        )
        origins, directions = positions + rotations @ mount, (rotations @ level[:, :, None])[:, :, 0]
        limit = self._parameters.laser_range_max
        hits = space.cast(origins, directions, limit)
        bodies = self._crowd.bodies(time_s, self._ride)
        if len(bodies):
            hits = shorten(hits, origins, directions, self._offsets_s, bodies, limit)
        return hits[:, 0]

    def scan(self, time_s: float, stamp_ns: int) -> LaserScan:
        """Return the scan that begins at `time_s` (seconds from the start) and says it was at `stamp_ns`."""
        p = self._parameters
        return LaserScan(
            stamp_ns=stamp_ns,
            frame_id=FRAME,
            angle_min_rad=self.angle_min_rad,
            angle_increment_rad=self.increment_rad,
            range_min_m=p.laser_range_min,
            range_max_m=p.laser_range_max,
            ranges_m=self._measured(self.true_ranges(time_s)),
            time_increment_s=self.time_increment_s,
            scan_time_s=1.0 / p.laser_rate,
            topic=TOPIC,
        )

    def _measured(self, true_m: Array) -> NDArray[np.float32]:
        p = self._parameters
        noise = self._rng.standard_normal(len(true_m))
        lost = self._rng.random(len(true_m)) < p.laser_dropout
        reached = np.isfinite(true_m)
        ranges = np.where(reached, true_m, 0.0)
        ranges = ranges + noise * np.hypot(p.laser_noise, p.laser_noise_relative * ranges)
        if p.laser_resolution > 0:
            ranges = np.round(ranges / p.laser_resolution) * p.laser_resolution
        ranges = np.where(true_m < p.laser_range_min, -np.inf, np.maximum(ranges, p.laser_range_min))
        ranges = np.where(~reached | (ranges > p.laser_range_max), self._special(p.laser_no_return), ranges)
        return np.where(lost, self._special(p.laser_dropout_value), ranges).astype(np.float32)

    def _special(self, kind: str) -> float:
        return special_reading(kind, self._parameters.laser_range_max)
