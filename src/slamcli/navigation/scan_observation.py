# SPDX-License-Identifier: MIT
"""Laser scans and clouds as observations of a costmap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements.laser import LaserScan
from slamcli.measurements.points import PointCloud
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_parameters import ObservationSource

_JUST_BELOW_M = 1e-4


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
    x, y, yaw = np.asarray(T_frame_laser, dtype=np.float64)
    ranges = scan.ranges_m.astype(np.float64)
    angles = scan.angles_rad + yaw
    limit = scan.range_max_m if scan.range_max_m > 0.0 else np.inf
    near = max(scan.range_min_m, 0.0) if np.isfinite(scan.range_min_m) else 0.0
    with np.errstate(invalid="ignore"):
        met = (ranges >= near) & (ranges < limit)
        nothing = (ranges >= limit) | (ranges == np.inf)
    reach = np.where(met, ranges, limit - _JUST_BELOW_M)
    valid = source.inf_is_valid is not False and np.isfinite(limit)
    seen = met | nothing if valid else met
    if not source.min_obstacle_height <= sensor_height_m <= source.max_obstacle_height:
        seen = np.zeros_like(met)
    ends = np.empty((int(np.count_nonzero(seen)), 3))
    ends[:, 0] = x + reach[seen] * np.cos(angles[seen])
    ends[:, 1] = y + reach[seen] * np.sin(angles[seen])
    ends[:, 2] = sensor_height_m
    hit = met[seen]
    return Observation(
        source=source.name,
        time_s=time_s,
        origin=np.array([x, y, sensor_height_m], dtype=np.float64),
        points=ends[hit],
        clear_points=ends[~hit],
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
