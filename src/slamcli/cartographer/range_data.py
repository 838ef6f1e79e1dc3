# SPDX-License-Identifier: MIT
"""What range sensors measured, as local SLAM in the plane takes it: returns, misses and where the beams started."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import TrajectoryBuilder2d
from slamcli.geometry import quaternion, se2
from slamcli.measurements import LaserScan, PointCloud
from slamcli.registration.beams import Beams, moved, sweep_times

RangeMeasurement = LaserScan | PointCloud


@dataclass(frozen=True, slots=True, eq=False)
class RangeData:
    """Range measurements in the plane of the tracking frame, gravity-aligned, metres."""

    start: NDArray[np.float64]
    """float64 (2,), where the beams start."""
    returns: NDArray[np.float64]
    """float64 (N, 2), where they ended."""
    misses: NDArray[np.float64]
    """float64 (M, 2), how far beams that ended beyond `max_range` are taken for free."""

    def as_beams(self) -> Beams:
        """Return the returns as the scan odometry takes them."""
        hit = np.ones(len(self.returns), np.bool_)
        return Beams(self.returns, np.empty((0, 2)), self.start.reshape(1, 2), self.returns, hit)


class RangeSensor:
    """Turns the measurements of one mounted sensor into `RangeData`, as Cartographer's ROS node and 2D builder do."""

    def __init__(
        self, parameters: TrajectoryBuilder2d, T_base_sensor: NDArray[np.float64], no_return: str = "ignore"
    ) -> None:
        self._parameters, self._no_return = parameters, no_return
        self._rotation, self._position = T_base_sensor[:3, :3], T_base_sensor[:3, 3]
        self._fan: tuple[int, float, float] | None = None
        self._unit: NDArray[np.float64] = np.empty((0, 3))

    def range_data(
        self,
        measurement: RangeMeasurement,
        twist: NDArray[np.float64] | None = None,
        tilt_xyzw: NDArray[np.float64] | None = None,
    ) -> RangeData:
        """Return what was measured, seen from the base at the measurement's stamp.

        Parameters
        ----------
        twist : float64 (3,), velocity of the base during the sweep, by which points are put to where they were; None
            for a sensor that measures all at once.
        tilt_xyzw : float64 (4,), rotation (without heading) of the base into a frame whose z is up; None for level.
        """
        if isinstance(measurement, LaserScan):
            vectors, ranges, times = self._scan(measurement)
        else:
            vectors, ranges, times = self._cloud(measurement)
        p = self._parameters
        far = ranges > p.max_range
        length = np.where(far, min(p.missing_data_ray_length, p.max_range), ranges)
        points = self._position + vectors * length[:, None]
        start = self._position
        if tilt_xyzw is not None:
            level = quaternion.to_matrix(tilt_xyzw)
            points, start = points @ level.T, level @ start
        inside = (points[:, 2] >= p.min_z) & (points[:, 2] <= p.max_z)
        flat = points[:, :2]
        if twist is not None and times is not None:
            flat = moved(flat, times, twist)
        return RangeData(
            start[:2].copy(), np.ascontiguousarray(flat[inside & ~far]), np.ascontiguousarray(flat[inside & far])
        )

    def _scan(self, scan: LaserScan) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None]:
        """Return directions (N, 3) in the base, ranges (N,) and times (N,) of the readings that count.

        Only readings between the scanner's own limits are points; the others are dropped before `max_range` is looked
        at (cartographer_ros), unless the user says that no return means free space.
        """
        fan = (scan.num_beams, scan.angle_min_rad, scan.angle_increment_rad)
        if fan != self._fan:
            angles = scan.angles_rad
            sensor = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
            self._fan, self._unit = fan, sensor @ self._rotation.T
        ranges = scan.ranges_m.astype(np.float64)
        near = max(scan.range_min_m, self._parameters.min_range)
        kept = (ranges >= near) & (ranges > 0.0) & (ranges <= scan.range_max_m)
        if self._no_return != "ignore":
            nothing = ranges > scan.range_max_m
            ranges = np.where(nothing, np.inf, ranges)
            kept |= nothing
        times = sweep_times(scan)[kept] if scan.time_increment_s != 0.0 else None
        return self._unit[kept], ranges[kept], times

    def _cloud(self, cloud: PointCloud) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None]:
        points = cloud.points_m.astype(np.float64)
        ranges = np.sqrt((points**2).sum(axis=1))
        kept = (ranges >= self._parameters.min_range) & (ranges > 1e-6) & np.isfinite(ranges)
        ranges = ranges[kept]
        vectors = (points[kept] / ranges[:, None]) @ self._rotation.T
        times = None if cloud.offset_ns is None else cloud.offset_ns[kept] / 1e9
        return vectors, ranges, times


def joined(scans: Sequence[RangeData], motions: NDArray[np.float64]) -> RangeData:
    """Return consecutive scans (K) as one, seen from where the last was taken; row k of motions (K, 3) leads to scan k."""
    last = scans[-1]
    if len(scans) == 1:
        return last
    returns, misses = [last.returns], [last.misses]
    pose = np.zeros(3)
    for k in range(len(scans) - 2, -1, -1):
        pose = se2.compose(pose, se2.inverse(motions[k + 1]))
        returns.append(se2.transform_points(pose, scans[k].returns))
        misses.append(se2.transform_points(pose, scans[k].misses))
    return RangeData(last.start, np.concatenate(returns[::-1]), np.concatenate(misses[::-1]))


def sweep_seconds(measurement: RangeMeasurement) -> float:
    """Return how long the sweep took from its first to its last reading; 0 where nothing tells."""
    if isinstance(measurement, LaserScan):
        return abs(measurement.time_increment_s) * max(measurement.num_beams - 1, 0)
    if measurement.offset_ns is None or len(measurement.offset_ns) == 0:
        return 0.0
    return float(measurement.offset_ns.max() - measurement.offset_ns.min()) / 1e9
