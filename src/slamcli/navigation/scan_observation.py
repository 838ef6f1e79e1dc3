# SPDX-License-Identifier: MIT
"""Laser scans and clouds as observations of a costmap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements.laser import LaserScan
from slamcli.measurements.points import PointCloud
from slamcli.navigation import _obstacle_kernels as kernels
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_parameters import ObservationSource


def observe_scan(
    scan: LaserScan,
    T_frame_laser: NDArray[np.float64],
    source: ObservationSource,
    time_s: float,
    sensor_height_m: float = 0.0,
) -> Observation:
    """Return what a planar scan tells a costmap.

    Readings from range_min to below range_max become points. Those at or beyond range_max, and +inf, met nothing: they clear up to 0.1 mm
    below range_max, unless the source says ``inf_is_valid: false``; they never mark. Others (NaN, -inf, nearer than range_min) are
    left out. A range_max that is not a positive number is no limit, and then nothing clears without a point.

    Parameters
    ----------
    scan
        The scan; its frame is upright.
    T_frame_laser
        float64 (3,): the scanner in the costmap's frame when it measured.
    source
        The observation source.
    time_s
        When, simulated seconds.
    sensor_height_m
        Of the scanner above the ground. Outside the source's heights the scan says nothing.
    """
    pose = np.ascontiguousarray(T_frame_laser, dtype=np.float64)
    limit = float(scan.range_max_m) if scan.range_max_m > 0.0 else np.inf
    near = max(float(scan.range_min_m), 0.0) if np.isfinite(scan.range_min_m) else 0.0
    valid = source.inf_is_valid is not False and bool(np.isfinite(limit))
    points, nothing = np.empty((scan.num_beams, 3)), np.empty((scan.num_beams, 3))
    met, clear = 0, 0
    if source.min_obstacle_height <= sensor_height_m <= source.max_obstacle_height:
        ranges = np.ascontiguousarray(scan.ranges_m, dtype=np.float32)
        met, clear = kernels.project_scan(
            ranges, float(scan.angle_min_rad), float(scan.angle_increment_rad), pose, near, limit, float(sensor_height_m), valid,
            points, nothing,
        )  # fmt: skip
    return Observation(
        source=source.name,
        time_s=time_s,
        origin=np.array([pose[0], pose[1], sensor_height_m], dtype=np.float64),
        points=points[:met],
        clear_points=nothing[:clear],
    )


def observe_cloud(
    cloud: PointCloud,
    T_frame_sensor: NDArray[np.float64],
    source: ObservationSource,
    time_s: float,
    sensor_height_m: float = 0.0,
) -> Observation:
    """Return what a cloud tells a costmap: its points between the heights of the source.

    Parameters
    ----------
    cloud
        Points in an upright sensor frame (z up).
    T_frame_sensor
        float64 (3,): the sensor in the costmap's frame when it measured.
    source
        The observation source.
    time_s
        When, simulated seconds.
    sensor_height_m
        Of the sensor above the ground.
    """
    pose = np.asarray(T_frame_sensor, dtype=np.float64)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    local = cloud.points_m.astype(np.float64)
    points = np.empty(local.shape)
    points[:, 0] = pose[0] + c * local[:, 0] - s * local[:, 1]
    points[:, 1] = pose[1] + s * local[:, 0] + c * local[:, 1]
    points[:, 2] = sensor_height_m + local[:, 2]
    high = (points[:, 2] >= source.min_obstacle_height) & (points[:, 2] <= source.max_obstacle_height)
    kept = high & np.isfinite(points).all(axis=1)
    origin = np.array([pose[0], pose[1], sensor_height_m], dtype=np.float64)
    return Observation(
        source=source.name, time_s=time_s, origin=origin, points=points[kept], clear_points=np.zeros((0, 3))
    )


def warm() -> None:
    """Compile the kernels of this module."""
    scan = LaserScan(
        stamp_ns=0,
        frame_id="laser",
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        range_min_m=0.0,
        range_max_m=2.0,
        ranges_m=np.ones(2, dtype=np.float32),
    )
    observe_scan(scan, np.zeros(3), ObservationSource(), 0.0)
