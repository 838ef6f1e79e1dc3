# SPDX-License-Identifier: MIT
"""From range sensors alone to moments with a pose by odometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.mapper import Setup
from slamcli.measurements import LaserScan, Measurement, Odometry, PointCloud
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.scan_odometry import PlanarScanOdometry
from slamcli.rtabmap.settings import scan_odometry_settings
from slamcli.rtabmap.signature import NodeImages, no_features
from slamcli.vision.features import Features
from slamcli.vision.preparation import PreparedFrame

Floats = NDArray[np.float64]


class PlanarFront:
    """Collects planar scans, and hands them out when the recording has ended and their odometry is known."""

    def __init__(self, parameters: RtabmapParameters, setup: Setup) -> None:
        self._odometry = PlanarScanOdometry(
            scan_odometry_settings(parameters, setup.no_return), setup.T_base_laser, setup.log
        )

    @property
    def camera(self) -> None:
        """There is none."""

    @property
    def T_base_camera(self) -> Floats:  # noqa: N802 - frames stand in names
        """Of no camera: the base itself."""
        return np.eye(4)

    def take(self, measurement: Measurement) -> Iterator[Moment]:
        """Take the next measurement; nothing is ready before the end."""
        if isinstance(measurement, (LaserScan, PointCloud, Odometry)):
            self._odometry.add(measurement)
        return iter(())

    def finish(self) -> Iterator[Moment]:
        """Yield every scan in its order."""
        if not len(self._odometry):
            return
        track = self._odometry.solve()
        for k, step in enumerate(track.steps):
            yield Moment(step=step, scan=self._odometry.scan(k, track))

    def images(self, prepared: PreparedFrame) -> NodeImages:
        """There are none.

        Raises
        ------
        DataError
            Always.
        """
        raise DataError(f"frame at {prepared.stamp_ns} ns: this robot has no cameras")

    def node_features(self, moment: Moment) -> Features:  # noqa: ARG002
        """Return no key points: there are no images."""
        return no_features()

    def points(self, features: Features) -> Floats:
        """Return where key points lie: of none."""
        return np.full((len(features), 3), np.nan)

    def refined(self) -> None:
        """Return nothing: odometry was known at once."""
        return

    def why_nothing(self) -> str:
        """Return in words why no node was made."""
        return "no laser scan was read: name the topic with --scan-topic, or widen --start and --duration"
