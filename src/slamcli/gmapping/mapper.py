# SPDX-License-Identifier: MIT
"""The gmapping tier: scans and odometry in, the best particle's map and trajectory out."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, UsageError
from slamcli.geometry import se2
from slamcli.gmapping.beams import BeamModel
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.gmapping.particle_filter import ParticleFilter
from slamcli.gmapping.result import final_map, report_fallbacks, step_columns, summary, track_of
from slamcli.gmapping.update_gate import UpdateGate
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import LaserScan, Measurement, Odometry
from slamcli.registration.laser_odometry import LaserOdometry, tells_sweep
from slamcli.registration.scan_odometry import ScanStep
from slamcli.trajectory import Trajectory
from slamcli.trajectory.bending import between_updates
from slamcli.trajectory.clocks import align_clocks
from slamcli.trajectory.time_offset import TimeOffset
from slamcli.trajectory.wheel_odometry import WheelOdometry, smooth_stamps

_LONGEST_OFFSET_S = 4e9  # a clock that began in 1970 against one that began now


class GmappingMapper:
    """Batch gmapping: collects what it is given, and works when the recording has ended.

    Knowing the whole recording first is what lets it estimate the offset between the clocks of laser and odometry. It
    keeps the ranges of all scans in memory, four bytes a beam.
    """

    def __init__(self, parameters: GmappingParameters, setup: Setup) -> None:
        self._parameters, self._setup = parameters, setup
        self._scans: list[LaserScan] = []
        self._skipped = 0
        self._odometry: list[Odometry] = []
        self._places: list[int] = []

    def process(self, measurement: Measurement) -> None:
        """Take the next scan or odometry message; anything else has no meaning here."""
        if isinstance(measurement, LaserScan):
            if self._skipped % self._parameters.throttle_scans == 0:
                self._scans.append(measurement)
            self._skipped += 1
        elif isinstance(measurement, Odometry):
            self._odometry.append(measurement)
            self._places.append(len(self._scans))

    def finish(self) -> MappingResult:
        """Run the filter over everything and return the best particle's map and trajectory."""
        if not self._scans:
            raise DataError("no laser scan was read: name the topic with --scan-topic, or widen --start and --duration")
        log = self._setup.log
        stamps, wheels = self._clocks()
        beams = self._beam_models()
        laser = self._laser(stamps, wheels, beams)
        offset = self._time_offset(laser)
        motions, odometry_steps = self._motions(laser, offset.seconds)
        with ThreadPoolExecutor(self._setup.jobs) as executor:
            first = wheels.at(stamps[:1] + round(offset.seconds * 1e9))[0] if wheels is not None else np.zeros(3)
            rng = np.random.default_rng(self._setup.seed)
            particles = ParticleFilter(self._parameters, rng, first, executor, self._setup.jobs)
            with log.stage("particle filter", (stamps[-1] - stamps[0]) / 1e9):
                self._filter(particles, laser, motions)
        indices, path = particles.best_path()
        poses = between_updates(motions, indices, path)
        with log.stage("final map"):
            grid = final_map(
                self._parameters, indices, poses,
                lambda k: laser.beams(k, laser.twist(k, motions[k + 1 : k + 2])), self._setup.map_frame,
            )  # fmt: skip
        stamps_ns = [scan.stamp_ns for scan in self._scans]
        trajectory = Trajectory.from_se2(stamps_ns, poses, self._setup.map_frame, self._setup.base_frame)
        report_fallbacks(self._parameters, particles, log)
        return MappingResult(
            trajectory=trajectory, grid=grid, steps=step_columns(particles, odometry_steps, stamps_ns),
            summary=summary(particles, offset, odometry_steps, len(stamps_ns)), particles=track_of(particles, stamps_ns),
        )  # fmt: skip

    def _clocks(self) -> tuple[NDArray[np.int64], WheelOdometry | None]:
        """Return increasing stamps of the scans, and the odometry with increasing stamps.

        Where a clock runs backwards again and again its stamps do not tell what came first; the recorded order does.
        """
        scans = np.array([scan.stamp_ns for scan in self._scans], dtype=np.int64)
        if not self._odometry:
            if not self._parameters.scan_odometry:
                raise UsageError(
                    "there is no odometry in the recording, and scan_odometry is false: nothing tells how the robot moved"
                )
            self._setup.log.warn("no odometry: the motion between scans comes from the scans alone")
            return smooth_stamps(scans), None
        odometry = np.array([sample.stamp_ns for sample in self._odometry], dtype=np.int64)
        poses = np.array([sample.pose_se2 for sample in self._odometry])
        stamps, wheels, by_order = align_clocks(scans, odometry, np.array(self._places), poses)
        if by_order:
            self._setup.log.note(
                "stamps run backwards again and again: the recorded order decides which odometry belongs to which scan"
            )
        return stamps, wheels

    def _laser(
        self, stamps: NDArray[np.int64], wheels: WheelOdometry | None, beams: dict[str, BeamModel]
    ) -> LaserOdometry:
        sweep_s = max(abs(scan.time_increment_s) * max(scan.num_beams - 1, 0) for scan in self._scans)
        return LaserOdometry(
            stamps_ns=stamps,
            beams=lambda k, twist: beams[self._scans[k].topic].beams(self._scans[k], twist),
            delta_m=self._parameters.delta,
            sweeps=self._parameters.deskew and tells_sweep(stamps, sweep_s, self._setup.log),
            log=self._setup.log,
            wheels=wheels,
        )

    def _beam_models(self) -> dict[str, BeamModel]:
        mounts = self._setup.T_base_laser
        missing = {scan.topic for scan in self._scans} - set(mounts)
        if missing:
            raise UsageError(
                f"the mount of the laser on topic {sorted(missing)[0]!r} is unknown: give --laser-pose x,y,yaw"
            )
        return {topic: BeamModel(self._parameters, mount, self._setup.no_return) for topic, mount in mounts.items()}

    def _time_offset(self, laser: LaserOdometry) -> TimeOffset:
        given, wheels = self._parameters.time_offset, laser.wheels
        if given != "auto" and abs(float(given)) > _LONGEST_OFFSET_S:
            raise UsageError(f"time_offset={given}: two clocks of one recording are not {float(given):g} s apart")
        if given != "auto" or wheels is None:
            return TimeOffset(0.0 if given == "auto" else float(given), 0.0, 0.0, 0)
        found = laser.time_offset()
        if found.seconds:
            self._setup.log.note(
                f"laser and odometry clocks differ: odometry is looked up {found.seconds:+.3f} s from each scan's stamp "
                f"(turns then agree within {math.degrees(found.error_after_rad):.2f} instead of "
                f"{math.degrees(found.error_before_rad):.2f} degrees); --set time_offset=SECONDS says otherwise"
            )
        return found

    def _motions(self, laser: LaserOdometry, offset_s: float) -> tuple[NDArray[np.float64], list[ScanStep]]:
        """Return the motion (N, 3) that leads to each scan from the one before, and how the scans were aligned."""
        if self._parameters.scan_odometry:
            return laser.motions(offset_s)
        assert laser.wheels is not None  # noqa: S101  (checked in _clocks)
        poses = laser.wheels.at(laser.stamps_ns + round(offset_s * 1e9))
        return np.vstack([np.zeros((1, 3)), se2.between(poses[:-1], poses[1:])]), []

    def _filter(
        self,
        particles: ParticleFilter,
        laser: LaserOdometry,
        motions: NDArray[np.float64],
    ) -> None:
        gate, stamps = UpdateGate(self._parameters), laser.stamps_ns
        for k in range(len(stamps)):
            if k:
                particles.move(motions[k])
            if not gate.takes(int(stamps[k]), motions[k]):
                continue
            particles.update(k, laser.beams(k, laser.twist(k, motions[k + 1 : k + 2])))
            self._setup.log.progress.update((stamps[k] - stamps[0]) / 1e9)
