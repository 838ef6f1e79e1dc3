# SPDX-License-Identifier: MIT
"""A planar scan as the points that it measured, and the other way round."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import LaserScan, PointCloud

_FINER = 8
_LEAST_STEP_RAD, _LONE_STEP_RAD = 1e-3, 0.01
_MOST_BEAMS = 60_000


def cloud_of(scan: LaserScan) -> PointCloud:
    """Return the returns of a scan that `slamcli.recordings.scan_normalisation` has put upright, in its own frame (z is 0).

    Each point has its time: where the increment of time is negative the last beam was measured first, at the stamp.
    """
    places = np.flatnonzero(np.isfinite(scan.ranges_m) & (scan.ranges_m > 0))
    ranges, angles = scan.ranges_m[places].astype(np.float64), scan.angles_rad[places]
    order = places if scan.time_increment_s >= 0 else scan.num_beams - 1 - places
    points = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(places))])
    return PointCloud(
        stamp_ns=scan.stamp_ns,
        frame_id=scan.frame_id,
        points_m=points.astype(np.float32),
        offset_ns=np.rint(order * abs(scan.time_increment_s) * 1e9).astype(np.int64) if scan.time_increment_s else None,
        intensities=None if scan.intensities is None else scan.intensities[places],
        topic=scan.topic,
    )


def scan_of(
    points_m: NDArray[np.float64],
    *,
    stamp_ns: int,
    frame_id: str,
    topic: str,
    range_max_m: float = 0.0,
    offset_ns: NDArray[np.int64] | None = None,
) -> LaserScan:
    """Return the points (N, 2) of a planar scanner as a scan: the way back from `cloud_of`.

    The beams are `_FINER` times as dense as the points are typically, so that each finds one in its direction (to a
    sixteenth of the points' spacing); where two fall into one the nearer stands. All others have no answer.

    Parameters
    ----------
    range_max_m
        Of the scanner, metres; 0: not known.
    offset_ns
        int64 (N,), when each point was measured after the stamp; None: all at once.
    """
    ranges = np.hypot(points_m[:, 0], points_m[:, 1])
    angles = np.arctan2(points_m[:, 1], points_m[:, 0])
    order = np.argsort(angles if offset_ns is None else offset_ns, kind="stable")
    ranges, angles = ranges[order], np.unwrap(angles[order])
    steps = np.diff(angles)
    clockwise = bool(len(steps)) and float(np.median(steps)) < 0
    size = np.abs(steps)[np.abs(steps) > _LEAST_STEP_RAD]
    step = (float(np.median(size)) if len(size) else _LONE_STEP_RAD) / _FINER
    first, span = float(angles.min(initial=np.inf)), float(np.ptp(angles)) if len(angles) else 0.0
    beams = np.full(min(round(span / step), _MOST_BEAMS) + 1, np.nan, dtype=np.float32)
    places = np.clip(np.rint((angles - first) / step).astype(np.int64), 0, len(beams) - 1)
    for i in np.argsort(-ranges, kind="stable").tolist():
        beams[places[i]] = ranges[i]
    sweep_s = 0.0 if offset_ns is None or len(beams) < 2 else float(offset_ns.max() - offset_ns.min()) / 1e9
    return LaserScan(
        stamp_ns=stamp_ns, frame_id=frame_id, angle_min_rad=first if len(angles) else 0.0, angle_increment_rad=step, range_min_m=0.0,
        range_max_m=range_max_m if range_max_m > 0 else float(ranges.max(initial=0.0)) + 1.0, ranges_m=beams, topic=topic,
        time_increment_s=(-sweep_s if clockwise else sweep_s) / max(len(beams) - 1, 1),
    )  # fmt: skip
