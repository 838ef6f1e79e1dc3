# SPDX-License-Identifier: MIT
"""Cartographer in the plane as it goes: the pose after each scan, the submaps so far, loops closed along the way."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.live_closing_2d import LiveClosing2d
from slamcli.cartographer.live_scans_2d import LiveScan, LiveScans2d
from slamcli.cartographer.local_slam_2d import LOST_M, LocalSlam2d
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.pose_extrapolator_2d import ConstantVelocity2d
from slamcli.cartographer.range_data import joined
from slamcli.cartographer.result_2d import mapping_result
from slamcli.cartographer.submaps_2d import note_of
from slamcli.cartographer.trimming import trimmed
from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.grids.submap_canvas import SubmapCanvas
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import ImuSample, Landmarks, LaserScan, Measurement, Odometry, PointCloud, StampedPose
from slamcli.trajectory.bending import as_pose, between_updates, compose, led_back


class LiveCartographer2d:
    """Local SLAM scan by scan and a pose graph that grows (`LiveMapper`).

    It uses range sensors and odometry. What needs the whole recording is not done: the clock offset is the one that is
    given (``time_offset``; auto counts as 0), wheels are not calibrated, and sweeps are straightened by the newest velocity.
    """

    def __init__(self, parameters: CartographerParameters, setup: Setup) -> None:
        if parameters.map_builder.dimensions == 3:
            raise UsageError("cartographer maps as it goes in the plane only: choose --mode 2d")
        if setup.state is not None:
            raise UsageError("--load-state: mapping as it goes begins a new map")
        self._parameters, self._setup = parameters, setup
        p = parameters.trajectory_builder_2d
        self._scans = LiveScans2d(p, setup)
        self._local = LocalSlam2d(p, np.zeros(3))
        self._speed = ConstantVelocity2d(p.pose_extrapolator.constant_velocity.pose_queue_duration)
        self._executor = ThreadPoolExecutor(setup.jobs)
        self._closing = LiveClosing2d(parameters.pose_graph, self._executor, setup.log)
        self._canvas = SubmapCanvas(setup.map_frame)
        self._waiting: list[LiveScan] = []
        self._together = max(
            1, round(p.num_accumulated_range_data / max(parameters.options.num_subdivisions_per_laser_scan, 1))
        )
        self._matched: list[int] = []
        self._poses: list[NDArray[np.float64]] = []
        self._wheels: list[NDArray[np.float64]] = []
        self._lost_m2 = 0.0
        self._T_map_odom = np.zeros(3)
        self._grid: OccupancyGrid | None = None
        note = note_of(p.submaps)
        if note:
            setup.log.note(note)

    @property
    def T_map_odom(self) -> NDArray[np.float64]:  # noqa: N802 - frames as everywhere
        """float64 (3,), see `LiveMapper`."""
        return self._T_map_odom.copy()

    def process(self, measurement: Measurement) -> None:
        """Take the next scan, cloud or odometry message.

        Raises
        ------
        UsageError
            If nothing tells where the sensor is mounted.
        """
        if isinstance(measurement, Odometry):
            self._scans.add(measurement)
        elif isinstance(measurement, LaserScan | PointCloud):
            self._take(measurement)
        elif isinstance(measurement, ImuSample | Landmarks | StampedPose):
            self._setup.log.note(
                "mapping as it goes uses range sensors and odometry: IMU, landmarks and GPS are left out"
            )

    def grid(self) -> OccupancyGrid:
        """Return the map of the submaps where they are believed to be now."""
        if not self._local.nodes:
            raise EstimationError("there is no map yet: no scan with anything in range has come")
        if self._grid is None:
            submaps = self._local.submaps.all
            finished = sum(submap.finished for submap in submaps)
            self._grid = self._canvas.draw(
                [submap.grid for submap in submaps], self._closing.submaps(self._local), finished
            )
        return self._grid

    def finish(self) -> MappingResult:
        """Search loops once more, adjust everything, and draw the final map."""
        if not self._scans.steps:
            raise DataError(
                "no scan was read: name the topic with --scan-topic or --points-topic, or widen --start and --duration"
            )
        if not self._local.nodes:
            raise EstimationError(
                "no scan shows anything within range: there is nothing to map (see min_range and max_range)"
            )
        local, motions = self._local, self._scans.motions()
        local.finish()
        closing = self._closing.end(local, self._scans.slack_m, self._wheel_poses())
        self._executor.shutdown()
        graph = closing.graph
        with self._setup.log.stage("loop closure"):
            solution = graph.optimise(self._parameters.pose_graph.max_num_final_iterations)
        matched = np.array(self._matched, dtype=np.int64)
        told = between_updates(motions.motions, matched, np.array(self._poses))
        local_poses = led_back(told, motions.motions, int(matched[0]))
        steps = np.vstack([np.zeros((1, 3)), se2.between(local_poses[:-1], local_poses[1:])])
        nodes = np.array([node.scan for node in local.nodes], dtype=np.int64)
        final = led_back(between_updates(steps, nodes, graph.node), steps, int(nodes[0]))
        result = mapping_result(
            self._setup, self._scans.recorded_stamps_ns, motions, local, matched, graph, closing, solution, final
        )
        return trimmed(result, self._parameters, self._setup)

    def _take(self, measurement: LaserScan | PointCloud) -> None:
        guess = None
        if not self._scans.is_told:
            guess = self._speed.motions(np.array([measurement.stamp_ns]), None)[0]
        scan = self._scans.take(measurement, guess)
        self._waiting.append(scan)
        if len(self._waiting) >= self._together:
            self._match(self._waiting)
            self._waiting = []
        pose = compose((0.0, 0.0, 0.0), as_pose(self._local.pose))
        for later in self._waiting:
            pose = compose(pose, later.step.motion)
        in_map = se2.compose(self._closing.T_map_local, np.array(pose))
        self._T_map_odom = np.asarray(se2.compose(in_map, se2.inverse(scan.step.odom)))

    def _match(self, scans: list[LiveScan]) -> None:
        """Place some scans as one, and look for loops when it is time."""
        local, last = self._local, scans[-1]
        motion = (0.0, 0.0, 0.0)
        for scan in scans:
            motion = compose(motion, scan.step.motion)
        self._lost_m2 += sum(scan.slack_m**2 for scan in scans)
        if self._lost_m2 > LOST_M**2:
            local.restart()
            self._lost_m2 = 0.0
        before = len(local.nodes)
        data = joined([scan.data for scan in scans], np.array([scan.step.motion for scan in scans]))
        local.step(last.index, last.step.stamp_ns, data, np.array(motion))
        self._speed.add(last.step.stamp_ns, local.pose)
        self._matched.append(last.index)
        self._poses.append(local.pose)
        if len(local.nodes) == before:
            return
        self._lost_m2 = self._lost_m2 if last.slack_m > 0.0 else 0.0
        self._wheels.append(last.step.odom)
        self._grid = None
        self._closing.add(local, self._scans.slack_m, self._wheel_poses())

    def _wheel_poses(self) -> list[NDArray[np.float64]] | None:
        return self._wheels if self._scans.has_wheels else None
