# SPDX-License-Identifier: MIT
"""From what range sensors measured to what a node keeps of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import LaserScan, PointCloud
from slamcli.registration.beams import moved, sweep_times
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]
_BORDER_M = 0.01
"""Readings within this of the maximum range are no return, as some drivers write them."""
_FLAT_M = 1e-3
"""A cloud that lies this near to its sensor's plane is that of a planar scanner."""


def node_scan(
    measurement: LaserScan | PointCloud,
    T_base_sensor: Floats,
    no_return: str = "ignore",
    twist: Floats | None = None,
    *,
    range_min_m: float = 0.0,
    range_max_m: float = 0.0,
) -> NodeScan:
    """Return the points of a scan or cloud in the base frame at the measurement's stamp.

    Parameters
    ----------
    T_base_sensor
        float64 (4, 4), where the sensor is mounted.
    no_return
        What a beam without an answer means: nothing (ignore), free space up to the maximum range (free), an end there (max).
    twist
        float64 (3,), the base's velocity x, y (m/s) and yaw (rad/s) during the sweep of a planar scan; None: it stood.
    range_min_m, range_max_m
        Nearer and farther points are left out, metres; 0: the sensor's own limits.
    """
    if isinstance(measurement, LaserScan):
        return _planar(measurement, T_base_sensor, no_return, twist, (range_min_m, range_max_m))
    points = measurement.points_m.astype(np.float64)
    ranges = np.linalg.norm(points, axis=1)
    keep = (ranges > range_min_m) & ((ranges <= range_max_m) | (range_max_m <= 0.0))
    flat = len(points) > 0 and bool((np.abs(points[:, 2]) < _FLAT_M).all())
    return NodeScan(
        points=_placed(points[keep], T_base_sensor), planar=flat, T_base_sensor=T_base_sensor, range_max_m=range_max_m
    )


def _planar(
    scan: LaserScan, T_base_sensor: Floats, no_return: str, twist: Floats | None, limits: tuple[float, float]
) -> NodeScan:
    ranges, angles = scan.ranges_m.astype(np.float64), scan.angles_rad
    longest = scan.range_max_m - _BORDER_M
    usable = min(longest, limits[1]) if limits[1] > 0.0 else longest
    valid = (ranges >= max(scan.range_min_m, limits[0])) & (ranges > 0.0)
    hit = valid & (ranges < usable)
    beyond = valid & (ranges >= longest)
    if no_return == "max" and np.isfinite(usable):
        ranges = np.where(beyond, usable, ranges)
        hit |= beyond
    free = valid & ~hit & ((ranges < longest) | (no_return == "free"))
    if not np.isfinite(usable):  # nobody knows how far such a beam was free
        free[:] = False
    unit = np.column_stack([np.cos(angles), np.sin(angles)])

    def ends(chosen: NDArray[np.bool_], length: Floats | float) -> NDArray[np.float32]:
        flat = unit[chosen] * np.broadcast_to(length, (int(chosen.sum()),))[:, None]
        based = np.column_stack([flat, np.zeros(len(flat))]) @ T_base_sensor[:3, :3].T + T_base_sensor[:3, 3]
        if twist is not None and scan.time_increment_s != 0.0:
            based[:, :2] = moved(based[:, :2], sweep_times(scan)[chosen], twist)
        return based.astype(np.float32)

    return NodeScan(
        points=ends(hit, ranges[hit]), planar=True, T_base_sensor=T_base_sensor,
        range_max_m=float(usable) if np.isfinite(usable) else 0.0, open_ends=ends(free, usable) if free.any() else None,
    )  # fmt: skip


def _placed(points: Floats, T_base_sensor: Floats) -> NDArray[np.float32]:
    return (points @ T_base_sensor[:3, :3].T + T_base_sensor[:3, 3]).astype(np.float32)
