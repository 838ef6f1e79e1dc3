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
from slamcli.rtabmap.cloud_odometry import CloudOdometry, CloudOdometrySettings
from slamcli.rtabmap.feature_extraction import FeatureExtractor
from slamcli.rtabmap.front_gaps import FrontGaps
from slamcli.rtabmap.given_odometry import LONGEST_GAP_NS, GivenOdometry, motion_covariance
from slamcli.rtabmap.guided_odometry import GuidedOdometry
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.node_scans import node_scan, sweep_ns
from slamcli.rtabmap.odometry_settings import odometry_settings
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.settings import feature_settings, preparation_settings, word_settings, words_are_odometrys
from slamcli.rtabmap.signature import NodeImages, NodeScan, no_features
from slamcli.rtabmap.swept_odometry import SweptOdometry
from slamcli.rtabmap.visual_odometry import VisualOdometry
from slamcli.vision.features import Features
from slamcli.vision.preparation import Preparation, PreparedFrame

Floats = NDArray[np.float64]

_AHEAD = 4
"""Frames whose features are found before the oldest one is taken, with any number of threads: what is known by then is the same."""
_LOST_UNTIL_ANEW = 3
"""Frames in a row that show nothing known before the local map begins anew where the wheels say the robot is."""
_LATEST_SCAN_NS = 200_000_000
"""A scan farther in time from an image than this is of another place."""


class VisualFront:
    """Finds features on another thread, and hands out frames in their order as soon as their odometry is known."""

    def __init__(self, parameters: RtabmapParameters, setup: Setup) -> None:
        if setup.rig is None:
            raise UsageError("rtabmap: there are no cameras to see with")
        self.preparation = Preparation(setup.rig, preparation_settings(parameters, setup.rig))
        words = FeatureExtractor(word_settings(parameters), self.preparation)
        is_given = parameters.slamcli.odometry in ("recording", "scan")
        self._extractor = words if is_given else FeatureExtractor(feature_settings(parameters), self.preparation)
        self._words = None if is_given or words_are_odometrys(parameters) else words
        """What finds the key points of nodes where those of odometry are others."""
        self.camera = self._extractor.camera
        self._setup = setup
        self._workers = ThreadPoolExecutor(1) if setup.jobs > 1 else None
        self._waiting: deque[_Waiting] = deque()
        flat = parameters.reg.force_3dof and parameters.rgbd.force_odom_3dof
        self._given = GivenOdometry(planar=flat)
        """Of the recording: all there is, or a guide for visual odometry; empty where there is none."""
        self._swept = _swept_odometry(parameters, setup, self._given)
        self._asks_wheels = parameters.slamcli.odometry != "visual"
        self._visual = None if is_given else self._visual_odometry(parameters)
        self._deskews = parameters.odom.deskewing
        self._last: Floats | None = None
        self._scans: deque[tuple[int, NodeScan]] | None = deque() if setup.T_base_laser else None
        self._newest_ns: int | None = None
        """Stamp of the newest frame or scan."""
        self._gaps = FrontGaps(setup.log, scans=self._scans is not None)

    def _visual_odometry(self, parameters: RtabmapParameters) -> GuidedOdometry:
        tracking = odometry_settings(parameters, self._extractor.settings.scales, self._setup.seed)
        if self._asks_wheels:  # they know where a new local map begins
            soon = min(tracking.reset_countdown or _LOST_UNTIL_ANEW, _LOST_UNTIL_ANEW)
            tracking = replace(tracking, reset_countdown=soon)
        return GuidedOdometry(VisualOdometry(tracking, self.camera, self.preparation.T_base_camera), self._given)

    @property
    def T_base_camera(self) -> Floats:  # noqa: N802 - frames stand in names
        """Pose of the ideal camera in the base frame, float64 (4, 4)."""
        return self.preparation.T_base_camera

    def take(self, measurement: Measurement) -> Iterator[Moment]:
        """Take the next measurement; yield the frames that are ready."""
        if isinstance(measurement, (StereoPair, RgbdFrame, Image)):
            self._waiting.append(_Waiting(measurement.stamp_ns, self._submit(measurement)))
            self._newest_ns = measurement.stamp_ns
        elif isinstance(measurement, Odometry) and self._asks_wheels:
            self._given.add(measurement)
        elif isinstance(measurement, (LaserScan, PointCloud)) and self._scans is not None:
            self._scans.append((measurement.stamp_ns, self._seen_by(measurement)))
            self._newest_ns = measurement.stamp_ns
            self._gaps.see_scan(measurement.stamp_ns)
        while self._waiting and self._ready(self._waiting[0].stamp_ns):
            yield self._moment(self._waiting.popleft())

    def finish(self) -> Iterator[Moment]:
        """Yield the frames that still waited for something later."""
        while self._waiting:
            yield self._moment(self._waiting.popleft())
        if self._workers is not None:
            self._workers.shutdown()
        self._gaps.tell()
        if self._swept is not None and self._swept.num_lost:
            self._setup.log.counts["clouds without odometry"] += self._swept.num_lost
            self._setup.log.warn(f"{self._swept.num_lost} clouds did not fit the ones before: they have no odometry")

    def images(self, prepared: PreparedFrame) -> NodeImages:
        """Return what a node keeps of a frame."""
        seen = self.preparation.through_pinhole(prepared)
        return NodeImages(
            colour=seen.grey if seen.colour is None else seen.colour, camera=self.preparation.camera,
            T_base_camera=self.preparation.T_base_camera, depth=seen.depth, right=seen.right,
        )  # fmt: skip

    def node_features(self, moment: Moment) -> Features:
        """Return the key points that a node keeps of a frame."""
        if moment.features is None or moment.prepared is None:
            return no_features()
        return moment.features if self._words is None else self._words.extract(moment.prepared)

    def points(self, features: Features) -> Floats:
        """Return where key points lie, (N, 3), metres, base frame; NaN where unknown."""
        seen = self.camera.back_project(features.pixels, features.depth)
        T = self.preparation.T_base_camera
        return seen @ T[:3, :3].T + T[:3, 3]

    def why_nothing(self) -> str:
        """Return in words why no node was made."""
        if self._swept is not None:
            return "no cloud could be placed near an image: look at their stamps (slamcli doctor), or --mode scan"
        if self._visual is None:
            return "the recording's odometry covers no image: look at its stamps (slamcli doctor), or --odom-topic none"
        return "no image has enough key points with known depth to begin with (Vis/MinInliers)"

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
        """Return whether a frame can be handed out: enough are looked at ahead, and nothing that belongs to it is yet to come.

        What pauses is not waited for: frames would pile up.
        """
        if len(self._waiting) <= _AHEAD or self._newest_ns is None:
            return False
        waited_ns = self._newest_ns - stamp_ns
        poses = self._given if self._swept is None else self._swept
        if self._asks_wheels and waited_ns <= LONGEST_GAP_NS and not poses.covers(stamp_ns):
            return False
        return (
            self._scans is None
            or waited_ns > _LATEST_SCAN_NS
            or (len(self._scans) > 0 and self._scans[-1][0] >= stamp_ns)
        )

    def _moment(self, waiting: _Waiting) -> Moment:
        seen = waiting.seen.result()
        step = self._given_step(waiting.stamp_ns) if self._visual is None else self._own_step(waiting.stamp_ns, seen)
        scan = self._scan_at(waiting.stamp_ns)
        carried = self._visual is not None and self._visual.is_carried(waiting.stamp_ns)
        self._gaps.see_frame(
            waiting.stamp_ns, lost=step.T_odom_base is None, carried=carried, has_scan=scan is not None
        )
        return Moment(step=step, features=seen.features, prepared=seen.prepared, scan=scan)

    def _own_step(self, stamp_ns: int, seen: _Seen) -> OdometryStep:
        if self._visual is None:
            raise UsageError("rtabmap: no visual odometry runs here")
        return self._visual.step(stamp_ns, seen.features)

    def _given_step(self, stamp_ns: int) -> OdometryStep:
        if self._swept is not None:
            return self._swept.step(stamp_ns)
        pose = self._given.at(stamp_ns)
        if pose is None:
            return OdometryStep(stamp_ns=stamp_ns, T_odom_base=None, covariance=np.zeros((6, 6)))
        motion = np.eye(4) if self._last is None else se3.inverse(self._last) @ pose
        self._last = pose
        return OdometryStep(stamp_ns=stamp_ns, T_odom_base=pose, covariance=motion_covariance(motion))

    def _seen_by(self, sweep: LaserScan | PointCloud) -> NodeScan:
        """Return a scan or cloud in the base frame, freed of the motion while it was measured."""
        mount = self._setup.T_base_laser[sweep.topic]
        if self._swept is not None and isinstance(sweep, PointCloud):
            return self._swept.take(sweep, mount)
        return node_scan(sweep, mount, self._setup.no_return, T_begin_end=self._motion_of(sweep))

    def _motion_of(self, sweep: LaserScan | PointCloud) -> Floats | None:
        """Return how the base moved while a sweep was measured, by the recording's odometry; None where that is not known."""
        if not self._deskews:
            return None
        begin, end = self._given.at(sweep.stamp_ns), self._given.at(sweep.stamp_ns + sweep_ns(sweep))
        return None if begin is None or end is None else se3.inverse(begin) @ end

    def _scan_at(self, stamp_ns: int) -> NodeScan | None:
        """Return the scan that is nearest in time, moved to where the robot was at the stamp."""
        if not self._scans:
            return None
        while len(self._scans) > 1 and self._scans[1][0] <= stamp_ns:
            self._scans.popleft()
        taken_ns, scan = min(list(self._scans)[:2], key=lambda entry: abs(entry[0] - stamp_ns))
        if abs(taken_ns - stamp_ns) > _LATEST_SCAN_NS:
            return None
        poses = self._given if self._swept is None else self._swept
        then, now = poses.at(taken_ns), poses.at(stamp_ns)
        return scan if then is None or now is None else scan.moved(se3.inverse(now) @ then)


def _swept_odometry(parameters: RtabmapParameters, setup: Setup, wheels: GivenOdometry) -> SweptOdometry | None:
    """Return the odometry of clouds where that is asked for.

    Raises
    ------
    UsageError
        If there are no clouds in space: planar scans are aligned all at once, when no image is at hand any more.
    """
    if parameters.slamcli.odometry != "scan":
        return None
    if parameters.reg.force_3dof or not setup.T_base_laser:
        raise UsageError(
            "slamcli.odometry scan beside images needs 3D clouds: --mode scan, or --set slamcli.odometry=guided, visual or recording"
        )
    return SweptOdometry(CloudOdometry(CloudOdometrySettings.of(parameters)), wheels, setup.no_return)


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
