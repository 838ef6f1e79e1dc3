# SPDX-License-Identifier: MIT
"""Graphs in the plane from saved states, and states from graphs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import CELL_M, Loop, PoseGraph2d, TrajectoryPart
from slamcli.errors import DataError
from slamcli.geometry import se2, se3
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap


def parts_of_state(state: MapState, unit: float) -> list[TrajectoryPart]:
    """Return the trajectories of a state as parts of a graph, in which what is known to a metre weighs `unit`.

    Raises
    ------
    DataError
        If a submap has no planar grid.
    """
    return [_part(state, trajectory, unit) for trajectory in state.trajectories]


def loops_of_state(state: MapState, graph: PoseGraph2d) -> list[Loop]:
    """Return the loop constraints of a state; their positions count fully, as they were saved."""
    submaps, nodes = rows_of_ids(graph)
    return [
        Loop(submaps[c.submap], nodes[c.node], se3.to_se2(c.T_submap_node), np.zeros((2, 2)), float("nan"), 0)
        for c in state.constraints
        if c.kind == "inter" and c.submap in submaps and c.node in nodes
    ]


def rows_of_ids(graph: PoseGraph2d) -> tuple[dict[Id, int], dict[Id, int]]:
    """Return the rows of submaps and nodes by their ids."""
    submaps = [key for part in graph.parts for key in part.submap_ids]
    nodes = [key for part in graph.parts for key in part.node_ids]
    return {key: row for row, key in enumerate(submaps)}, {key: row for row, key in enumerate(nodes)}


def _part(state: MapState, trajectory: int, unit: float) -> TrajectoryPart:
    submaps = [submap for submap in state.submaps if submap.id.trajectory == trajectory]
    nodes = [node for node in state.nodes if node.id.trajectory == trajectory]
    grids = []
    for submap in submaps:
        if submap.grid is None:
            raise DataError(
                f"submap {submap.id.number} of trajectory {trajectory} of the state has no planar grid: it is no 2D state"
            )
        grids.append(submap.grid)
    places = {submap.id: row for row, submap in enumerate(submaps)}
    members: dict[Id, list[int]] = {node.id: [] for node in nodes}
    weights: dict[Id, float] = {}
    for c in state.constraints:
        if c.kind == "intra" and c.node in members and c.submap in places:
            members[c.node].append(places[c.submap])
            weights[c.node] = min(c.translation_weight, weights.get(c.node, np.inf))
    full = max(
        (c.translation_weight for c in state.constraints if c.kind == "intra" and c.node in members), default=0.0
    )
    nearest = _nearest(submaps, nodes)
    return TrajectoryPart(
        trajectory=trajectory, frozen=trajectory in state.frozen, submap_ids=[submap.id for submap in submaps],
        submap_local=_planar([submap.T_local_submap for submap in submaps]),
        submap_map=_planar([submap.T_map_submap for submap in submaps]), grids=grids,
        finished=[submap.finished for submap in submaps], node_ids=[node.id for node in nodes],
        node_local=_planar([node.T_local_node for node in nodes]), node_map=_planar([node.T_map_node for node in nodes]),
        points=[np.ascontiguousarray(node.points_m[:, :2].astype(np.float64)) for node in nodes],
        members=[sorted(members[node.id]) or [nearest[k]] * bool(submaps) for k, node in enumerate(nodes)],
        slack_m=_slack(np.array([weights.get(node.id, full) for node in nodes]), full, unit),
    )  # fmt: skip


def _slack(weights: NDArray[np.float64], full: float, unit: float) -> NDArray[np.float64]:
    """Return how uncertain the way to each node (N,) is, from what nodes weigh in their submaps: less where scans told nothing.

    It is the inverse of :meth:`PoseGraph2d.membership_weights`; where a node leaves an old submap the last step stands for its own.
    """
    slack = np.zeros(len(weights))
    if full <= 0.0 or not (weights > 0.0).all():
        return slack
    blind = np.where(weights < (1.0 - 1e-6) * full, (unit / weights) ** 2 - (unit / full) ** 2, 0.0)
    for k in np.flatnonzero(blind).tolist():
        before = blind[k - 1] if k else 0.0
        slack[k] = np.sqrt(blind[k] - before) if blind[k] > before else slack[k - 1]
    return slack


def _nearest(submaps: Sequence[Submap], nodes: Sequence[Node]) -> list[int]:
    """Return for each node the submap whose local pose is nearest: for nodes that lost theirs to a trimmer."""
    if not submaps or not nodes:
        return [0] * len(nodes)
    places = np.array([submap.T_local_submap[:2, 3] for submap in submaps])
    return [int(np.argmin(np.hypot(*(places - node.T_local_node[:2, 3]).T))) for node in nodes]


def _planar(transforms: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return se3.to_se2(np.array(transforms).reshape(-1, 4, 4))


def state_of_graph(graph: PoseGraph2d, stamps_ns: Sequence[int], before: MapState | None) -> MapState:
    """Return the graph as a state; `stamps_ns` are those of the last part's nodes, the others' are in the state `before`."""
    old_nodes = {} if before is None else {node.id: node for node in before.nodes}
    old_submaps = {} if before is None else {submap.id: submap for submap in before.submaps}
    b = graph.parameters.constraint_builder
    T_map_node, T_map_submap = se3.from_se2(graph.node), se3.from_se2(graph.submap)
    T_local_node, T_local_submap = se3.from_se2(graph.node_local), se3.from_se2(graph.submap_local)
    submap_ids = [key for part in graph.parts for key in part.submap_ids]
    node_ids = [key for part in graph.parts for key in part.node_ids]
    first_new = len(node_ids) - len(stamps_ns)
    nodes = [
        Node(
            id=key,
            stamp_ns=old_nodes[key].stamp_ns if key in old_nodes else stamps_ns[row - first_new],
            T_local_node=T_local_node[row], T_map_node=T_map_node[row],
            gravity_alignment_xyzw=old_nodes[key].gravity_alignment_xyzw if key in old_nodes else np.array([0.0, 0.0, 0.0, 1.0]),
            points_m=_flat(graph.points[row]),
        )
        for row, key in enumerate(node_ids)
    ]  # fmt: skip
    sizes = np.bincount(graph.membership[:, 0], minlength=len(submap_ids))
    finished = [value for part in graph.parts for value in part.finished]
    submaps = [
        Submap(
            id=key, T_local_submap=T_local_submap[row], T_map_submap=T_map_submap[row],
            num_range_data=old_submaps[key].num_range_data if key in old_submaps else int(sizes[row]),
            finished=finished[row], grid=graph.grids[row],
        )
        for row, key in enumerate(submap_ids)
    ]  # fmt: skip
    s, n = graph.membership.T
    intra = se3.from_se2(se2.between(graph.submap_local[s], graph.node_local[n]))
    constraints = [
        Constraint(
            submap=submap_ids[i], node=node_ids[j], T_submap_node=T, kind="intra", translation_weight=translation,
            rotation_weight=rotation,
        )
        for i, j, T, translation, rotation in zip(
            s.tolist(), n.tolist(), intra, *(weights.tolist() for weights in graph.membership_weights()), strict=True
        )
    ]  # fmt: skip
    constraints += [
        Constraint(
            submap=submap_ids[loop.submap], node=node_ids[loop.node], T_submap_node=se3.from_se2(_settled(graph, loop)), kind="inter",
            translation_weight=b.loop_closure_translation_weight, rotation_weight=b.loop_closure_rotation_weight,
        )
        for loop in graph.loops
    ]  # fmt: skip
    frozen = frozenset(part.trajectory for part in graph.parts if part.frozen)
    kept = before or MapState(nodes=(), submaps=(), constraints=())
    return MapState(
        nodes=tuple(nodes), submaps=tuple(submaps), constraints=tuple(constraints), frozen=frozen, imu=kept.imu,
        odometry=kept.odometry, fixed_frame_poses=kept.fixed_frame_poses, landmarks=kept.landmarks,
        landmark_observations=kept.landmark_observations, trajectory_data=kept.trajectory_data, options=kept.options,
    )  # fmt: skip


def _settled(graph: PoseGraph2d, loop: Loop) -> NDArray[np.float64]:
    """Return float64 (3,), what a loop says, and what the graph says along directions in which the match is ambiguous.

    A saved constraint has one weight for all directions.
    """
    c, s = np.cos(loop.relative[2]), np.sin(loop.relative[2])
    axes = np.array([[c, -s], [s, c]])  # of the node, along which the covariance is
    gain = loop.covariance @ np.linalg.inv(loop.covariance + CELL_M**2 * np.eye(2))
    error = se2.between(graph.submap[loop.submap], graph.node[loop.node])[:2] - loop.relative[:2]
    return np.append(loop.relative[:2] + axes @ gain @ axes.T @ error, loop.relative[2])


def _flat(points: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
