# SPDX-License-Identifier: MIT
"""The range measurements of a recording in their order, with everything that tells how the robot moved between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.attitude import Attitude, attitude_of
from slamcli.cartographer.parameters import TrajectoryBuilder2d
from slamcli.cartographer.range_data import RangeData, RangeMeasurement, RangeSensor, sweep_seconds
from slamcli.cartographer.scan_warnings import warn_of_corridors
from slamcli.errors import DataError, UsageError
from slamcli.geometry import se2
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample, Odometry
from slamcli.registration.beams import Beams
from slamcli.registration.laser_odometry import LaserOdometry, tells_sweep
from slamcli.registration.scan_odometry import ScanStep
from slamcli.registration.voxel_filter import adaptive_voxel_filter
from slamcli.trajectory.clocks import align_clocks
from slamcli.trajectory.odometry_jumps import without_jumps
from slamcli.trajectory.wheel_calibration import WheelCalibration
from slamcli.trajectory.wheel_odometry import WheelOdometry, smooth_stamps

TANGENT = 0.0
"""Share of what points tell along a surface that is believed: they should glide along walls, not rest on single cells."""
_POOR_QUALITY = 0.5
_LONGEST_OFFSET_S = 4e9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motions:
    """How the robot moved, and how that is known."""

    motions: NDArray[np.float64]
    """float64 (N, 3), from each scan to the next one's place: row k leads to scan k. Where nothing tells them, local SLAM
    fills them in, as far as it got."""
    slack_m: NDArray[np.float64]
    """float64 (N,), how uncertain the motion is where scans did not tell it, else 0."""
    steps: list[ScanStep]
    extrapolated: bool = False
    """Whether nothing tells the motions: neither scans nor wheels."""
    turns_told: bool = False
    """Whether a gyroscope tells the turns where the motions are extrapolated."""
    offset_s: float = 0.0
    calibration: WheelCalibration | None = None


class ScanSequence:
    """Scans, odometry and IMU of one recording, collected; and the motion between scans that they tell together."""

    def __init__(self, parameters: TrajectoryBuilder2d, setup: Setup) -> None:
        self._parameters, self._setup = parameters, setup
        self.scans: list[RangeMeasurement] = []
        self._odometry: list[Odometry] = []
        self._places: list[int] = []
        self._imu: list[ImuSample] = []
        self._sensors: dict[str, RangeSensor] = {}
        self._attitude: Attitude | None = None
        self._laser: LaserOdometry | None = None
        self.stamps_ns: NDArray[np.int64] = np.zeros(0, np.int64)
        self._moves: NDArray[np.float64] | None = None

    def add(self, measurement: RangeMeasurement | Odometry | ImuSample) -> None:
        """Take the next measurement in recorded order."""
        if isinstance(measurement, Odometry):
            self._odometry.append(measurement)
            self._places.append(len(self.scans))
        elif isinstance(measurement, ImuSample):
            self._imu.append(measurement)
        else:
            if measurement.topic not in self._sensors:
                self._sensors[measurement.topic] = self._sensor(measurement.topic)
            self.scans.append(measurement)

    @property
    def recorded_stamps_ns(self) -> list[int]:
        """The stamps of the scans as they were recorded."""
        return [scan.stamp_ns for scan in self.scans]

    @property
    def odometry(self) -> Sequence[Odometry]:
        """The odometry as it was recorded."""
        return self._odometry

    @property
    def imu(self) -> Sequence[ImuSample]:
        """The samples of the IMU, if it is used (after `prepare`)."""
        return self._imu if self._attitude is not None else ()

    def wheel_poses(self, scans: NDArray[np.int64], offset_s: float) -> NDArray[np.float64] | None:
        """Return where the calibrated odometry has scans, float64 (K, 3); None without odometry (after `prepare`)."""
        if self._laser is None or self._laser.wheels is None:
            return None
        return self._laser.wheels.at(self.stamps_ns[scans] + round(offset_s * 1e9))

    def prepare(self) -> Motions:
        """Put the clocks in order and return how the robot moved.

        Raises
        ------
        DataError
            If there is no scan.
        """
        if not self.scans:
            raise DataError(
                "no scan was read: name the topic with --scan-topic or --points-topic, or widen --start and --duration"
            )
        log, p = self._setup.log, self._parameters
        self.stamps_ns, wheels = self._clocks()
        if self._imu and p.use_imu_data:
            self._attitude = attitude_of(
                self._imu, self._setup, p.pose_extrapolator.constant_velocity.imu_gravity_time_constant
            )
        sweep_s = max(sweep_seconds(scan) for scan in self.scans)
        laser = LaserOdometry(
            stamps_ns=self.stamps_ns, beams=self._beams, delta_m=p.submaps.grid_options_2d.resolution,
            sweeps=p.scan_odometry.deskew and tells_sweep(self.stamps_ns, sweep_s, log), log=log, wheels=wheels,
            yaws=None if self._attitude is None else self._attitude.yaws(self.stamps_ns), tangent=TANGENT,
        )  # fmt: skip
        laser, offset_s, calibration = self._mended(laser)
        self._laser = laser
        if not p.scan_odometry.enabled:
            motions = self._predicted(laser, offset_s)
            found = Motions(
                motions=motions, slack_m=np.zeros(len(motions)), steps=[], offset_s=offset_s,
                extrapolated=laser.wheels is None, turns_told=laser.yaws is not None,
            )  # fmt: skip
        else:
            motions, steps = laser.motions(offset_s)
            warn_of_corridors(self.stamps_ns, motions, steps, laser.wheels is not None, log)
            found = Motions(
                motions=motions,
                slack_m=slack_of(motions, steps),
                steps=steps,
                offset_s=offset_s,
                calibration=calibration,
            )
        self._moves = motions
        return found

    def range_data(self, k: int) -> RangeData:
        """Return the returns and misses of scan k, freed of the motion during its sweep."""
        assert self._laser is not None  # noqa: S101  (after prepare)
        assert self._moves is not None  # noqa: S101
        return self._range_data(k, self._laser.twist(k, self._moves[k + 1 : k + 2]))

    def _range_data(self, k: int, twist: NDArray[np.float64] | None) -> RangeData:
        scan = self.scans[k]
        tilt = (
            None
            if self._attitude is None or not self._attitude.has_gravity
            else self._attitude.tilt(int(self.stamps_ns[k]))
        )
        return self._sensors[scan.topic].range_data(scan, twist, tilt)

    def _beams(self, k: int, twist: NDArray[np.float64] | None) -> Beams:
        """Return scan k for the scan odometry: matched points thinned to one density, as local SLAM matches them."""
        data, f = self._range_data(k, twist), self._parameters.adaptive_voxel_filter
        beams = data.as_beams()
        if len(data.returns) == 0:
            return beams
        return replace(
            beams, points=data.returns[adaptive_voxel_filter(data.returns, f.max_length, f.min_num_points, f.max_range)]
        )

    def _sensor(self, topic: str) -> RangeSensor:
        mounts = self._setup.T_base_laser
        if topic not in mounts:
            raise UsageError(f"the mount of the sensor on topic {topic!r} is unknown: give --laser-pose x,y,yaw")
        return RangeSensor(self._parameters, mounts[topic], self._setup.no_return)

    def _clocks(self) -> tuple[NDArray[np.int64], WheelOdometry | None]:
        scans = np.array(self.recorded_stamps_ns, dtype=np.int64)
        log = self._setup.log
        if not self._odometry:
            if self._parameters.scan_odometry.enabled:
                log.note(
                    "no odometry: the motion between scans comes from the scans"
                    + (" and the gyroscope" if self._imu else "")
                    + " alone"
                )
            return smooth_stamps(scans), None
        odometry = np.array([sample.stamp_ns for sample in self._odometry], dtype=np.int64)
        poses = np.array([sample.pose_se2 for sample in self._odometry])
        poses = without_jumps(odometry, poses, log)
        stamps, wheels, by_order = align_clocks(scans, odometry, np.array(self._places), poses)
        if by_order:
            log.note(
                "stamps run backwards again and again: the recorded order decides which odometry belongs to which scan"
            )
        return stamps, wheels

    def _mended(self, laser: LaserOdometry) -> tuple[LaserOdometry, float, WheelCalibration | None]:
        """Return the laser odometry with calibrated wheels, and the clock offset."""
        o, log = self._parameters.scan_odometry, self._setup.log
        given = None if o.time_offset == "auto" else float(o.time_offset)
        if given is not None and abs(given) > _LONGEST_OFFSET_S:
            raise UsageError(f"time_offset={given:g}: two clocks of one recording are not so far apart")
        if laser.wheels is None or (not o.calibrate and given is not None) or not o.enabled:
            return laser, given or 0.0, None
        mended, offset, calibration = laser.calibrated(given)
        if given is None and offset.seconds:
            log.warn(
                f"laser and odometry clocks differ: odometry is looked up {offset.seconds:+.3f} s from each scan's stamp (turns then "
                f"agree within {math.degrees(offset.error_after_rad):.2f} instead of {math.degrees(offset.error_before_rad):.2f} degrees); "
                "--set TRAJECTORY_BUILDER_2D.scan_odometry.time_offset=SECONDS says otherwise"
            )
        return (mended if o.calibrate else laser), offset.seconds, calibration if o.calibrate else None

    def _predicted(self, laser: LaserOdometry, offset_s: float) -> NDArray[np.float64]:
        """Return the motions that odometry and gyroscope tell, without scans (as the original's extrapolator)."""
        motions = np.zeros((len(self.stamps_ns), 3))
        if laser.wheels is not None:
            poses = laser.wheels.at(self.stamps_ns + round(offset_s * 1e9))
            motions[1:] = se2.between(poses[:-1], poses[1:])
        if laser.yaws is not None:
            motions[1:, 2] = se2.wrap_angle(np.diff(laser.yaws))
        return motions


def slack_of(motions: NDArray[np.float64], steps: list[ScanStep]) -> NDArray[np.float64]:
    """Return how uncertain each motion is where the scan did not match and only wheels or a guess tell it."""
    poor = np.array([step.quality < _POOR_QUALITY for step in steps])
    way = np.hypot(motions[:, 0], motions[:, 1]) + np.abs(motions[:, 2])
    return np.where(poor, 0.02 + 0.2 * way, 0.0)
