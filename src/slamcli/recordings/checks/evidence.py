# SPDX-License-Identifier: MIT
"""What the checks judge: one pass over a recording, with what its sensors showed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import CameraModel, Image, ImuSample, LaserScan, Odometry, PointCloud
from slamcli.recordings.checks.image_evidence import ImageEvidence
from slamcli.recordings.checks.sweep_evidence import SweepEvidence
from slamcli.recordings.checks.turn_evidence import TurnsOfRobot, turns_of_robot
from slamcli.recordings.raw import Contents, Topic
from slamcli.recordings.recording import Recording
from slamcli.recordings.survey import Listener, TopicSurvey, survey

_PROFILES_PER_S = 2.0


@dataclass(slots=True)
class ScanEvidence:
    """What the scans of a topic showed."""

    beam_counts: Counter[int] = field(default_factory=Counter)
    first_change_ns: int | None = None
    """Stamp of the first scan with another number of beams than the first."""
    num_misfit: int = 0
    """Scans whose angle_max is off by more than one and a half beams."""
    first_misfit_ns: int | None = None
    misfit_beams: float = 0.0
    num_readings: int = 0
    num_infinite: int = 0
    num_nan: int = 0
    num_zero: int = 0
    num_below: int = 0
    num_at_max: int = 0
    num_beyond: int = 0
    largest_m: float = 0.0
    profiles: list[tuple[int, LaserScan]] = field(default_factory=list)
    """About two scans a second, for comparing their rotation with the odometry's."""

    def see(self, message: Any, scan: LaserScan) -> None:
        """Take a scan in."""
        if self.beam_counts and scan.num_beams not in self.beam_counts and self.first_change_ns is None:
            self.first_change_ns = scan.stamp_ns
        self.beam_counts[scan.num_beams] += 1
        off = _misfit_beams(message, scan.num_beams)
        if off > 1.5:
            self.num_misfit += 1
            if self.first_misfit_ns is None:
                self.first_misfit_ns, self.misfit_beams = scan.stamp_ns, off
        ranges = scan.ranges_m
        finite = ranges[np.isfinite(ranges)]
        self.num_readings += len(ranges)
        self.num_infinite += int(np.count_nonzero(np.isinf(ranges)))
        self.num_nan += int(np.count_nonzero(np.isnan(ranges)))
        self.num_zero += int(np.count_nonzero(finite <= 0))
        self.num_below += int(np.count_nonzero((finite > 0) & (finite < np.float32(scan.range_min_m))))
        self.num_at_max += int(np.count_nonzero(finite == np.float32(scan.range_max_m)))
        self.num_beyond += int(np.count_nonzero(finite > np.float32(scan.range_max_m)))
        self.largest_m = max(self.largest_m, float(finite.max(initial=0.0)))
        if not self.profiles or scan.stamp_ns - self.profiles[-1][0] >= 1e9 / _PROFILES_PER_S:
            self.profiles.append((scan.stamp_ns, scan))
            if len(self.profiles) > 4000:
                del self.profiles[1::2]


def _misfit_beams(message: Any, num_beams: int) -> float:
    """Return by how many beams angle_max is off."""
    increment = float(message.angle_increment)
    if increment == 0.0 or num_beams < 2:
        return 0.0
    return abs((float(message.angle_max) - float(message.angle_min)) / increment - (num_beams - 1))


@dataclass(slots=True)
class ImuEvidence:
    """What an IMU measured."""

    acceleration: list[float] = field(default_factory=list)
    """Magnitude of each specific force."""
    rotation: list[float] = field(default_factory=list)
    """Magnitude of each angular velocity."""
    stamps: list[int] = field(default_factory=list)

    def see(self, _message: Any, sample: ImuSample) -> None:
        """Take a sample in."""
        self.acceleration.append(math.hypot(*sample.acceleration_m_s2.tolist()))
        self.rotation.append(math.hypot(*sample.angular_rad_s.tolist()))
        self.stamps.append(sample.stamp_ns)


@dataclass(slots=True)
class OdometryEvidence:
    """Where the odometry was."""

    stamps: list[int] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)

    def see(self, _message: Any, odometry: Odometry) -> None:
        """Take a pose in."""
        self.stamps.append(odometry.stamp_ns)
        x, y, yaw = odometry.pose_se2.tolist()
        self.poses.append((x, y, yaw))


@dataclass(slots=True)
class CameraEvidence:
    """What the CameraInfo of a topic said."""

    first: CameraModel | None = None
    num_changes: int = 0
    first_change_ns: int | None = None

    def see(self, _message: Any, model: CameraModel) -> None:
        """Take a calibration in."""
        first = self.first = self.first or model
        same = (model.width, model.height) == (first.width, first.height) and np.array_equal(
            model.intrinsics, first.intrinsics
        )
        if not same:
            self.num_changes += 1
            self.first_change_ns = self.first_change_ns or model.stamp_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """Everything that the checks judge."""

    contents: Contents
    surveys: dict[str, TopicSurvey]
    frames: FrameTree
    scans: dict[str, ScanEvidence]
    imus: dict[str, ImuEvidence]
    odometry: dict[str, OdometryEvidence]
    cameras: dict[str, CameraEvidence]
    images: dict[str, ImageEvidence]
    sweeps: dict[str, SweepEvidence] = field(default_factory=dict)
    """Of scanners and of sensors of clouds."""
    slashed: dict[str, str] = field(default_factory=dict)
    """Frames that a sensor's messages name with a leading slash, by topic."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """What decoding counted."""
    turns: TurnsOfRobot | None = None
    """How the scans and the odometry saw the robot turn, where there are both and their clocks run forwards."""
    time_offsets_ns: Mapping[str, int] = field(default_factory=dict)
    """Offsets that are applied already."""
    unused_mends: tuple[str, ...] = ()
    """Mends that changed nothing."""
    laser_placed: bool = False
    """Whether ``--laser-pose`` says where the scanner sits."""

    def of(self, kind: type) -> dict[str, TopicSurvey]:
        """Return the surveys of topics that decode to a measurement type and hold messages."""
        return {
            name: found
            for name, found in self.surveys.items()
            if found.adapter is not None and found.adapter.produces is kind and found.num > 0
        }


def gather(recording: Recording) -> Evidence:
    """Read a recording to its end and return the evidence."""
    kinds: dict[type, dict[type, dict[str, Any]]] = {
        LaserScan: {ScanEvidence: {}, SweepEvidence: {}},
        PointCloud: {SweepEvidence: {}},
        ImuSample: {ImuEvidence: {}},
        Odometry: {OdometryEvidence: {}},
        CameraModel: {CameraEvidence: {}},
    }
    slashed: dict[str, str] = {}

    def listeners(stores: dict[type, dict[str, Any]]) -> Callable[[Topic], Listener]:
        def make(topic: Topic) -> Listener:
            for kind, store in stores.items():
                store[topic.name] = kind()
            seers = [store[topic.name].see for store in stores.values()]

            def see(message: Any, measurement: Any) -> None:
                for seer in seers:
                    seer(message, measurement)
                if message.header.frame_id.startswith("/"):
                    slashed.setdefault(topic.name, message.header.frame_id)

            return see

        return make

    images: dict[str, ImageEvidence] = {}

    def watch(topic: Topic) -> ImageEvidence:
        return images.setdefault(topic.name, ImageEvidence.of(topic))

    surveys = survey(
        recording,
        listeners={kind: listeners(stores) for kind, stores in kinds.items()},
        watchers={Image: watch},
    )
    return Evidence(
        frames=recording.frames(),
        contents=recording.contents,
        surveys=surveys,
        scans=kinds[LaserScan][ScanEvidence],
        imus=kinds[ImuSample][ImuEvidence],
        odometry=kinds[Odometry][OdometryEvidence],
        cameras=kinds[CameraModel][CameraEvidence],
        images={name: seen for name, seen in images.items() if seen.num},
        sweeps={**kinds[LaserScan][SweepEvidence], **kinds[PointCloud][SweepEvidence]},
        slashed=slashed,
        counts=dict(recording.log.counts),
        turns=turns_of_robot(recording, kinds[Odometry][OdometryEvidence]),
        time_offsets_ns=recording.mends.time_offsets_ns,
        unused_mends=recording.unused_mends(),
        laser_placed=recording.mends.laser_pose is not None,
    )
