# SPDX-License-Identifier: MIT
"""What a run ends with, in the frame of its map."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.mapper import MappingResult, Setup
from slamcli.posegraph.keyframe_graph import EDGE_KINDS, KeyframeGraph
from slamcli.rtabmap.frame_track import FrameTrack, PlacedFrames
from slamcli.rtabmap.links import CLOSURES, Link, LinkKind
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.session import Session
from slamcli.rtabmap.update_record import columns
from slamcli.trajectory import Trajectory

Floats = NDArray[np.float64]


def chosen_component(graph: MapGraph, own_nodes: list[int]) -> list[int]:
    """Return the ids, increasing, of the nodes of the map that holds most nodes of this run; the older of two equal ones.

    Raises
    ------
    EstimationError
        If the run has no nodes.
    """
    if not own_nodes:
        raise EstimationError("rtabmap: no node was made")
    component_of: dict[int, int] = {}
    members: dict[int, list[int]] = {}
    for node_id in own_nodes:
        if node_id not in component_of:
            found = [other for other in graph.component(node_id) if other in graph.nodes]
            members[found[0]] = found
            component_of.update(dict.fromkeys(found, found[0]))
    counts = Counter(component_of[node_id] for node_id in own_nodes)
    return members[min(counts, key=lambda first: (-counts[first], first))]


def trajectory_of(placed: PlacedFrames, setup: Setup) -> Trajectory:
    """Return the poses of frames as a trajectory."""
    positions, quats = se3.to_position_quaternion(placed.T_map_base)
    return Trajectory(placed.stamps_ns, positions, quats, frame_id=setup.map_frame, child_frame_id=setup.base_frame)


def keyframe_graph(graph: MapGraph, ids: list[int]) -> KeyframeGraph:
    """Return nodes and the links between them as other tools take them; odometry is the tree, closures are loops."""
    row_of = {node_id: row for row, node_id in enumerate(ids)}
    wanted = (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED, *CLOSURES)
    links = [link for link in graph.links_among(ids) if link.kind in wanted and link.from_id != link.to_id]
    ordered = [_ascending(link) for link in links]
    kinds = [EDGE_KINDS.index("loop" if link.kind in CLOSURES else "tree") for link in ordered]
    return KeyframeGraph(
        stamps_ns=np.array([graph.nodes[node_id].stamp_ns for node_id in ids], dtype=np.int64),
        T_map_base=np.array([graph.T_map_base[node_id] for node_id in ids]),
        pairs=np.array([(row_of[link.from_id], row_of[link.to_id]) for link in ordered], dtype=np.int64).reshape(-1, 2),
        shared=np.zeros(len(ordered), dtype=np.int64),
        kinds=np.array(kinds, dtype=np.int64),
        T_first_second=np.array([link.T_from_to for link in ordered]).reshape(-1, 4, 4),
        information=np.array([link.information for link in ordered]).reshape(-1, 6, 6),
    )


def _ascending(link: Link) -> Link:
    """Return a link that leads from the smaller id to the larger one."""
    return link if link.from_id < link.to_id else link.inverse()


def summary_of(session: Session, track: FrameTrack, ids: list[int], placed: PlacedFrames) -> dict[str, Any]:
    """Return the figures for ``run.json``."""
    graph, own = session.graph, set(session.own_nodes)
    kinds = Counter(link.kind for link in graph.links)
    lost = track.num_lost
    return {
        "frames": len(track.stamps_ns),
        "lost": lost,
        "in other maps": len(track.stamps_ns) - lost - len(placed.rows),
        "odometry_resets": max(track.num_stretches - 1, 0),
        "nodes": len(own),
        "nodes in the map": len(ids),
        "sessions joined": len({graph.nodes[node_id].map_id for node_id in ids}),
        "sessions": len({node.map_id for node in graph.nodes.values()}),
        "loop_closures": kinds[LinkKind.GLOBAL_CLOSURE],
        "proximity_closures": kinds[LinkKind.LOCAL_SPACE_CLOSURE] + kinds[LinkKind.LOCAL_TIME_CLOSURE],
        "closures_refused": sum(not record.accepted for record in session.closures),
    }


def step_columns(session: Session) -> dict[str, NDArray[Any]]:
    """Return the per-update statistics."""
    return columns(session.records)
