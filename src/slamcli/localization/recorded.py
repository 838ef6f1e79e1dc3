# SPDX-License-Identifier: MIT
"""AMCL on a recording: scans and odometry in, a pose for each scan out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, UsageError
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl import Amcl
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.mapper import InputPlan, MappingResult, SensorOffer, Setup
from slamcli.measurements import LaserScan, Measurement, Odometry
from slamcli.registration.laser_odometry import tells_sweep
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.trajectory.clocks import align_clocks
from slamcli.trajectory.wheel_odometry import WheelOdometry

_FEW_UPDATES = 3

Array = NDArray[np.float64]


class RecordedAmcl:
    """Collects a recording's scans and odometry, and localises when it has ended.

    Knowing all odometry first is what lets it be interpolated at each scan's stamp. Scans before the first or after the last
    odometry message get the pose of the nearest.
    """

    def __init__(
        self, parameters: AmclParameters, setup: Setup, grid: OccupancyGrid, start: tuple[float, float, float] | None,
        *, everywhere: bool,
    ) -> None:  # fmt: skip
        self._parameters, self._setup, self._grid = parameters, setup, grid
        self._start, self._everywhere = start, everywhere
        self._scans: list[LaserScan] = []
        self._odometry: list[Odometry] = []
        self._places: list[int] = []
        self.covariances: Array = np.empty((0, 3, 3))

    def process(self, measurement: Measurement) -> None:
        """Take the next scan or odometry message; anything else has no meaning here."""
        if isinstance(measurement, LaserScan):
            self._scans.append(measurement)
        elif isinstance(measurement, Odometry):
            self._odometry.append(measurement)
            self._places.append(len(self._scans))

    def finish(self) -> MappingResult:
        """Localise every scan; the covariances of the poses are left in `covariances` (N, 3, 3)."""
        if not self._scans:
            raise DataError("no laser scan was read: name the topic with --scan-topic, or widen --begin and --duration")
        stamps, wheels = self._clocks()
        odometry = wheels.at(stamps)
        sweep_s = max(abs(scan.time_increment_s) * max(scan.num_beams - 1, 0) for scan in self._scans)
        deskew = self._parameters.deskew and tells_sweep(stamps, sweep_s, self._setup.log)
        amcl = Amcl(replace(self._parameters, deskew=deskew), self._grid, seed=self._setup.seed)
        if self._start is not None:
            amcl.set_pose(self._start)
        if self._everywhere:
            amcl.scatter()
        poses, rows = np.empty((len(stamps), 3)), _Columns()
        self.covariances = np.empty((len(stamps), 3, 3))
        with self._setup.log.stage("localise", (stamps[-1] - stamps[0]) / 1e9):
            for k, scan in enumerate(self._scans):
                used = amcl.update(odometry[k], scan, self._mount(scan))
                poses[k], self.covariances[k] = amcl.pose, amcl.covariance
                rows.add(scan.stamp_ns, amcl, used=used)
                self._setup.log.progress.update((stamps[k] - stamps[0]) / 1e9)
        self._check(rows)
        trajectory = Trajectory.from_se2(
            [s.stamp_ns for s in self._scans], poses, self._setup.map_frame, self._setup.base_frame
        )
        return MappingResult(trajectory=trajectory, grid=self._grid, steps=rows.arrays(), summary=rows.summary())

    def _clocks(self) -> tuple[NDArray[np.int64], WheelOdometry]:
        if not self._odometry:
            raise UsageError(
                "there is no odometry in the recording, and AMCL needs it: name it with --odom-topic, or build a map with"
                " `slamcli map`, which can do without"
            )
        scans = np.array([scan.stamp_ns for scan in self._scans], dtype=np.int64)
        odometry = np.array([sample.stamp_ns for sample in self._odometry], dtype=np.int64)
        poses = np.array([sample.pose_se2 for sample in self._odometry])
        stamps, wheels, by_order = align_clocks(scans, odometry, np.array(self._places), poses)
        if by_order:
            self._setup.log.note(
                "stamps run backwards again and again: the recorded order decides which odometry belongs to which scan"
            )
        elif not (wheels.stamps_ns[0] <= stamps[-1] and stamps[0] <= wheels.stamps_ns[-1]):
            raise DataError(
                "scans and odometry have no time in common: their clocks differ (see slamcli doctor, --time-offset)"
            )
        return stamps, wheels

    def _mount(self, scan: LaserScan) -> Array:
        mount = self._setup.T_base_laser.get(scan.topic)
        if mount is None:
            raise UsageError(f"the mount of the laser on topic {scan.topic!r} is unknown: give --laser-pose x,y,yaw")
        return mount

    def _check(self, rows: _Columns) -> None:
        log, used = self._setup.log, sum(rows.used)
        if used <= _FEW_UPDATES:
            log.warn(
                f"only {used} of {len(rows.used)} scans were used: the robot hardly moves (update_min_d, update_min_a)"
            )
        if rows.weight[-1] < 0.5:
            log.warn(
                f"in the end no place has most of the particles ({rows.groups[-1]} groups): the robot may be somewhere else"
            )
        elif rows.deviation[-1] > _UNCERTAIN_M:
            log.warn(
                f"in the end the particles are spread over {rows.deviation[-1]:.1f} m: the robot may be somewhere else"
            )
        fits = np.array(rows.fit)[np.array(rows.used, dtype=np.bool_)]
        if len(fits) and np.median(fits) < _POOR_FIT:
            log.warn(
                f"scans fit the map badly (median fit {np.median(fits):.2f} of 1): a wrong place, another map, or a wrong scanner mount"
            )


_POOR_FIT = 0.4
_UNCERTAIN_M = 1.0
"""Deviation of all particles from which on the pose is no answer: half the width of an office."""


@dataclass(slots=True)
class _Columns:
    """One row for each scan."""

    stamp_ns: list[int] = field(default_factory=list)
    used: list[bool] = field(default_factory=list)
    particles: list[int] = field(default_factory=list)
    groups: list[int] = field(default_factory=list)
    weight: list[float] = field(default_factory=list)
    fit: list[float] = field(default_factory=list)
    deviation: list[float] = field(default_factory=list)
    turn: list[float] = field(default_factory=list)

    def add(self, stamp_ns: int, amcl: Amcl, *, used: bool) -> None:
        self.stamp_ns.append(stamp_ns)
        self.used.append(used)
        self.particles.append(amcl.num_particles)
        self.groups.append(amcl.estimate.num_groups)
        self.weight.append(amcl.estimate.best.weight)
        self.fit.append(amcl.fit)
        spread = amcl.estimate.covariance
        self.deviation.append(float(np.sqrt(spread[0, 0] + spread[1, 1])))
        self.turn.append(float(np.sqrt(spread[2, 2])))

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        return {
            "stamp_ns": np.array(self.stamp_ns, dtype=np.int64),
            "particles": np.array(self.particles),
            "groups": np.array(self.groups),
            "best_weight": np.array(self.weight),
            "scan_fit": np.array(self.fit),
            "deviation_m": np.array(self.deviation),
            "deviation_rad": np.array(self.turn),
            "used": np.array(self.used, dtype=np.int64),
        }

    def summary(self) -> Mapping[str, Any]:
        used = np.array(self.used, dtype=np.bool_)
        return {
            "scans": len(used),
            "scans_used": int(used.sum()),
            "mean_particles": float(np.mean(self.particles)),
            "final_deviation_m": self.deviation[-1],
            "final_deviation_deg": float(np.degrees(self.turn[-1])),
            "median_scan_fit": float(np.median(np.array(self.fit)[used])) if used.any() else None,
        }


class AmclInput:
    """What AMCL takes from a recording, told as tiers tell it; `build` gives the localisation on one map."""

    name = "amcl"
    parameters: type = AmclParameters
    roles = frozenset({"scans", "odometry"})
    modes: tuple[str, ...] = ()
    resumes = False
    remembers = False

    def __init__(self, grid: OccupancyGrid, start: tuple[float, float, float] | None, *, everywhere: bool) -> None:
        self._grid, self._start, self._everywhere = grid, start, everywhere

    def plan(self, parameters: AmclParameters, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:  # noqa: ARG002
        """Return that one scanner is used, or all that the user names, and the odometry."""
        return InputPlan(
            parameters=parameters,
            num_laser_scans=max(offer.num_laser_scans, 1) if "scans" in offer.named else 1,
            base_frame=parameters.base_frame_id if "base_frame_id" in given else None,
            odom_frame=parameters.odom_frame_id if "odom_frame_id" in given else None,
            map_frame=parameters.global_frame_id,
        )

    def build(self, parameters: AmclParameters, setup: Setup) -> RecordedAmcl:
        """Return the localisation."""
        return RecordedAmcl(parameters, setup, self._grid, self._start, everywhere=self._everywhere)
