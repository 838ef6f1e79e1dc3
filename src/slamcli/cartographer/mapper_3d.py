# SPDX-License-Identifier: MIT
"""Mapping with point clouds: local SLAM as they come, global SLAM at the end."""

from __future__ import annotations

from array import array
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.cloud_grouping import CloudGrouping
from slamcli.cartographer.graph_3d import Graph3D
from slamcli.cartographer.joining_3d import join
from slamcli.cartographer.local_slam_3d import LocalNode, LocalSlam3D, LocalStep
from slamcli.cartographer.map_cloud_3d import MapCloud
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.pose_graph_3d import ImuRecord, PoseGraph3D
from slamcli.cartographer.projection_3d import Projection
from slamcli.cartographer.sensor_records_3d import ImuLog, fix_record_of, imu_record_of
from slamcli.cartographer.state_map_3d import planar_grids
from slamcli.cartographer.submaps_3d import FinishedSubmap
from slamcli.cartographer.sweep_3d import assemble
from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import ImuSample, Measurement, Odometry, PointCloud, StampedPose
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap
from slamcli.trajectory import Trajectory


class Mapper3D:
    """Cartographer in space: clouds, with an IMU, odometry and GPS where there are, to a map and its graph."""

    def __init__(self, parameters: CartographerParameters, setup: Setup) -> None:
        self._p, self._setup, self._log = parameters, setup, setup.log
        known = setup.state.trajectories if setup.state is not None else ()
        self._trajectory = max(known, default=-1) + 1
        self._local = LocalSlam3D(parameters, self._trajectory, setup.log, expect_imu=bool(setup.T_base_sensor))
        builder = parameters.trajectory_builder_3d
        self._grouping = CloudGrouping(len(setup.T_base_laser), builder.num_accumulated_range_data)
        self._graph = Graph3D(setup.state)
        self._nodes: list[Node] = []
        self._constraints: list[Constraint] = []
        self._submaps: list[Submap] = []
        self._imu, self._odometry = ImuLog(setup.base_frame), list[Odometry]()
        self._fixes: list[StampedPose] = []
        loaded = {} if setup.state is None else planar_grids(parameters.slamcli_3d, setup.state)
        self._projection = Projection(parameters.slamcli_3d, loaded)
        self._cloud = MapCloud(parameters.slamcli_3d.cloud_voxel_size)
        # By cloud: its stamp, the node it hangs on (-1: the first), and its pose seen from there.
        self._stamps: array[int] = array("q")
        self._anchors: array[int] = array("q")
        self._offsets: array[float] = array("d")
        self._steps: list[tuple[int, float, int, bool]] = []

    def process(self, measurement: Measurement) -> None:
        """Take the next measurement; scans of planar lasers, images and transforms are not used here."""
        for group in self._grouping.due(measurement.stamp_ns):
            self._match(group)
        if isinstance(measurement, PointCloud):
            self._grouping.add(measurement)
        elif isinstance(measurement, ImuSample):
            before = len(self._local.imu), self._local.imu.last_stamp_ns
            self._local.imu.add(measurement, self._mount(measurement.topic))
            if (len(self._local.imu), self._local.imu.last_stamp_ns) != before:
                self._imu.add(self._local.imu)
        elif isinstance(measurement, Odometry):
            self._local.extrapolator.add_odometry(measurement)
            self._odometry.append(measurement)
        elif isinstance(measurement, StampedPose):
            self._fixes.append(measurement)

    def finish(self) -> MappingResult:
        """Match what still waits, close loops, adjust all poses, and return the result."""
        for group in self._grouping.rest():
            self._match(group)
        if not self._nodes:
            raise EstimationError(
                f"none of the {len(self._stamps)} point clouds has {self._p.trajectory_builder_3d.min_range:g} to"
                f" {self._p.trajectory_builder_3d.max_range:g} m away as many points as a match needs: nothing was mapped"
                " (TRAJECTORY_BUILDER_3D.min_range and max_range)"
            )
        for submap in self._local.submaps.rest():
            self._submaps.append(_submap(submap))
        self._graph.add(self._nodes, self._submaps, self._constraints)
        pose_graph = self._optimised()
        return self._result(pose_graph)

    def _mount(self, topic: str) -> NDArray[np.float64]:
        return np.asarray(self._setup.T_base_sensor.get(topic, np.eye(4)))

    def _match(self, group: list[PointCloud]) -> None:
        builder = self._p.trajectory_builder_3d
        mounted = [(cloud, np.asarray(self._setup.T_base_laser.get(cloud.topic, np.eye(4)))) for cloud in group]
        sweep = assemble(mounted, builder.min_range, builder.max_range, builder.voxel_filter_size)
        step = self._local.add_sweep(sweep)
        if step.node is not None:
            self._keep(step.node)
        self._note_clouds(group, step)
        self._steps.append((sweep.end_ns, step.score, step.num_points, step.node is not None))

    def _keep(self, node: LocalNode) -> None:
        """Keep of a node what the graph needs; its points go into the maps that are drawn at the end."""
        weights = self._p.pose_graph
        self._nodes.append(
            Node(
                id=node.id,
                stamp_ns=node.stamp_ns,
                T_local_node=node.T_local_base,
                T_map_node=node.T_local_base,
                gravity_alignment_xyzw=node.gravity_alignment_xyzw,
                points_m=node.high_points_m,
                low_resolution_points_m=node.low_points_m,
                rotational_histogram=node.rotational_histogram,
            )
        )
        for submap, T in zip(node.submaps, node.T_submap_node, strict=True):
            self._constraints.append(
                Constraint(
                    submap=submap,
                    node=node.id,
                    T_submap_node=T,
                    translation_weight=weights.matcher_translation_weight,
                    rotation_weight=weights.matcher_rotation_weight,
                    kind="intra",
                )
            )
        older, T = node.submaps[0], node.T_submap_node[0]
        self._projection.add(older, T, node.gravity_alignment_xyzw, node.points_m, node.origin_m)
        self._cloud.add(older, T, node.points_m, node.intensities)
        if node.finished is not None:
            self._submaps.append(_submap(node.finished))

    def _note_clouds(self, group: list[PointCloud], step: LocalStep) -> None:
        anchor = len(self._nodes) - 1
        T_anchor = self._nodes[anchor].T_local_node if anchor >= 0 else np.eye(4)
        position, quat = se3.to_position_quaternion(se3.inverse(T_anchor) @ step.cloud_poses)
        for cloud, p, q in zip(group, position, quat, strict=True):
            self._stamps.append(cloud.stamp_ns)
            self._anchors.append(anchor)
            self._offsets.extend((*p, *q))

    def _optimised(self) -> PoseGraph3D:
        """Join the new trajectory to a loaded map, search loops and adjust all poses."""
        state, setup = self._setup.state, self._setup
        imu: dict[int, ImuRecord] = {}
        for trajectory, samples in (state.imu if state is not None else {}).items():
            loaded = imu_record_of(samples)
            if loaded is not None:
                imu[trajectory] = loaded
        own = self._imu.record(has_gravity=self._local.imu.has_gravity)
        if own is not None:
            imu[self._trajectory] = own
        lever = self._mount(self._fixes[0].topic)[:3, 3] if self._fixes else np.zeros(3)
        fix = fix_record_of(self._fixes, lever)
        pose_graph = PoseGraph3D(
            self._graph, self._p, imu, {} if fix is None else {self._trajectory: fix}, setup.jobs, self._log
        )
        with self._log.stage("loop closure"):
            if state is not None and state.nodes:
                join(self._graph, self._trajectory, self._p, setup.jobs, self._log)
            pose_graph.finish()
        return pose_graph

    def _result(self, pose_graph: PoseGraph3D) -> MappingResult:
        nodes, submaps = self._graph.optimised()
        T_map_submap = {submap.id: submap.T_map_submap for submap in submaps}
        searches = pose_graph.finished_searches()
        state = self._state(nodes, submaps, tuple(self._graph.constraints))
        own = [node for node in nodes if node.id.trajectory == self._trajectory]
        with self._log.stage("drawing"):
            cloud = self._cloud.finish(T_map_submap, nodes[-1].stamp_ns, self._setup.map_frame)
            grid = self._projection.finish(T_map_submap, self._setup.map_frame)
        if grid is None:
            self._log.warn(
                "nothing stands in the height band of the 2D map: there is none (SLAMCLI_3D.projection_min_z)"
            )
        accepted = sum(search.accepted for search in searches)
        return MappingResult(
            trajectory=self._trajectory_of_clouds(own),
            grid=grid,
            steps=self._columns(),
            summary={
                "sweeps": len(self._steps), "nodes": len(own), "submaps": len(self._submaps),
                "loop_searches": len(searches), "loop_closures": accepted, "mapped_points": len(cloud.points_m),
                "imu": len(self._local.imu) > 0, "imu_gravity": self._local.imu.has_gravity,
                "gyro_bias_rad_s": [round(float(b), 6) for b in self._local.imu.bias_rad_s],
            },
            keyframes=Trajectory(
                np.array([node.stamp_ns for node in own], dtype=np.int64),
                *se3.to_position_quaternion(np.array([node.T_map_node for node in own])),
                self._setup.map_frame,
                self._setup.base_frame,
            ),
            state=state,
            loop_searches=searches,
            cloud=cloud,
        )  # fmt: skip

    def _state(
        self, nodes: tuple[Node, ...], submaps: tuple[Submap, ...], constraints: tuple[Constraint, ...]
    ) -> MapState:
        before = self._setup.state or MapState(nodes=(), submaps=(), constraints=())
        imu = self._imu.samples()
        return replace(
            before,
            nodes=nodes,
            submaps=submaps,
            constraints=constraints,
            imu={**before.imu, **({self._trajectory: imu} if imu else {})},
            odometry={**before.odometry, **({self._trajectory: tuple(self._odometry)} if self._odometry else {})},
            fixed_frame_poses={
                **before.fixed_frame_poses, **({self._trajectory: tuple(self._fixes)} if self._fixes else {}),
            },
        )  # fmt: skip

    def _trajectory_of_clouds(self, nodes: list[Node]) -> Trajectory:
        """Return a pose for every cloud: the optimised node before it, and local SLAM from there."""
        anchors = np.array(self._anchors, dtype=np.int64)
        offsets = np.array(self._offsets).reshape(-1, 7)
        T_map_node = np.array([node.T_map_node for node in nodes])
        # Clouds before the first node were placed in the local frame itself.
        before = T_map_node[0] @ se3.inverse(nodes[0].T_local_node)
        T_map_anchor = np.where((anchors >= 0)[:, None, None], T_map_node[np.maximum(anchors, 0)], before)
        T = T_map_anchor @ se3.from_position_quaternion(offsets[:, :3], offsets[:, 3:])
        return Trajectory(
            np.array(self._stamps, dtype=np.int64),
            *se3.to_position_quaternion(T),
            self._setup.map_frame,
            self._setup.base_frame,
        )

    def _columns(self) -> dict[str, NDArray[Any]]:
        columns = list(zip(*self._steps, strict=True))
        return {
            "stamp_ns": np.array(columns[0], dtype=np.int64),
            "score": np.array(columns[1], dtype=np.float64),
            "points": np.array(columns[2], dtype=np.int64),
            "node": np.array(columns[3], dtype=np.bool_),
        }


def _submap(submap: FinishedSubmap) -> Submap:
    return Submap(
        id=Id(*submap.id),
        T_local_submap=submap.T_local_submap,
        T_map_submap=submap.T_local_submap,
        num_range_data=submap.num_range_data,
        finished=submap.finished,
        high_resolution=submap.high_resolution,
        low_resolution=submap.low_resolution,
        rotational_histogram=submap.rotational_histogram,
    )
