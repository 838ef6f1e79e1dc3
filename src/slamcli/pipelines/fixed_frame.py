# SPDX-License-Identifier: MIT
"""Poses in a frame that is fixed to the earth: of satellite receivers, or as another system tells them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from slamcli.geometry.earth import LocalPlane
from slamcli.measurements import GeoFix, StampedPose
from slamcli.runtime import RunLog

FRAME = "earth_plane"
"""Name of the plane that touches the earth at the first fix."""


class FixedFrame:
    """Turns fixes into poses of the antenna in the plane that touches the earth at the first of them."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self._plane: LocalPlane | None = None
        self._altitude_m = 0.0

    def poses(self, measurement: GeoFix | StampedPose) -> Iterator[StampedPose]:
        """Yield the pose that a fix tells, none for a message without a fix; a pose comes out as it is.

        x points east, y north and z up. A receiver does not tell how it is turned: the orientation is the identity and
        its variance infinite. The variances of a position that are not told are NaN. Where a fix has no altitude it is
        that of the plane.
        """
        if isinstance(measurement, GeoFix):
            if not measurement.has_fix:
                self._log.counts[f"{measurement.topic}: messages without a fix"] += 1
                return
            yield self._pose(measurement)
        else:
            yield StampedPose(
                stamp_ns=measurement.stamp_ns,
                frame_id=measurement.frame_id,
                position_m=measurement.position_m,
                quat_xyzw=measurement.quat_xyzw,
                child_frame_id=measurement.child_frame_id,
                covariance=measurement.covariance,
                topic=measurement.topic,
            )

    def _pose(self, fix: GeoFix) -> StampedPose:
        told = math.isfinite(fix.altitude_m)
        if self._plane is None:
            self._altitude_m = fix.altitude_m if told else 0.0
            self._plane = LocalPlane(fix.latitude_deg, fix.longitude_deg, self._altitude_m)
        altitude_m = fix.altitude_m if told else self._altitude_m
        covariance = np.diag([math.nan, math.nan, math.nan, math.inf, math.inf, math.inf])
        if fix.covariance_m2 is not None:
            covariance[:3, :3] = fix.covariance_m2
        return StampedPose(
            stamp_ns=fix.stamp_ns,
            frame_id=FRAME,
            child_frame_id=fix.frame_id,
            position_m=self._plane.position(fix.latitude_deg, fix.longitude_deg, altitude_m),
            quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
            covariance=covariance,
            topic=fix.topic,
        )
