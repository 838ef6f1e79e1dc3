# SPDX-License-Identifier: MIT
"""From range sensors alone to moments with a pose by odometry."""

from __future__ import annotations

from collections.abc import Iterator

from slamcli.mapper import Setup
from slamcli.measurements import LaserScan, Measurement, Odometry, PointCloud
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.scan_odometry import PlanarScanOdometry
from slamcli.rtabmap.settings import scan_odometry_settings
from slamcli.rtabmap.sightless_front import SightlessFront


class PlanarFront(SightlessFront):
    """Collects planar scans, and hands them out when the recording has ended and their odometry is known."""

    def __init__(self, parameters: RtabmapParameters, setup: Setup) -> None:
        self._odometry = PlanarScanOdometry(
            scan_odometry_settings(parameters, setup.no_return), setup.T_base_laser, setup.log
        )

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

    def why_nothing(self) -> str:
        """Return in words why no node was made."""
        return "no laser scan was read: name the topic with --scan-topic, or widen --start and --duration"
