# SPDX-License-Identifier: MIT
"""From what range sensors measured to what a node keeps of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
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
    T_begin_end: Floats | None = None,
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
    T_begin_end
        float64 (4, 4), how the base moved from the measurement's stamp to the end of its sweep (`sweep_ns`), instead of `twist`; None: it stood.
    range_min_m, range_max_m
        Nearer and farther points are left out, metres; 0: the sensor's own limits.
    """
    if isinstance(measurement, LaserScan):
        if T_begin_end is not None and sweep_ns(measurement) > 0:
            twist = se3.to_se2(T_begin_end) / (sweep_ns(measurement) / 1e9)
        return _planar(measurement, T_base_sensor, no_return, twist, (range_min_m, range_max_m))
    points = measurement.points_m.astype(np.float64)
    ranges = np.linalg.norm(points, axis=1)
    keep = (ranges > range_min_m) & ((ranges <= range_max_m) | (range_max_m <= 0.0))
    flat = len(points) > 0 and bool((np.abs(points[:, 2]) < _FLAT_M).all())
    placed = _placed(points[keep], T_base_sensor)
    if T_begin_end is None and twist is not None:
        T_begin_end = se3.from_se2(twist * (sweep_ns(measurement) / 1e9))
    if T_begin_end is not None and measurement.offset_ns is not None and sweep_ns(measurement) > 0:
        placed = _carried(placed, measurement.offset_ns[keep] / sweep_ns(measurement), T_begin_end)
    return NodeScan(points=placed, planar=flat, T_base_sensor=T_base_sensor, range_max_m=range_max_m)


def sweep_ns(measurement: LaserScan | PointCloud) -> int:
    """Return how long after its stamp the last part of a scan or cloud was measured, nanoseconds."""
    if isinstance(measurement, LaserScan):
        return max(0, round((measurement.num_beams - 1) * measurement.time_increment_s * 1e9))
    return 0 if measurement.offset_ns is None else max(0, int(measurement.offset_ns.max(initial=0)))


def _carried(points: NDArray[np.float32], shares: Floats, T_begin_end: Floats) -> NDArray[np.float32]:
    """Return points (N, 3) of the base where it was at shares (N,) of a motion, in the base where it began: at even speed."""
    position, quat = se3.to_position_quaternion(T_begin_end)
    turned = quaternion.rotate(
        quaternion.slerp(np.array([0.0, 0.0, 0.0, 1.0]), quat, shares), points.astype(np.float64)
    )
    return (turned + shares[:, None] * position).astype(np.float32)


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
