# SPDX-License-Identifier: MIT
"""A measurement in a few words."""

from __future__ import annotations

import math
from functools import singledispatch
from typing import Any

from slamcli.measurements import (
    CameraModel,
    FrameTransform,
    GeoFix,
    Image,
    ImuSample,
    Landmarks,
    LaserScan,
    Odometry,
    PointCloud,
)
from slamcli.recordings.adapters import StampedGrid, StampedPath, StampedPoses, StampedText


@singledispatch
def describe(measurement: Any) -> str:  # noqa: ARG001
    """Return what a topic's first measurement shows, in a few words."""
    return ""


@describe.register
def _(scan: LaserScan) -> str:
    field = math.degrees(abs(scan.angle_increment_rad) * max(scan.num_beams - 1, 0))
    direction = ", clockwise" if scan.angle_increment_rad < 0 else ""
    return f"{scan.num_beams} beams over {field:.1f}°{direction}, {scan.range_min_m:.3g} to {scan.range_max_m:.4g} m"


@describe.register
def _(cloud: PointCloud) -> str:
    more = [name for name, held in (("times", cloud.offset_ns), ("intensities", cloud.intensities)) if held is not None]
    return f"{len(cloud.points_m)} points" + (f" with {' and '.join(more)}" if more else "")


@describe.register
def _(image: Image) -> str:
    height, width = image.pixels.shape[:2]
    return f"{width} x {height} {image.encoding}"


@describe.register
def _(sample: ImuSample) -> str:
    return "with orientation" if sample.quat_xyzw is not None else "without orientation"


@describe.register
def _(odometry: Odometry) -> str:
    return f"{odometry.frame_id} -> {odometry.child_frame_id or '?'}"


@describe.register
def _(transform: FrameTransform) -> str:
    return f"{transform.parent_frame_id} -> {transform.child_frame_id}, …"


@describe.register
def _(camera: CameraModel) -> str:
    k, p = camera.intrinsics, camera.projection
    distorted = f", {camera.distortion_model}" * bool(camera.distortion.any())
    shifted = f", baseline {-p[0, 3] / p[0, 0]:.3f} m" if p[0, 3] and p[0, 0] else ""
    size = f"{camera.width} x {camera.height}"
    return f"{size}, fx {k[0, 0]:.1f} fy {k[1, 1]:.1f} cx {k[0, 2]:.1f} cy {k[1, 2]:.1f}{distorted}{shifted}"


@describe.register
def _(fix: GeoFix) -> str:
    return f"{fix.latitude_deg:.5f}°, {fix.longitude_deg:.5f}°" if fix.has_fix else "no fix yet"


@describe.register
def _(landmarks: Landmarks) -> str:
    return f"{len(landmarks.observations)} landmarks"


@describe.register
def _(stamped: StampedGrid) -> str:
    return f"{stamped.grid.width} x {stamped.grid.height} cells of {stamped.grid.resolution_m:g} m"


@describe.register
def _(stamped: StampedPath) -> str:
    return f"{len(stamped.path)} poses"


@describe.register
def _(stamped: StampedPoses) -> str:
    return f"{len(stamped)} poses"


@describe.register
def _(stamped: StampedText) -> str:
    return stamped.text if len(stamped.text) <= 40 else f"{stamped.text[:39]}…"
