# SPDX-License-Identifier: MIT
"""Cartographer in the plane: local SLAM, loop closure and the pose graph over a whole recording."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.closing_2d import BatchClosing2d
from slamcli.cartographer.graph_2d import PoseGraph2d, unit_weight
from slamcli.cartographer.joining_2d import join_trajectories
from slamcli.cartographer.local_part_2d import trajectory_part
from slamcli.cartographer.local_slam_2d import LOST_M, LocalSlam2d
from slamcli.cartographer.odometry_terms_2d import odometry_term
from slamcli.cartographer.online_closing_2d import OnlineClosing2d
from slamcli.cartographer.outside_2d import Outside2d
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.pose_extrapolator_2d import ConstantVelocity2d
from slamcli.cartographer.range_data import joined
from slamcli.cartographer.result_2d import mapping_result
from slamcli.cartographer.scan_sequence import Motions, ScanSequence
from slamcli.cartographer.sensor_records_2d import with_motion_sensors
from slamcli.cartographer.state_2d import loops_of_state, parts_of_state
from slamcli.cartographer.submaps_2d import note_of
from slamcli.errors import EstimationError
from slamcli.geometry import se2
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import ImuSample, Landmarks, LaserScan, Measurement, Odometry, PointCloud, StampedPose
from slamcli.posegraph import MapState
from slamcli.trajectory.bending import as_pose, between_updates, compose, led_back


class Mapper2D:
    """Batch work: collects scans, odometry and IMU, and maps when the recording has ended.

    Knowing the whole recording first lets it estimate the offset between clocks and the errors of the wheels, and search
    loops where the drift allows them. Scans are kept as they came, four bytes a beam.
    """

    def __init__(self, parameters: CartographerParameters, setup: Setup) -> None:
        self._parameters, self._setup = parameters, setup
        self._sequence = ScanSequence(parameters.trajectory_builder_2d, setup)
        self._outside = Outside2d(setup)
        note = note_of(parameters.trajectory_builder_2d.submaps)
        if note:
            setup.log.note(note)

    def process(self, measurement: Measurement) -> None:
        """Take the next measurement."""
        if isinstance(measurement, LaserScan | PointCloud | Odometry | ImuSample):
            self._sequence.add(measurement)
        elif isinstance(measurement, Landmarks | StampedPose):
            self._outside.add(measurement)

    def finish(self) -> MappingResult:
        """Map everything."""
        log, setup = self._setup.log, self._setup
        motions = self._sequence.prepare()
        local, matched, poses = self._local_slam(motions)
        if not local.nodes:
            raise EstimationError(
                "no scan shows anything within range: there is nothing to map (see min_range and max_range)"
            )
        number = 0 if setup.state is None else max(setup.state.trajectories, default=-1) + 1
        part = trajectory_part(local, motions.slack_m, number)
        known = [] if setup.state is None else parts_of_state(setup.state, unit_weight(self._parameters.pose_graph))
        parts = [*known, part]
        graph = PoseGraph2d(self._parameters.pose_graph, parts)
        if setup.state is not None:
            graph.loops = loops_of_state(setup.state, graph)
        local_poses = led_back(between_updates(motions.motions, matched, poses), motions.motions, int(matched[0]))
        nodes = np.array([node.scan for node in local.nodes], dtype=np.int64)
        with ThreadPoolExecutor(setup.jobs) as executor:
            with log.stage("loop closure"):
                join_trajectories(graph, executor, log)
            # Landmarks and fixed frames begin where the trajectory lies in the map.
            self._outside.attach(graph, self._sequence.stamps_ns, local_poses, nodes)
            self._attach_wheels(graph, nodes, motions)
            batch = self._parameters.pose_graph.batch_search.enabled
            closing = (BatchClosing2d if batch else OnlineClosing2d)(graph, executor, log)
            with log.stage("loop closure"):
                if batch and graph.more:  # loops are searched for where they say
                    graph.optimise(self._parameters.pose_graph.max_num_final_iterations)
                closing.run()
                solution = graph.optimise(self._parameters.pose_graph.max_num_final_iterations)
        steps = np.vstack([np.zeros((1, 3)), se2.between(local_poses[:-1], local_poses[1:])])
        final = between_updates(steps, nodes, graph.node[graph.node_part == len(parts) - 1])
        final = led_back(final, steps, int(nodes[0]))
        result = mapping_result(
            setup, self._sequence.recorded_stamps_ns, motions, local, matched, graph, closing, solution, final
        )
        summary = {**result.summary, **self._outside.summary(graph)}
        state = None if result.state is None else self._outside.kept(graph, self._with_sensors(graph, result.state))
        return replace(result, summary=summary, state=state)

    def _attach_wheels(self, graph: PoseGraph2d, nodes: NDArray[np.int64], motions: Motions) -> None:
        """Add what the odometry says between nodes (made of the scans `nodes`), where that is asked for."""
        if self._parameters.pose_graph.optimization_problem.odometry_term == "always" and len(nodes) > 1:
            wheels = self._sequence.wheel_poses(nodes, motions.offset_s)
            if wheels is not None:
                graph.add_terms([odometry_term(graph, wheels)], np.zeros((0, 3)))

    def _with_sensors(self, graph: PoseGraph2d, state: MapState) -> MapState:
        sequence = self._sequence
        return with_motion_sensors(state, graph.parts[-1].trajectory, sequence.odometry, sequence.imu, self._setup)

    def _local_slam(self, motions: Motions) -> tuple[LocalSlam2d, NDArray[np.int64], NDArray[np.float64]]:
        """Return local SLAM after all scans, the scans it placed, and their poses in the local frame."""
        p, stamps, log = self._parameters.trajectory_builder_2d, self._sequence.stamps_ns, self._setup.log
        local = LocalSlam2d(p, np.zeros(3))
        together = self._scans_per_match()
        matched, poses, lost = [], [], 0.0
        speed = ConstantVelocity2d(p.pose_extrapolator.constant_velocity.pose_queue_duration)
        with log.stage("local SLAM", (stamps[-1] - stamps[0]) / 1e9):
            for last in range(together - 1, len(stamps), together):
                scans = range(last - together + 1, last + 1)
                if motions.extrapolated:
                    ahead = slice(scans.start, last + 2)  # the next one too: it tells the motion during the last sweep
                    turns = motions.motions[ahead, 2].copy() if motions.turns_told else None
                    motions.motions[ahead] = speed.motions(stamps[ahead], turns)
                motion = (0.0, 0.0, 0.0)
                for k in scans:
                    motion = compose(motion, as_pose(motions.motions[k])) if k else motion
                lost += float((motions.slack_m[scans.start : scans.stop] ** 2).sum())
                if lost > LOST_M**2:
                    local.restart()
                    lost = 0.0
                before = len(local.nodes)
                data = joined([self._sequence.range_data(k) for k in scans], motions.motions[scans.start : scans.stop])
                local.step(last, int(stamps[last]), data, np.array(motion))
                told = len(local.nodes) > before and motions.slack_m[last] == 0.0
                lost = 0.0 if told else lost
                speed.add(int(stamps[last]), local.pose)
                matched.append(last)
                poses.append(local.pose)
                log.progress.update((stamps[last] - stamps[0]) / 1e9)
            local.finish()
        return local, np.array(matched, dtype=np.int64), np.array(poses)

    def _scans_per_match(self) -> int:
        """Return how many messages make one scan to match; parts into which a message is cut count as parts."""
        subdivisions = max(self._parameters.options.num_subdivisions_per_laser_scan, 1)
        wanted = max(1, round(self._parameters.trajectory_builder_2d.num_accumulated_range_data / subdivisions))
        return min(wanted, len(self._sequence.scans))
