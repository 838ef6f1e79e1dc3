# SPDX-License-Identifier: MIT
"""The spinning scanner: columns of beams fired one after the other while the robot moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.geometry import quaternion
from slamcli.measurements import PointCloud
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.people import Crowd
from slamcli.simulation.ride import Ride
from slamcli.simulation.space import Space, shorten

Array = NDArray[np.float64]

FRAME = "lidar3d"
TOPIC = "/points"
_BRIGHTEST = 255.0


class SpinningScanner:
    """A scanner of several rings on the robot; `cloud` gives what one revolution measures.

    All beams of a column are fired at once, from where the robot is then; columns follow each other evenly through the
    revolution, the first one looks forward. Points are told in the scanner's frame at their own time.
    """

    def __init__(
        self, space: Space, ride: Ride, crowd: Crowd, parameters: SimulationParameters, rng: np.random.Generator
    ) -> None:
        self._space, self._ride, self._crowd, self._parameters, self._rng = space, ride, crowd, parameters, rng
        p = parameters
        self.elevations_rad = np.radians(_elevations(p))
        way = -1.0 if p.lidar3d_clockwise else 1.0
        azimuth = way * 2 * np.pi * np.arange(p.lidar3d_columns) / p.lidar3d_columns
        self._offsets_s = np.arange(p.lidar3d_columns) / (p.lidar3d_columns * p.lidar3d_rate)
        c, s = np.cos(self.elevations_rad), np.sin(self.elevations_rad)
        beams = np.stack(
            [np.cos(azimuth)[:, None] * c, np.sin(azimuth)[:, None] * c, np.broadcast_to(s, (len(azimuth), len(s)))],
            axis=2,
        )
        self._beams = beams  # (columns, rings, 3) in the scanner's frame
        position, quat = self.mount()
        self._position, self._rotation = position, quaternion.to_matrix(quat)

    @property
    def sweep_s(self) -> float:
        """Seconds of one revolution."""
        return 1.0 / self._parameters.lidar3d_rate

    def mount(self) -> tuple[Array, Array]:
        """Return position (3,) and quaternion (4,) of the scanner in base_link."""
        p = self._parameters
        roll, pitch, yaw = np.radians([p.lidar3d_roll, p.lidar3d_pitch, p.lidar3d_yaw])
        return np.array([p.lidar3d_x, p.lidar3d_y, p.lidar3d_z]), quaternion.from_roll_pitch_yaw(roll, pitch, yaw)

    def rays(self, time_s: float) -> tuple[Array, Array]:
        """Return origins and directions (columns * rings, 3), map frame, of the revolution that begins at `time_s`."""
        positions, rotations = self._ride.at(time_s + self._offsets_s)
        origins = positions + (rotations @ self._position)
        directions = self._beams @ np.swapaxes(rotations @ self._rotation, 1, 2)
        return np.repeat(origins, len(self.elevations_rad), axis=0), directions.reshape(-1, 3)

    def cloud(self, time_s: float, stamp_ns: int) -> PointCloud:
        """Return the cloud of the revolution that begins at `time_s` (seconds from the start), said to be at `stamp_ns`."""
        p = self._parameters
        true_m, shine, cosine = self._hits(time_s).T
        ranges = true_m + p.lidar3d_noise * self._rng.standard_normal(len(true_m))
        kept = self._rng.random(len(true_m)) >= p.lidar3d_dropout
        bright = _BRIGHTEST * shine * cosine + p.lidar3d_intensity_noise * self._rng.standard_normal(len(true_m))
        kept &= (true_m >= p.lidar3d_range_min) & (ranges <= p.lidar3d_range_max) & (ranges > 0.0)
        rings = len(self.elevations_rad)
        index = np.flatnonzero(kept)
        column, ring = index // rings, index % rings
        shape = (rings, p.lidar3d_columns) if p.lidar3d_organised else None
        return PointCloud(
            stamp_ns=stamp_ns,
            frame_id=FRAME,
            points_m=(self._beams.reshape(-1, 3)[index] * ranges[index, None]).astype(np.float32),
            offset_ns=np.rint(self._offsets_s * 1e9).astype(np.int64)[column],
            intensities=np.rint(np.clip(bright[index], 0.0, _BRIGHTEST)).astype(np.float32),
            rings=ring.astype(np.uint16),
            shape=shape,
            cells=None if shape is None else ring * p.lidar3d_columns + column,
            topic=TOPIC,
        )

    def _hits(self, time_s: float) -> Array:
        """Return range, reflectivity and cosine of incidence (columns * rings, 3) of a perfect revolution."""
        limit = self._parameters.lidar3d_range_max
        origins, directions = self.rays(time_s)
        hits = self._space.cast(origins, directions, limit)
        bodies = self._crowd.bodies(time_s, self._ride)
        if len(bodies):
            times = np.repeat(self._offsets_s, len(self.elevations_rad))
            hits = shorten(hits, origins, directions, times, bodies, limit)
        return hits


def _elevations(parameters: SimulationParameters) -> Array:
    """Return elevations (rings,) in degrees, lowest first."""
    p = parameters
    if not p.lidar3d_angles.strip():
        return np.linspace(p.lidar3d_lowest, p.lidar3d_highest, p.lidar3d_rings)
    try:
        angles = np.array([float(v) for v in p.lidar3d_angles.replace(",", " ").split()])
    except ValueError as error:
        raise ConfigError(f"lidar3d.angles: {p.lidar3d_angles[:60]!r} is not numbers with commas between") from error
    if not (np.isfinite(angles).all() and (np.abs(angles) <= 90.0).all() and len(angles) <= 512):
        raise ConfigError(f"lidar3d.angles: {p.lidar3d_angles[:60]!r}: at most 512 elevations from -90 to 90 degrees")
    return np.sort(angles)
