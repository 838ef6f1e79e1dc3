# SPDX-License-Identifier: MIT
"""The gmapping tier: scans and odometry in, the best particle's map and trajectory out."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, UsageError
from slamcli.geometry import se2
from slamcli.gmapping.beams import BeamModel
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.gmapping.particle_filter import ParticleFilter
from slamcli.grids import OccupancyGrid
from slamcli.grids.tiles import TiledMaps
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import LaserScan, Measurement, Odometry
from slamcli.registration.laser_odometry import LaserOdometry, tells_sweep
from slamcli.registration.scan_odometry import ScanStep
from slamcli.trajectory import Trajectory
from slamcli.trajectory.bending import between_updates, moved_scans
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
            drawn = (
                indices
                if self._parameters.map_scans == "processed"
                else moved_scans(poses, every=self._parameters.map_scans == "all")
            )
            grid = self._final_map(drawn, poses[drawn], laser, motions)
        trajectory = Trajectory.from_se2(
            [s.stamp_ns for s in self._scans], poses, self._setup.map_frame, self._setup.base_frame
        )
        self._report_fallbacks(particles)
        summary = self._summary(particles, offset, odometry_steps)
        return MappingResult(
            trajectory=trajectory, grid=grid, steps=self._columns(particles, odometry_steps), summary=summary
        )

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
        p, progress, stamps = self._parameters, self._setup.log.progress, laser.stamps_ns
        distance, turn, last = 0.0, 0.0, stamps[0]
        for k in range(len(stamps)):
            if k:
                particles.move(motions[k])
                distance += math.hypot(motions[k, 0], motions[k, 1])
                turn += abs(motions[k, 2])
            due = (
                distance >= p.linearUpdate
                or turn >= p.angularUpdate
                or (p.temporalUpdate >= 0 and (stamps[k] - last) / 1e9 > p.temporalUpdate)
            )
            if k and not due:
                continue
            particles.update(k, laser.beams(k, laser.twist(k, motions[k + 1 : k + 2])))
            distance, turn, last = 0.0, 0.0, stamps[k]
            progress.update((stamps[k] - stamps[0]) / 1e9)

    def _final_map(
        self,
        indices: NDArray[np.int64],
        path: NDArray[np.float64],
        laser: LaserOdometry,
        motions: NDArray[np.float64],
    ) -> OccupancyGrid:
        """Draw scans from their poses (K, 3) on the best particle's path into an empty map."""
        p = self._parameters
        x, y = path[0, :2]
        final = TiledMaps(1, p.delta, (x - 10.0, y - 10.0, x + 10.0, y + 10.0))
        for index, pose in zip(indices, path, strict=True):
            drawn = laser.beams(int(index), laser.twist(int(index), motions[index + 1 : index + 2]))
            final.add_scan(pose.reshape(1, 3), drawn.start, drawn.ends, drawn.hit)
        return final.occupancy(0, p.occ_thresh, self._setup.map_frame)

    def _report_fallbacks(self, particles: ParticleFilter) -> None:
        p, steps = self._parameters, particles.steps[1:]
        fallbacks = sum(step.fallbacks for step in steps)
        self._setup.log.counts["matches that fell back on odometry"] += fallbacks
        most = max((step.num_beams for step in steps), default=0)
        if steps and p.minimumScore >= most:
            self._setup.log.warn(
                f"minimumScore={p.minimumScore:g} cannot be reached: a score is at most the number of matched beams, here {most}; "
                f"every scan match was thrown away and the map rests on the motion between scans alone. Set minimumScore below {most} (0 to 50 is usual)"
            )
        elif fallbacks > 0.2 * sum(len(step.poses) for step in steps):
            self._setup.log.warn(
                f"{fallbacks} scan matches stayed below minimumScore={p.minimumScore:g} and fell back on odometry"
            )

    def _columns(self, particles: ParticleFilter, odometry_steps: list[ScanStep]) -> dict[str, NDArray[Any]]:
        steps = particles.steps
        index = np.array([step.index for step in steps], dtype=np.int64)
        disagreement = (
            np.array([step.disagreement for step in odometry_steps]) if odometry_steps else np.zeros(len(self._scans))
        )
        ends = np.append(index[1:], len(disagreement))
        return {
            "stamp_ns": np.array([self._scans[k].stamp_ns for k in index], dtype=np.int64),
            "scan_index": index,
            "neff": np.array([step.neff for step in steps]),
            "best_score": np.array([step.best_score for step in steps]),
            "log_likelihood": np.array([step.log_likelihood for step in steps]),
            "resampled": np.array([step.resampled for step in steps], dtype=np.int64),
            "fallbacks": np.array([step.fallbacks for step in steps], dtype=np.int64),
            "num_particles": np.array([len(step.poses) for step in steps], dtype=np.int64),
            "odometry_disagreement": np.array([disagreement[a:b].max() for a, b in zip(index, ends, strict=True)]),
        }

    def _summary(self, particles: ParticleFilter, offset: TimeOffset, odometry_steps: list[ScanStep]) -> dict[str, Any]:
        steps = particles.steps
        return {
            "scans": len(self._scans),
            "processed_scans": len(steps),
            "resamplings": sum(step.resampled for step in steps),
            "fallbacks": sum(step.fallbacks for step in steps),
            "time_offset_s": offset.seconds,
            "time_offset_scans": offset.num_scans,
            "wide_searches": sum(step.searched for step in odometry_steps),
            "mean_match_quality": float(np.mean([step.quality for step in odometry_steps])) if odometry_steps else None,
            "tiles": particles.maps.num_tiles,
        }
