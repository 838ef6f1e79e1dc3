# SPDX-License-Identifier: MIT
"""gmapping as it goes: the filter takes each scan when it comes, and the best particle says where the robot is."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.geometry import se2
from slamcli.gmapping.beams import BeamModel
from slamcli.gmapping.live_map import LiveMap
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.gmapping.particle_filter import ParticleFilter
from slamcli.gmapping.result import final_map, report_fallbacks, step_columns, summary, track_of
from slamcli.gmapping.update_gate import UpdateGate
from slamcli.grids import OccupancyGrid
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import LaserScan, Measurement, Odometry
from slamcli.registration.beams import Beams
from slamcli.registration.causal_scan_odometry import CausalScanOdometry, CausalStep
from slamcli.trajectory import Trajectory
from slamcli.trajectory.bending import between_updates
from slamcli.trajectory.time_offset import TimeOffset


class LiveGmapping:
    """The Rao-Blackwellised filter step by step (`LiveMapper`).

    What needs the whole recording is not done: the clock offset is the one that is given (``time_offset``; auto counts as
    0), and sweeps are straightened by the newest velocity.
    """

    def __init__(self, parameters: GmappingParameters, setup: Setup) -> None:
        self._parameters, self._setup = parameters, setup
        p = parameters
        self._offset_s = 0.0 if p.time_offset == "auto" else float(p.time_offset)
        self._odometry = CausalScanOdometry(p.delta, align=p.scan_odometry, deskew=p.deskew, offset_s=self._offset_s)
        self._models: dict[str, BeamModel] = {}
        self._scans: list[LaserScan] = []
        self._skipped = 0
        self._steps: list[CausalStep] = []
        self._gate = UpdateGate(p)
        self._executor = ThreadPoolExecutor(setup.jobs) if setup.jobs > 1 else None
        self._filter: ParticleFilter | None = None
        self._pose = np.zeros(3)
        self._T_map_odom = np.zeros(3)
        self._map = LiveMap(p, self._beams)
        self._grid: OccupancyGrid | None = None
        self._grid_scans, self._grid_ns = 0, 0

    @property
    def T_map_odom(self) -> NDArray[np.float64]:  # noqa: N802 - frames as everywhere
        """float64 (3,), see `LiveMapper`."""
        return self._T_map_odom.copy()

    def process(self, measurement: Measurement) -> None:
        """Take the next scan or odometry message; anything else has no meaning here.

        Raises
        ------
        UsageError
            If nothing tells where the scanner is, or how the robot moved.
        """
        if isinstance(measurement, Odometry):
            self._odometry.add(measurement)
        elif isinstance(measurement, LaserScan):
            if self._skipped % self._parameters.throttle_scans == 0:
                self._take(measurement)
            self._skipped += 1

    def grid(self) -> OccupancyGrid:
        """Return the best particle's map, at most ``map_update_interval`` seconds old."""
        if self._filter is None:
            raise EstimationError("there is no map yet: no scan has come")
        newest = self._steps[-1].stamp_ns
        age_s = (newest - self._grid_ns) / 1e9
        if self._grid is None or (
            age_s >= self._parameters.map_update_interval and self._grid_scans < len(self._steps)
        ):
            indices, path = self._filter.best_path()
            motions = np.array([step.motion for step in self._steps])
            self._grid = self._map.draw(indices, path, motions, self._setup.map_frame)
            self._grid_scans, self._grid_ns = len(self._steps), newest
        return self._grid

    def finish(self) -> MappingResult:
        """Return the best particle's trajectory, and its map drawn from that."""
        p, setup = self._parameters, self._setup
        if self._filter is None:
            raise DataError("no laser scan was read: name the topic with --scan-topic, or widen --start and --duration")
        if self._executor is not None:
            self._executor.shutdown()
        indices, path = self._filter.best_path()
        poses = between_updates(np.array([step.motion for step in self._steps]), indices, path)
        with setup.log.stage("final map"):
            grid = final_map(p, indices, poses, self._beams, setup.map_frame)
        stamps_ns = [scan.stamp_ns for scan in self._scans]
        matches = [step.match for step in self._steps if step.match is not None]
        report_fallbacks(p, self._filter, setup.log)
        return MappingResult(
            trajectory=Trajectory.from_se2(stamps_ns, poses, setup.map_frame, setup.base_frame),
            grid=grid,
            steps=step_columns(self._filter, matches, stamps_ns),
            summary=summary(self._filter, TimeOffset(self._offset_s, 0.0, 0.0, 0), matches, len(stamps_ns)),
            particles=track_of(self._filter, stamps_ns),
        )

    def _take(self, scan: LaserScan) -> None:
        model = self._model(scan)
        sweep_s = abs(scan.time_increment_s) * max(scan.num_beams - 1, 0)
        step = self._odometry.step(scan.stamp_ns, sweep_s, lambda twist: model.beams(scan, twist))
        self._scans.append(scan)
        self._steps.append(step)
        k = len(self._steps) - 1
        particles = self._filter = self._filter or self._started(step.odom)
        self._pose = np.asarray(se2.compose(self._pose, step.motion)) if k else step.odom
        if k:
            particles.move(step.motion)
        if self._gate.takes(step.stamp_ns, step.motion):
            particles.update(k, self._beams(k))
            self._pose = particles.best_pose()
        self._T_map_odom = np.asarray(se2.compose(self._pose, se2.inverse(step.odom)))

    def _started(self, first: NDArray[np.float64]) -> ParticleFilter:
        if not self._odometry.wheels.is_known:
            if not self._parameters.scan_odometry:
                raise UsageError(
                    "no odometry came before the first scan, and scan_odometry is false: nothing tells how the robot moved"
                )
            self._setup.log.warn("no odometry: the motion between scans comes from the scans alone")
        rng = np.random.default_rng(self._setup.seed)
        return ParticleFilter(self._parameters, rng, first, self._executor, self._setup.jobs)

    def _beams(self, k: int) -> Beams:
        return self._models[self._scans[k].topic].beams(self._scans[k], self._steps[k].twist)

    def _model(self, scan: LaserScan) -> BeamModel:
        if scan.topic not in self._models:
            mounts = self._setup.T_base_laser
            if scan.topic not in mounts:
                raise UsageError(
                    f"the mount of the laser on topic {scan.topic!r} is unknown: give --laser-pose x,y,yaw"
                )
            self._models[scan.topic] = BeamModel(self._parameters, mounts[scan.topic], self._setup.no_return)
        return self._models[scan.topic]
