# SPDX-License-Identifier: MIT
"""From images, and the odometry and scans that come with them, to moments with a pose by odometry."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.geometry import se3
from slamcli.mapper import Setup
from slamcli.measurements import Image, LaserScan, Measurement, Odometry, PointCloud, RgbdFrame, StereoPair
from slamcli.rtabmap.feature_extraction import FeatureExtractor
from slamcli.rtabmap.given_odometry import GivenOdometry, motion_covariance
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.node_scans import node_scan
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.preparing import preparation_settings
from slamcli.rtabmap.signature import NodeImages, NodeScan
from slamcli.rtabmap.visual_odometry import VisualOdometry
from slamcli.vision.features import Features
from slamcli.vision.preparation import Preparation, PreparedFrame

Floats = NDArray[np.float64]

_AHEAD = 4
"""Frames whose features are found before the oldest one is taken."""
_LATEST_SCAN_NS = 200_000_000
"""A scan farther in time from an image than this is of another place."""


class VisualFront:
    """Finds features on another thread, and hands out frames in their order as soon as their odometry is known."""

    def __init__(self, parameters: RtabmapParameters, setup: Setup, *, own_odometry: bool, scans: bool) -> None:
        if setup.rig is None:
            raise UsageError("rtabmap: there are no cameras to see with")
        self.preparation = Preparation(setup.rig, preparation_settings(parameters))
        weight = parameters.slamcli.depth_weight if setup.rig.mode == "rgbd" else 1.0
        self.camera = replace(self.preparation.camera, depth_weight=weight)
        self._extractor = FeatureExtractor(parameters, self.preparation)
        self._setup = setup
        self._workers = ThreadPoolExecutor(1) if setup.jobs > 1 else None
        self._waiting: deque[_Waiting] = deque()
        self._given = None if own_odometry else GivenOdometry(planar=parameters.reg.force_3dof)
        self._visual = (
            VisualOdometry(parameters, self.camera, self.preparation.T_base_camera, seed=setup.seed, log=setup.log)
            if own_odometry
            else None
        )
        self._last: Floats | None = None
        self._scans: deque[tuple[int, NodeScan]] | None = deque() if scans else None

    def take(self, measurement: Measurement) -> Iterator[Moment]:
        """Take the next measurement; yield the frames that are ready."""
        if isinstance(measurement, (StereoPair, RgbdFrame, Image)):
            self._waiting.append(_Waiting(measurement.stamp_ns, self._submit(measurement)))
        elif isinstance(measurement, Odometry) and self._given is not None:
            self._given.add(measurement)
        elif isinstance(measurement, (LaserScan, PointCloud)) and self._scans is not None:
            mount = self._setup.T_base_laser[measurement.topic]
            self._scans.append((measurement.stamp_ns, node_scan(measurement, mount, self._setup.no_return)))
        while self._waiting and self._ready(self._waiting[0].stamp_ns):
            yield self._moment(self._waiting.popleft())

    def finish(self) -> Iterator[Moment]:
        """Yield the frames that still waited for something later."""
        while self._waiting:
            yield self._moment(self._waiting.popleft())
        if self._workers is not None:
            self._workers.shutdown()

    def images(self, prepared: PreparedFrame) -> NodeImages:
        """Return what a node keeps of a frame."""
        seen = self.preparation.through_pinhole(prepared)
        return NodeImages(
            colour=seen.grey if seen.colour is None else seen.colour, camera=self.preparation.camera,
            T_base_camera=self.preparation.T_base_camera, depth=seen.depth, right=seen.right,
        )  # fmt: skip

    def refined(self) -> tuple[NDArray[np.int64], Floats] | None:
        """Return stamps (F,) and poses T_odom_base (F, 4, 4) as own odometry knows them in the end; None for given odometry."""
        return None if self._visual is None else self._visual.track()

    def _submit(self, measurement: Measurement) -> Future[_Seen] | _Done:
        if self._workers is None:
            return _Done(self._see(measurement))
        return self._workers.submit(self._see, measurement)

    def _see(self, measurement: Measurement) -> _Seen:
        prepared = self.preparation.prepare(measurement)
        return _Seen(prepared, self._extractor.extract(prepared))

    def _ready(self, stamp_ns: int) -> bool:
        """Return whether a frame can be handed out: enough are looked at ahead, and nothing that belongs to it is yet to come."""
        if self._given is not None and not self._given.covers(stamp_ns):
            return False
        if self._scans is not None and not (self._scans and self._scans[-1][0] >= stamp_ns):
            return False
        return self._workers is None or len(self._waiting) > _AHEAD

    def _moment(self, waiting: _Waiting) -> Moment:
        seen = waiting.seen.result()
        step = self._given_step(waiting.stamp_ns) if self._visual is None else self._own_step(waiting.stamp_ns, seen)
        return Moment(
            step=step, features=seen.features, prepared=seen.prepared, scan=self._scan_at(waiting.stamp_ns)
        )

    def _own_step(self, stamp_ns: int, seen: _Seen) -> OdometryStep:
        if self._visual is None:
            raise UsageError("rtabmap: no visual odometry runs here")
        return self._visual.step(stamp_ns, seen.features, None)

    def _given_step(self, stamp_ns: int) -> OdometryStep:
        pose = None if self._given is None else self._given.at(stamp_ns)
        if pose is None:
            return OdometryStep(stamp_ns=stamp_ns, T_odom_base=None, covariance=np.zeros((6, 6)))
        motion = np.eye(4) if self._last is None else se3.inverse(self._last) @ pose
        self._last = pose
        return OdometryStep(stamp_ns=stamp_ns, T_odom_base=pose, covariance=motion_covariance(motion))

    def _scan_at(self, stamp_ns: int) -> NodeScan | None:
        """Return the scan that is nearest in time, moved to where the robot was at the stamp."""
        if not self._scans:
            return None
        while len(self._scans) > 1 and self._scans[1][0] <= stamp_ns:
            self._scans.popleft()
        taken_ns, scan = min(list(self._scans)[:2], key=lambda entry: abs(entry[0] - stamp_ns))
        if abs(taken_ns - stamp_ns) > _LATEST_SCAN_NS:
            return None
        then = None if self._given is None else self._given.at(taken_ns)
        now = None if self._given is None else self._given.at(stamp_ns)
        return scan if then is None or now is None else scan.moved(se3.inverse(now) @ then)


@dataclass(frozen=True, slots=True)
class _Seen:
    prepared: PreparedFrame
    features: Features


class _Done:
    """What is there already, in the place of what another thread makes."""

    def __init__(self, seen: _Seen) -> None:
        self._seen = seen

    def result(self) -> _Seen:
        """Return it."""
        return self._seen


@dataclass(frozen=True, slots=True)
class _Waiting:
    stamp_ns: int
    seen: Future[_Seen] | _Done
