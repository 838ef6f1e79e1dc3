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
from slamcli.gmapping import time_offset
from slamcli.gmapping.beams import BeamModel
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.gmapping.particle_filter import ParticleFilter
from slamcli.gmapping.scan_odometry import Pose, ScanOdometry, ScanStep, between
from slamcli.gmapping.wheel_odometry import WheelOdometry, smooth_stamps
from slamcli.grids import OccupancyGrid
from slamcli.grids.tiles import TiledMaps
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import LaserScan, Measurement, Odometry
from slamcli.trajectory import Trajectory

_TURNING_SCANS = 400
"""Scans during which the robot turned that the estimate of the clock offset rests on, where there are that many."""
_TRUSTED_QUALITY = 0.5
_SLIP_SIGMAS = 5.0
_DRAW_M, _DRAW_RAD = 0.2, 0.1
_LONGEST_PERIOD_S = 1.0
"""Time between two scans over which the motion does not tell the velocity during a sweep."""
_BAD_CLOCK = 0.01
"""Share of backward stamps from which on a clock is not believed."""
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
        self._sweeps = False

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
        self._sweeps = self._tells_sweep(stamps)
        offset = self._time_offset(stamps, wheels, beams)
        motions, odometry_steps = self._motions(stamps, wheels, beams, offset.seconds)
        with ThreadPoolExecutor(self._setup.jobs) as executor:
            first = wheels.at(stamps[:1] + round(offset.seconds * 1e9))[0] if wheels is not None else np.zeros(3)
            rng = np.random.default_rng(self._setup.seed)
            particles = ParticleFilter(self._parameters, rng, first, executor, self._setup.jobs)
            with log.stage("particle filter", (stamps[-1] - stamps[0]) / 1e9):
                self._filter(particles, stamps, motions, beams)
        indices, path = particles.best_path()
        poses = between_updates(motions, indices, path)
        with log.stage("final map"):
            drawn = (
                indices
                if self._parameters.map_scans == "processed"
                else moved_scans(poses, self._parameters.map_scans == "all")
            )
            grid = self._final_map(drawn, poses[drawn], stamps, motions, beams)
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
        if max(_share_backward(scans), _share_backward(odometry)) < _BAD_CLOCK:
            return smooth_stamps(scans), WheelOdometry(smooth_stamps(odometry), poses)
        places = np.array(self._places)
        both = smooth_stamps(np.insert(scans, places, odometry))
        is_odometry = np.insert(np.zeros(len(scans), np.bool_), places, True)
        self._setup.log.note(
            "stamps run backwards again and again: the recorded order decides which odometry belongs to which scan"
        )
        return both[~is_odometry], WheelOdometry(both[is_odometry], poses)

    def _tells_sweep(self, stamps: NDArray[np.int64]) -> bool:
        """Whether beams are to be deskewed: their times are there and fit between two scans."""
        sweep_s = max(abs(scan.time_increment_s) * max(scan.num_beams - 1, 0) for scan in self._scans)
        if not self._parameters.deskew or sweep_s == 0.0 or len(stamps) < 2:
            return False
        period_s = float(np.median(np.diff(stamps))) / 1e9
        if sweep_s > 1.1 * period_s:
            self._setup.log.warn(
                f"scans are {period_s:.3f} s apart, but by their time_increment a sweep takes {sweep_s:.3f} s: the robot's motion "
                "during a sweep is not corrected"
            )
            return False
        return True

    def _beam_models(self) -> dict[str, BeamModel]:
        mounts = self._setup.T_base_laser
        missing = {scan.topic for scan in self._scans} - set(mounts)
        if missing:
            raise UsageError(
                f"the mount of the laser on topic {sorted(missing)[0]!r} is unknown: give --laser-pose x,y,yaw"
            )
        return {topic: BeamModel(self._parameters, mount, self._setup.no_return) for topic, mount in mounts.items()}

    def _time_offset(
        self, stamps: NDArray[np.int64], wheels: WheelOdometry | None, beams: dict[str, BeamModel]
    ) -> time_offset.TimeOffset:
        given = self._parameters.time_offset
        if given != "auto" and abs(float(given)) > _LONGEST_OFFSET_S:
            raise UsageError(f"time_offset={given}: two clocks of one recording are not {float(given):g} s apart")
        if given != "auto" or wheels is None:
            return time_offset.TimeOffset(0.0 if given == "auto" else float(given), 0.0, 0.0, 0)
        log = self._setup.log
        with log.stage("clock offset"):
            found = self._estimate_offset(stamps, wheels, beams)
        if found.seconds:
            log.note(
                f"laser and odometry clocks differ: odometry is looked up {found.seconds:+.3f} s from each scan's stamp "
                f"(turns then agree within {math.degrees(found.error_after_rad):.2f} instead of "
                f"{math.degrees(found.error_before_rad):.2f} degrees); --set time_offset=SECONDS says otherwise"
            )
        return found

    def _estimate_offset(
        self, stamps: NDArray[np.int64], wheels: WheelOdometry, beams: dict[str, BeamModel]
    ) -> time_offset.TimeOffset:
        """Return the offset that the turns seen by the scans tell; hardly trusting the odometry while it is not known."""
        motions, steps = self._align_scans(stamps, wheels, beams, 0.0, enough_turns=_TURNING_SCANS)
        count = len(steps)
        trusted = np.array([step.quality > _TRUSTED_QUALITY for step in steps])[1:]
        return time_offset.estimate(stamps[:count], motions[1:count, 2], trusted, wheels)

    def _motions(
        self, stamps: NDArray[np.int64], wheels: WheelOdometry | None, beams: dict[str, BeamModel], offset_s: float
    ) -> tuple[NDArray[np.float64], list[ScanStep]]:
        """Return the motion (N, 3) that leads to each scan from the one before, and how the scans were aligned."""
        if not self._parameters.scan_odometry:
            assert wheels is not None  # noqa: S101  (checked in _clocks)
            poses = wheels.at(stamps + round(offset_s * 1e9))
            motions = np.vstack([np.zeros((1, 3)), se2.between(poses[:-1], poses[1:])])
            return motions, []
        with self._setup.log.stage("scan odometry", (stamps[-1] - stamps[0]) / 1e9):
            motions, steps = self._align_scans(stamps, wheels, beams, offset_s)
        if wheels is not None:
            self._report_slip(steps)
        return motions, steps

    def _align_scans(
        self,
        stamps: NDArray[np.int64],
        wheels: WheelOdometry | None,
        beams: dict[str, BeamModel],
        offset_s: float,
        enough_turns: int | None = None,
    ) -> tuple[NDArray[np.float64], list[ScanStep]]:
        """Align scans one after the other, all of them or until the robot has turned during `enough_turns` of them."""
        progress = self._setup.log.progress
        poses = None if wheels is None else wheels.at(stamps + round(offset_s * 1e9))
        odometry = ScanOdometry(self._parameters.delta)
        motions, steps = np.zeros((len(stamps), 3)), []
        turns, guess = 0, (0.0, 0.0, 0.0)
        for k, scan in enumerate(self._scans):
            before = odometry.pose
            if k and poses is not None:
                guess = between(_pose(poses[k - 1]), _pose(poses[k]))
            ahead = guess if poses is None or k + 1 == len(stamps) else between(_pose(poses[k]), _pose(poses[k + 1]))
            twist = self._twist(k, stamps, np.array([ahead]))
            known = poses is not None and enough_turns is None
            steps.append(odometry.step(beams[scan.topic].beams(scan, twist), guess, known=known))
            guess = between(before, odometry.pose)
            motions[k] = guess
            turns += abs(guess[2]) > math.radians(1.5) and steps[-1].quality > _TRUSTED_QUALITY
            if enough_turns is not None and turns >= enough_turns:
                break
            if k % 64 == 0:
                progress.update((stamps[k] - stamps[0]) / 1e9)
        return motions, steps

    def _filter(
        self,
        particles: ParticleFilter,
        stamps: NDArray[np.int64],
        motions: NDArray[np.float64],
        beams: dict[str, BeamModel],
    ) -> None:
        p, progress = self._parameters, self._setup.log.progress
        distance, turn, last = 0.0, 0.0, stamps[0]
        for k, scan in enumerate(self._scans):
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
            particles.update(k, beams[scan.topic].beams(scan, self._twist(k, stamps, motions[k + 1 : k + 2])))
            distance, turn, last = 0.0, 0.0, stamps[k]
            progress.update((stamps[k] - stamps[0]) / 1e9)

    def _twist(self, k: int, stamps: NDArray[np.int64], ahead: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the velocity (3,) during the sweep of scan k from the motion to the next one, `ahead` (1, 3) or (0, 3).

        None leaves the scan as it is.
        """
        if not self._sweeps or k + 1 >= len(stamps):
            return None
        seconds = (stamps[k + 1] - stamps[k]) / 1e9
        return ahead[0] / seconds if 1e-3 < seconds < _LONGEST_PERIOD_S else None

    def _final_map(
        self,
        indices: NDArray[np.int64],
        path: NDArray[np.float64],
        stamps: NDArray[np.int64],
        motions: NDArray[np.float64],
        beams: dict[str, BeamModel],
    ) -> OccupancyGrid:
        """Draw scans from their poses (K, 3) on the best particle's path into an empty map."""
        p = self._parameters
        x, y = path[0, :2]
        final = TiledMaps(1, p.delta, (x - 10.0, y - 10.0, x + 10.0, y + 10.0))
        for index, pose in zip(indices, path, strict=True):
            scan = self._scans[index]
            drawn = beams[scan.topic].beams(scan, self._twist(int(index), stamps, motions[index + 1 : index + 2]))
            final.add_scan(pose.reshape(1, 3), drawn.start, drawn.ends, drawn.hit)
        return final.occupancy(0, p.occ_thresh, self._setup.map_frame)

    def _report_slip(self, steps: list[ScanStep]) -> None:
        bad = [
            k for k, step in enumerate(steps) if step.disagreement > _SLIP_SIGMAS and step.quality > _TRUSTED_QUALITY
        ]
        self._setup.log.counts["scans that disagree with the odometry"] += len(bad)
        if bad:
            stamp = self._scans[bad[0]].stamp_ns
            self._setup.log.warn(
                f"scans and odometry disagree beyond the motion model at {len(bad)} of {len(steps)} scans, first at {stamp / 1e9:.3f} s "
                f"(slipping wheels, or clocks that differ); the scans were believed"
            )

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

    def _summary(
        self, particles: ParticleFilter, offset: time_offset.TimeOffset, odometry_steps: list[ScanStep]
    ) -> dict[str, Any]:
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


def moved_scans(poses: NDArray[np.float64], every: bool = False) -> NDArray[np.int64]:
    """Return the indices of `every` scan, or of those before which the robot moved or turned enough to see something new."""
    if every:
        return np.arange(len(poses))
    chosen, last = [0], poses[0]
    for k in range(1, len(poses)):
        dx, dy, turn = poses[k] - last
        if math.hypot(dx, dy) > _DRAW_M or abs(math.remainder(turn, math.tau)) > _DRAW_RAD:
            chosen.append(k)
            last = poses[k]
    return np.array(chosen, dtype=np.int64)


def between_updates(
    motions: NDArray[np.float64], indices: NDArray[np.int64], path: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a pose (N, 3) for every scan: the motions (N, 3) from update to update, bent to pass through both ends.

    The difference at the end of a stretch is spread evenly over its scans. After the last update the motions lead on.
    """
    poses = np.empty((len(motions), 3))
    ends = [*indices[1:].tolist(), len(motions)]
    for a, (first, last) in enumerate(zip(indices.tolist(), ends, strict=True)):
        pose = _pose(path[a])
        for k in range(first, last):
            if k > first:
                pose = _compose(pose, motions[k])
            poses[k] = pose
        if a + 1 < len(indices):
            end = np.array(_compose(pose, motions[last]))
            share = np.arange(last - first)[:, None] / (last - first)
            error = path[a + 1] - end
            error[2] = se2.wrap_angle(error[2])
            poses[first:last] += share * error
    poses[:, 2] = se2.wrap_angle(poses[:, 2])
    return poses


def _share_backward(stamps_ns: NDArray[np.int64]) -> float:
    return float((np.diff(stamps_ns) < 0).mean()) if len(stamps_ns) > 1 else 0.0


def _pose(row: NDArray[np.float64]) -> Pose:
    return float(row[0]), float(row[1]), float(row[2])


def _compose(pose: Pose, motion: NDArray[np.float64]) -> Pose:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return pose[0] + c * motion[0] - s * motion[1], pose[1] + s * motion[0] + c * motion[1], pose[2] + motion[2]
