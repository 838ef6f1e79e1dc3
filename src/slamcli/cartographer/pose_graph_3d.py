# SPDX-License-Identifier: MIT
"""Global SLAM in space: search for loops, adjust all poses, and search again until nothing is added (Hess et al., V)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.constraints_3d import search_all
from slamcli.cartographer.graph_3d import Graph3D
from slamcli.cartographer.loop_candidates_3d import loop_candidates
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.geometry import quaternion, se3
from slamcli.posegraph import Constraint, Id, LoopSearch
from slamcli.posegraph.inertial import Inertia, inertia_of, joined
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.spatial import SpatialEdges, optimise_spatial
from slamcli.runtime import RunLog

CONTRADICTS_M, CONTRADICTS_RAD = 0.5, 0.03
"""A loop closure that is further off after the optimisation contradicts the others and is dropped."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuRecord:
    """Samples of one trajectory's IMU in the base frame, without the gyroscope's bias."""

    stamps_ns: NDArray[np.int64]
    rates_rad_s: NDArray[np.float64]
    forces_m_s2: NDArray[np.float64]
    has_gravity: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixRecord:
    """Fixed-frame poses of one trajectory (GPS): where the frame's origin sees a point of the robot."""

    stamps_ns: NDArray[np.int64]
    positions_m: NDArray[np.float64]
    """float64 (N, 3), in the fixed frame."""
    lever_base_m: NDArray[np.float64]
    """float64 (3,), the antenna in the base frame."""


class PoseGraph3D:
    """Loop search and sparse pose adjustment over all trajectories."""

    def __init__(
        self,
        graph: Graph3D,
        parameters: CartographerParameters,
        imu: Mapping[int, ImuRecord],
        fixes: Mapping[int, FixRecord],
        jobs: int,
        log: RunLog,
    ) -> None:
        self.graph, self._p, self._jobs, self._log = graph, parameters, jobs, log
        self._imu, self._fixes = imu, fixes
        self.searches: list[LoopSearch] = []
        self.fixed_frames: dict[int, NDArray[np.float64]] = {}

    def finish(self) -> None:
        """Search all pairs and adjust the poses, again and again until nothing is added; no rounds leave local SLAM's poses."""
        rounds = self._p.slamcli_3d.search_rounds
        if rounds and not self._p.pose_graph.batch_search.enabled:
            rounds = 1
        iterations = self._p.pose_graph.max_num_final_iterations
        tried: set[tuple[Id, Id]] = {(c.submap, c.node) for c in self.graph.constraints}
        for number in range(rounds):
            candidates = loop_candidates(self.graph, self._p, tried, wide=number == 0)
            searches, constraints = search_all(self.graph, candidates, self._p, self._jobs, number)
            self.searches += searches
            self.graph.constraints += constraints
            tried |= {(c.submap, c.node) for c in constraints}
            if not constraints and number > 0:
                break
            self.optimise(iterations)
            self._drop_contradictions(iterations)
            if not constraints:
                break

    def optimise(self, iterations: int) -> None:
        """Adjust the poses of all submaps and nodes that are not frozen."""
        graph = self.graph
        if not graph.nodes:
            return
        edges, loss = self._edges(), Loss(kind="huber", scale=self._p.pose_graph.optimization_problem.huber_scale)
        fixes, frames = self._fix_edges()
        before, held = np.concatenate([graph.T_map_submap, graph.T_map_node, frames]), self._held(len(frames))
        solution = optimise_spatial(
            _rows(before), held, edges, loss=loss, max_iterations=iterations,
            more=[(fixes, self._fix_loss())] if len(fixes) else (), inertia=self._inertia(),
        )  # fmt: skip
        T = se3.from_position_quaternion(solution.poses[:, :3], solution.poses[:, 3:])
        T[held.all(axis=1)] = before[held.all(axis=1)]  # to the last digit: frozen maps stay as they were saved
        count = len(graph.submaps)
        graph.T_map_submap, graph.T_map_node = T[:count], T[count : count + len(graph.nodes)]
        self.fixed_frames = dict(zip(sorted(self._fixes), T[count + len(graph.nodes) :], strict=False))

    def _drop_contradictions(self, iterations: int) -> None:
        """Drop loop closures that the others contradict, and adjust once more without them."""
        inter = [c for c in self.graph.constraints if c.kind == "inter"]
        distance, angle = self._residuals(inter)
        bad = {(c.submap, c.node) for c, d, a in zip(inter, distance, angle, strict=True)
               if d > CONTRADICTS_M or a > CONTRADICTS_RAD}  # fmt: skip
        if not bad:
            return
        self.graph.constraints = [
            c for c in self.graph.constraints if c.kind == "intra" or (c.submap, c.node) not in bad
        ]
        self.searches = [
            replace(s, accepted=False, reason="contradicts the other constraints")
            if s.accepted and (s.submap, s.node) in bad
            else s
            for s in self.searches
        ]
        self.optimise(iterations)

    def finished_searches(self) -> tuple[LoopSearch, ...]:
        """Return all searches with the residuals of those that were accepted."""
        by_pair = {(c.submap, c.node): c for c in self.graph.constraints if c.kind == "inter"}
        chosen = [by_pair[s.submap, s.node] for s in self.searches if s.accepted]
        residuals = iter(zip(*self._residuals(chosen), strict=True))
        out = []
        for search in self.searches:
            if search.accepted:
                distance, angle = next(residuals)
                search = replace(search, translation_residual_m=float(distance), rotation_residual_rad=float(angle))
            out.append(search)
        return tuple(out)

    def _residuals(self, constraints: list[Constraint]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if not constraints:
            return np.zeros(0), np.zeros(0)
        submaps = self.graph.T_map_submap[[self.graph.submap_row(c.submap) for c in constraints]]
        nodes = self.graph.T_map_node[[self.graph.node_row(c.node) for c in constraints]]
        said = np.array([c.T_submap_node for c in constraints])
        off = se3.inverse(said) @ se3.inverse(submaps) @ nodes
        quats = quaternion.from_matrix(off[:, :3, :3])
        return np.linalg.norm(off[:, :3, 3], axis=1), 2.0 * np.arctan2(
            np.linalg.norm(quats[:, :3], axis=1), quats[:, 3]
        )

    def _edges(self) -> SpatialEdges:
        """Return the constraints, then the steps of local SLAM between consecutive nodes."""
        graph, problem = self.graph, self._p.pose_graph.optimization_problem
        first = [graph.submap_row(c.submap) for c in graph.constraints]
        second = [len(graph.submaps) + graph.node_row(c.node) for c in graph.constraints]
        measured = [c.T_submap_node for c in graph.constraints]
        translation = [c.translation_weight for c in graph.constraints]
        rotation = [c.rotation_weight for c in graph.constraints]
        robust = [c.kind == "inter" for c in graph.constraints]
        for trajectory in sorted({node.id.trajectory for node in graph.nodes} - graph.frozen):
            rows = graph.trajectory_rows(trajectory)
            for a, b in itertools.pairwise(rows):
                if graph.nodes[b].id.number != graph.nodes[a].id.number + 1:
                    continue  # nodes between them were trimmed
                first.append(len(graph.submaps) + int(a))
                second.append(len(graph.submaps) + int(b))
                measured.append(se3.inverse(graph.nodes[a].T_local_node) @ graph.nodes[b].T_local_node)
                translation.append(problem.local_slam_pose_translation_weight)
                rotation.append(problem.local_slam_pose_rotation_weight)
                robust.append(False)
        return SpatialEdges(
            first=np.array(first, dtype=np.int64), second=np.array(second, dtype=np.int64),
            measured=_rows(np.array(measured).reshape(-1, 4, 4)), translation_weight=np.array(translation),
            rotation_weight=np.array(rotation), robust=np.array(robust, dtype=np.bool_),
        )  # fmt: skip

    def _fix_edges(self) -> tuple[SpatialEdges, NDArray[np.float64]]:
        """Return what GPS says of nodes, and the first guess of each fixed frame's origin in the map (F, 4, 4)."""
        graph, problem = self.graph, self._p.pose_graph.optimization_problem
        firsts, seconds, measured, frames = [], [], [], []
        for number, trajectory in enumerate(sorted(self._fixes)):
            fix, rows = self._fixes[trajectory], graph.trajectory_rows(trajectory)
            stamps = np.array([graph.nodes[i].stamp_ns for i in rows], dtype=np.int64)
            inside = (stamps >= fix.stamps_ns[0]) & (stamps <= fix.stamps_ns[-1])
            rows, stamps = rows[inside], stamps[inside]
            at = np.stack([np.interp(stamps, fix.stamps_ns, fix.positions_m[:, d]) for d in range(3)], axis=1)
            lever = graph.T_map_node[rows, :3, :3] @ fix.lever_base_m
            antenna = graph.T_map_node[rows, :3, 3] + lever
            frame = self.fixed_frames.get(trajectory)
            frames.append(_yaw_alignment(at, antenna) if frame is None else frame)
            for row, position, arm in zip(rows, at, lever, strict=True):
                firsts.append(len(graph.submaps) + len(graph.nodes) + number)
                seconds.append(len(graph.submaps) + int(row))
                T = np.eye(4)
                T[:3, 3] = position - frames[-1][:3, :3].T @ arm
                measured.append(T)
        count = len(firsts)
        return SpatialEdges(
            first=np.array(firsts, dtype=np.int64), second=np.array(seconds, dtype=np.int64),
            measured=_rows(np.array(measured).reshape(-1, 4, 4)),
            translation_weight=np.full(count, problem.fixed_frame_pose_translation_weight),
            rotation_weight=np.zeros(count), robust=np.ones(count, dtype=np.bool_),
        ), np.array(frames).reshape(-1, 4, 4)  # fmt: skip

    def _fix_loss(self) -> Loss:
        problem = self._p.pose_graph.optimization_problem
        if problem.fixed_frame_pose_use_tolerant_loss:
            return Loss(
                kind="tolerant", scale=problem.fixed_frame_pose_tolerant_loss_param_a,
                sharpness=problem.fixed_frame_pose_tolerant_loss_param_b,
            )  # fmt: skip
        return Loss()

    def _held(self, num_frames: int) -> NDArray[np.bool_]:
        """Return what is fixed: frozen trajectories, otherwise the first submap; roll and pitch only where no IMU levels them."""
        graph = self.graph
        ids = [submap.id for submap in graph.submaps] + [node.id for node in graph.nodes]
        held = np.zeros((len(ids) + num_frames, 6), dtype=np.bool_)
        held[: len(ids)] = np.array([one.trajectory in graph.frozen for one in ids])[:, None]
        if not graph.frozen and graph.submaps:
            first = min(range(len(graph.submaps)), key=lambda i: graph.submaps[i].id)
            levelled = any(record.has_gravity for record in self._imu.values())
            held[first] = [True, True, True, not levelled, not levelled, True]
        held[len(ids) :, 3:5] = True  # a fixed frame's z is up
        if self._p.pose_graph.optimization_problem.fix_z_in_3d:
            held[:, 2] = True
        return held

    def _inertia(self) -> Inertia | None:
        problem = self._p.pose_graph.optimization_problem
        found = []
        for trajectory in sorted(self._imu):
            record, rows = self._imu[trajectory], self.graph.trajectory_rows(trajectory)
            if trajectory in self.graph.frozen or len(rows) < 3 or len(record.stamps_ns) < 2:
                continue
            if not record.has_gravity:
                continue
            found.append(
                inertia_of(
                    np.array([self.graph.nodes[i].stamp_ns for i in rows], dtype=np.int64),
                    len(self.graph.submaps) + rows,
                    record.stamps_ns,
                    record.rates_rad_s,
                    record.forces_m_s2,
                    acceleration_weight=problem.acceleration_weight,
                    rotation_weight=problem.rotation_weight,
                    estimate_extrinsics=problem.use_online_imu_extrinsics_in_3d,
                )
            )
        return joined(found) if found else None


def _rows(T: NDArray[np.float64]) -> NDArray[np.float64]:
    position, quat = se3.to_position_quaternion(T)
    return np.concatenate([position, quat], axis=1)


def _yaw_alignment(fixed: NDArray[np.float64], in_map: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pose (4, 4) of the fixed frame in the map, turned about z only, from paired points (N, 3)."""
    T = np.eye(4)
    if len(fixed):
        a, b = fixed - fixed.mean(axis=0), in_map - in_map.mean(axis=0)
        yaw = np.arctan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a[:, :2] * b[:, :2]).sum()))
        T[:3, :3] = quaternion.to_matrix(quaternion.from_yaw(yaw))
        T[:3, 3] = in_map.mean(axis=0) - T[:3, :3] @ fixed.mean(axis=0)
    return T
