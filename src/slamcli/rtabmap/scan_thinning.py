# SPDX-License-Identifier: MIT
"""Scans made smaller before a node keeps them."""

from __future__ import annotations

import dataclasses

import numpy as np

from slamcli.registration.voxel_filter import voxel_filter
from slamcli.rtabmap.parameters import MemGroup
from slamcli.rtabmap.signature import NodeScan


def kept_scan(scan: NodeScan, settings: MemGroup) -> NodeScan:
    """Return what a node keeps of a scan.

    Every few points (Mem/LaserScanDownsampleStepSize), of them one of each voxel of the base frame (Mem/LaserScanVoxelSize).
    Rays that met nothing are thinned by the step alone.
    """
    step = settings.laser_scan_downsample_step_size
    points, open_ends = scan.points, scan.open_ends
    if step > 1:
        points = np.ascontiguousarray(points[::step])
        open_ends = None if open_ends is None else np.ascontiguousarray(open_ends[::step])
    if settings.laser_scan_voxel_size > 0.0 and len(points):
        rows = voxel_filter(points.astype(np.float64), settings.laser_scan_voxel_size)
        points = np.ascontiguousarray(points[rows])
    if points is scan.points:
        return scan
    return dataclasses.replace(scan, points=points, open_ends=open_ends)
