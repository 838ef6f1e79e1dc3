# SPDX-License-Identifier: MIT
"""From range sensors alone to moments with a pose, as the recording is read: clouds in space, or odometry that is given."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.geometry import se3
from slamcli.mapper import Setup
from slamcli.measurements import LaserScan, Measurement, Odometry, PointCloud
from slamcli.rtabmap.cloud_odometry import CloudOdometry, CloudOdometrySettings
from slamcli.rtabmap.given_odometry import GivenOdometry, motion_covariance
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.node_scans import node_scan, sweep_ns
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.sightless_front import SightlessFront
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]


class RangeFront(SightlessFront):
    """Hands out scans and clouds in their order, as soon as the odometry that belongs to them is known."""

    def __init__(self, parameters: RtabmapParameters, setup: Setup) -> None:
        planar = parameters.reg.force_3dof
        self._setup, self._icp = setup, parameters.icp
        self._deskews = parameters.odom.deskewing
        self._given = GivenOdometry(planar=planar and parameters.rgbd.force_odom_3dof)
        """Of the recording: all there is, or what guides the alignment of clouds; empty where there is none."""
        is_given = parameters.slamcli.odometry == "recording"
        if planar and not is_given:
            raise UsageError(
                "slamcli.odometry scan aligns clouds in space; with Reg/Force3DoF planar scans are what it needs"
            )
        self._odometry = None if is_given else CloudOdometry(CloudOdometrySettings.of(parameters))
        self._waiting: deque[LaserScan | PointCloud] = deque()
        self._last: Floats | None = None

    def take(self, measurement: Measurement) -> Iterator[Moment]:
        """Take the next measurement; yield the scans that are ready."""
        if isinstance(measurement, Odometry):
            self._given.add(measurement)
        elif isinstance(measurement, (LaserScan, PointCloud)):
            if measurement.topic not in self._setup.T_base_laser:
                raise UsageError(
                    f"the mount of the sensor on topic {measurement.topic!r} is unknown: give --laser-pose x,y,yaw"
                )
            self._waiting.append(measurement)
        while self._waiting and self._ready(self._waiting[0]):
            yield self._moment(self._waiting.popleft())

    def finish(self) -> Iterator[Moment]:
        """Yield the scans that still waited for something later."""
        while self._waiting:
            yield self._moment(self._waiting.popleft())
        if self._odometry is not None and self._odometry.num_lost:
            log = self._setup.log
            log.counts["clouds without odometry"] += self._odometry.num_lost
            log.counts["resets of the odometry"] += self._odometry.num_resets

    def why_nothing(self) -> str:
        """Return in words why no node was made."""
        if self._odometry is None:
            return "the recording's odometry covers no scan: look at its stamps (slamcli doctor), or --set slamcli.odometry=scan"
        return (
            "no cloud with enough points was read: name the topic with --points-topic, or widen --start and --duration"
        )

    def _ready(self, scan: LaserScan | PointCloud) -> bool:
        """Return whether the odometry at a scan is known, or none will be."""
        end = scan.stamp_ns + (sweep_ns(scan) if self._odometry is None else 0)
        return self._given.covers(end) or (self._odometry is not None and not len(self._given))

    def _moment(self, scan: LaserScan | PointCloud) -> Moment:
        mount = self._setup.T_base_laser[scan.topic]
        now = self._given.at(scan.stamp_ns)
        motion = None if now is None or self._last is None else se3.inverse(self._last) @ now
        self._last = now
        if self._odometry is not None and isinstance(scan, PointCloud):
            step, seen = self._odometry.step(scan, mount, motion, self._setup.no_return)
            return Moment(step=step, scan=seen)
        if now is None:
            step = OdometryStep(stamp_ns=scan.stamp_ns, T_odom_base=None, covariance=np.zeros((6, 6)))
        else:
            covariance = np.zeros((6, 6)) if motion is None else motion_covariance(motion)
            step = OdometryStep(stamp_ns=scan.stamp_ns, T_odom_base=now, covariance=covariance)
        return Moment(step=step, scan=self._seen(scan, mount, now))

    def _seen(self, scan: LaserScan | PointCloud, mount: Floats, begin: Floats | None) -> NodeScan:
        """Return a scan freed of the motion that the recording's odometry tells."""
        end = self._given.at(scan.stamp_ns + sweep_ns(scan)) if self._deskews else None
        moved = None if begin is None or end is None else se3.inverse(begin) @ end
        return node_scan(
            scan, mount, self._setup.no_return, T_begin_end=moved, range_min_m=self._icp.range_min,
            range_max_m=self._icp.range_max,
        )  # fmt: skip
