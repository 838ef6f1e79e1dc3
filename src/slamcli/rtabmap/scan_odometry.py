# SPDX-License-Identifier: MIT
"""Odometry from the planar scans of a whole recording, with the wheels and the clock offset that they tell themselves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError, DataError, UsageError
from slamcli.geometry import se2, se3
from slamcli.measurements import LaserScan, Odometry, PointCloud
from slamcli.registration.beams import Beams
from slamcli.registration.laser_odometry import LaserOdometry, tells_sweep
from slamcli.registration.scan_odometry import ScanStep
from slamcli.registration.voxel_filter import adaptive_voxel_filter
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.node_scans import node_scan, sweep_ns
from slamcli.rtabmap.signature import NodeScan
from slamcli.runtime import RunLog
from slamcli.trajectory.clocks import align_clocks
from slamcli.trajectory.odometry_jumps import without_jumps
from slamcli.trajectory.wheel_odometry import WheelOdometry, smooth_stamps

Floats = NDArray[np.float64]

_TANGENT = 0.0
"""Points glide along walls: in a corridor the wheels, or the last speed, tell how far the robot went."""
_THINNING_M, _LEAST_POINTS, _FARTHEST_M = 0.5, 200.0, 50.0
"""Points are thinned to one density, as Cartographer's adaptive voxel filter does."""
_UPRIGHT_TOLERANCE = 1e-3
_LOST_QUALITY = 0.3
_BEAM_FACTOR = 1.0
"""Beams are not independent of each other: the variance that they tell together counts so many times."""
_WALK_M2_PER_M, _WALK_M2_PER_RAD, _WALK_M2 = 0.008**2, 0.003**2, 1e-7
"""Variance of the position by which a step drifts: per metre of way, per radian of turn, in any case."""
_WALK_RAD2_PER_M, _WALK_RAD2_PER_RAD, _WALK_RAD2 = 0.0025**2, 0.003**2, 1e-8
"""The same of the heading."""
_OUT_OF_PLANE = 1e-6
"""Variance, m^2 and rad^2, of what a robot in the plane does not do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanOdometrySettings:
    """What planar scan odometry needs of the parameters."""

    cell_m: float = 0.05
    """Cells of the local maps (`Icp/VoxelSize`)."""
    deskewing: bool = True
    """`Odom/Deskewing`."""
    range_min_m: float = 0.0
    range_max_m: float = 0.0
    """`Icp/RangeMin` and `Icp/RangeMax`; 0: the scanner's own."""
    no_return: str = "ignore"
    """What a beam without an answer means: ignore, free or max."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanTrack:
    """Where the robot was at every scan, by odometry."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,), increasing; `recorded_ns` where those do."""
    recorded_ns: NDArray[np.int64]
    """int64 (N,), as they were recorded."""
    steps: list[OdometryStep]
    """One for each scan, never lost: where a scan fits nowhere the wheels (or the last speed) lead on, with their covariance."""
    twists: tuple[Floats | None, ...]
    """Velocity (3,) of the base during each sweep, where it is known."""
    num_lost: int
    """Scans that fitted nowhere."""


class PlanarScanOdometry:
    """Collects scans and odometry, and aligns them when the recording has ended.

    Knowing the whole recording first is what lets it estimate the offset between the clocks of laser and wheels, and the
    wheels' systematic errors. Scans are kept as they were read: four bytes a beam, twelve a point of
    a planar scanner's cloud.

    Parameters
    ----------
    T_base_laser : mount (4, 4) of each scanner by topic.
    """

    def __init__(self, settings: ScanOdometrySettings, T_base_laser: Mapping[str, Floats], log: RunLog) -> None:
        self._settings, self._mounts, self._log = settings, T_base_laser, log
        self._scans: list[LaserScan | PointCloud] = []
        self._odometry: list[Odometry] = []
        self._places: list[int] = []
        self._upright: set[str] = set()

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self._scans)

    def add(self, measurement: LaserScan | PointCloud | Odometry) -> None:
        """Take the next measurement in recorded order.

        Raises
        ------
        CalibrationError
            If a scanner's axis is not vertical.
        UsageError
            If nobody knows where it is mounted.
        """
        if isinstance(measurement, Odometry):
            self._odometry.append(measurement)
            self._places.append(len(self._scans))
            return
        if measurement.topic not in self._upright:
            self._check_mount(measurement.topic)
            self._upright.add(measurement.topic)
        self._scans.append(measurement)

    def solve(self) -> ScanTrack:
        """Return how the robot moved.

        Raises
        ------
        DataError
            If there is no scan.
        """
        if not self._scans:
            raise DataError("no laser scan was read: name the topic with --scan-topic, or widen --start and --duration")
        recorded = np.array([scan.stamp_ns for scan in self._scans], np.int64)
        stamps, wheels = self._clocks(recorded)
        sweep_s = max(_sweep_s(scan) for scan in self._scans)
        laser = LaserOdometry(
            stamps_ns=stamps, beams=self._beams, delta_m=self._settings.cell_m,
            sweeps=self._settings.deskewing and tells_sweep(stamps, sweep_s, self._log), log=self._log, wheels=wheels, tangent=_TANGENT,
        )  # fmt: skip
        offset_s = 0.0
        if wheels is not None:
            laser, offset, _ = laser.calibrated(None)
            offset_s = offset.seconds
            if offset_s:
                self._log.note(
                    f"laser and odometry clocks differ: odometry is looked up {offset_s:+.3f} s from each scan's stamp (turns then agree "
                    f"within {math.degrees(offset.error_after_rad):.2f} instead of {math.degrees(offset.error_before_rad):.2f} degrees)"
                )
        motions, steps = laser.motions(offset_s)
        return self._track(recorded, stamps, motions, steps, laser)

    def scan(self, k: int, track: ScanTrack) -> NodeScan:
        """Return scan k in the base frame, freed of the motion during its sweep."""
        scan, s = self._scans[k], self._settings
        return node_scan(
            scan, self._mounts[scan.topic], s.no_return, track.twists[k], range_min_m=s.range_min_m, range_max_m=s.range_max_m
        )  # fmt: skip

    def _track(
        self,
        recorded: NDArray[np.int64],
        stamps: NDArray[np.int64],
        motions: Floats,
        steps: list[ScanStep],
        laser: LaserOdometry,
    ) -> ScanTrack:
        poses = se3.from_se2(se2.integrate(np.zeros(3), motions[1:]))
        known = laser.wheels is not None
        lost = [k for k, step in enumerate(steps) if k and step.quality < _LOST_QUALITY]
        if lost:
            self._log.counts["scans that fitted nowhere"] += len(lost)
        told = [
            OdometryStep(
                stamp_ns=int(recorded[k]), T_odom_base=poses[k], covariance=step_covariance(motions[k], step, known=known) if k else np.zeros((6, 6)),
                num_features=(count := _num_points(self._scans[k])), num_inliers=round(step.quality * count),
            )
            for k, step in enumerate(steps)
        ]  # fmt: skip
        twists = tuple(laser.twist(k, motions[k + 1 : k + 2]) for k in range(len(steps)))
        return ScanTrack(stamps_ns=stamps, recorded_ns=recorded, steps=told, twists=twists, num_lost=len(lost))

    def _beams(self, k: int, twist: Floats | None) -> Beams:
        """Return scan k as odometry takes it: matched points thinned to one density."""
        scan, s = self._scans[k], self._settings
        seen = node_scan(
            scan, self._mounts[scan.topic], s.no_return, twist, range_min_m=s.range_min_m, range_max_m=s.range_max_m
        )
        beams = beams_of(seen)
        ends = beams.ends[beams.hit]
        if len(ends) == 0:
            return beams
        kept = adaptive_voxel_filter(ends - beams.start, _THINNING_M, _LEAST_POINTS, _FARTHEST_M)
        return replace(beams, points=np.ascontiguousarray(ends[kept]))

    def _clocks(self, recorded: NDArray[np.int64]) -> tuple[NDArray[np.int64], WheelOdometry | None]:
        if not self._odometry:
            self._log.note("no odometry: the motion between scans comes from the scans alone")
            return smooth_stamps(recorded), None
        odometry = np.array([sample.stamp_ns for sample in self._odometry], np.int64)
        poses = without_jumps(odometry, np.array([sample.pose_se2 for sample in self._odometry]), self._log)
        stamps, wheels, by_order = align_clocks(recorded, odometry, np.array(self._places), poses)
        if by_order:
            self._log.note(
                "stamps run backwards again and again: the recorded order decides which odometry belongs to which scan"
            )
        return stamps, wheels

    def _check_mount(self, topic: str) -> None:
        if topic not in self._mounts:
            raise UsageError(f"the mount of the laser on topic {topic!r} is unknown: give --laser-pose x,y,yaw")
        upright = abs(float(self._mounts[topic][2, 2]))
        if 1.0 - upright > _UPRIGHT_TOLERANCE:
            raise CalibrationError(
                f"the scanner on topic {topic!r} is tilted by {math.degrees(math.acos(min(1.0, upright))):.1f} degrees: scan odometry in "
                "the plane needs a scanner that sweeps the floor plane (see --laser-pose)"
            )


def _sweep_s(scan: LaserScan | PointCloud) -> float:
    """Return the time from the first to the last point of a sweep; a negative increment is a reversed one."""
    if isinstance(scan, LaserScan):
        return abs(scan.time_increment_s) * max(scan.num_beams - 1, 0)
    return sweep_ns(scan) / 1e9


def _num_points(scan: LaserScan | PointCloud) -> int:
    return int(np.isfinite(scan.ranges_m).sum()) if isinstance(scan, LaserScan) else len(scan.points_m)


def beams_of(scan: NodeScan) -> Beams:
    """Return a planar scan's beams in the base frame; directions are left out."""
    points = np.ascontiguousarray(scan.points[:, :2], np.float64)
    free = np.zeros((0, 2)) if scan.open_ends is None else scan.open_ends[:, :2].astype(np.float64)
    ends = np.concatenate([points, free])
    start = np.ascontiguousarray(scan.T_base_sensor[:2, 3], np.float64).reshape(1, 2)
    return Beams(points, np.empty((0, 2)), start, ends, np.arange(len(ends)) < len(points))


def step_covariance(motion: Floats, step: ScanStep, *, known: bool) -> Floats:
    """Return the covariance (6, 6) of the motion (3,) that leads to a scan: translation, then rotation vector.

    What the points tell and what the wheels tell (with `known`; otherwise the last speed, which tells little) are joined; to that
    comes a drift that grows with the way.
    """
    way, turn = math.hypot(motion[0], motion[1]), abs(float(motion[2]))
    by_wheels = (0.005 + 0.1 * way + 0.03 * turn, 0.01 + 0.1 * way + 0.2 * turn) if known else (0.2, 0.3)
    information = np.diag([by_wheels[0] ** -2, by_wheels[0] ** -2, by_wheels[1] ** -2])
    if step.information is not None and step.quality >= _LOST_QUALITY:
        information = information + step.information / _BEAM_FACTOR
    planar = np.linalg.inv(information)
    drift_m2 = _WALK_M2 + _WALK_M2_PER_M * way + _WALK_M2_PER_RAD * turn
    drift_rad2 = _WALK_RAD2 + _WALK_RAD2_PER_M * way + _WALK_RAD2_PER_RAD * turn
    covariance = np.diag(np.full(6, _OUT_OF_PLANE))
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] = planar + np.diag([drift_m2, drift_m2, drift_rad2])
    return covariance
