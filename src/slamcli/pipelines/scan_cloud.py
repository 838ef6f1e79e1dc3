# SPDX-License-Identifier: MIT
"""A planar scan as the points that it measured."""

from __future__ import annotations

import numpy as np

from slamcli.measurements import LaserScan, PointCloud


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
