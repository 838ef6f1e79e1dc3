# SPDX-License-Identifier: MIT
"""What a run ends with, in the frame of its map."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.mapper import MappingResult, Setup
from slamcli.posegraph.keyframe_graph import EDGE_KINDS, EdgeKind, KeyframeGraph
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.frame_track import FrameTrack
from slamcli.rtabmap.joined_maps import chosen_component, what_joined
from slamcli.rtabmap.links import CLOSURES, Link, LinkKind
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.maps import build_maps
from slamcli.rtabmap.node_pictures import node_views, place_views
from slamcli.rtabmap.node_views import NodeViews
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.run_figures import place_closures, stamps_of, summary_of, tell_what_is_missing
from slamcli.rtabmap.session import Session
from slamcli.rtabmap.signature import NodeImages, NodeScan
from slamcli.rtabmap.turning_upright import find_level_floor, find_upright
from slamcli.rtabmap.update_record import columns
from slamcli.trajectory import Trajectory
from slamcli.vision.pictures import KeyframeView, PlaceView

Floats = NDArray[np.float64]

_EDGES: dict[LinkKind, EdgeKind] = {
    LinkKind.GLOBAL_CLOSURE: "loop", LinkKind.USER_CLOSURE: "loop", LinkKind.LOCAL_SPACE_CLOSURE: "proximity",
    LinkKind.LOCAL_TIME_CLOSURE: "proximity",
}  # fmt: skip
"""What is not odometry."""


def keyframe_graph(graph: MapGraph, ids: list[int]) -> KeyframeGraph:
    """Return nodes and the links between them as other tools take them; odometry, loops, and what was near."""
    row_of = {node_id: row for row, node_id in enumerate(ids)}
    wanted = (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED, *CLOSURES)
    links = [link for link in graph.links_among(ids) if link.kind in wanted and link.from_id != link.to_id]
    ordered = [_ascending(link) for link in links]
    kinds = [EDGE_KINDS.index(_EDGES.get(link.kind, "odometry")) for link in ordered]
    return KeyframeGraph(
        stamps_ns=np.array([graph.nodes[node_id].stamp_ns for node_id in ids], dtype=np.int64),
        T_map_base=np.array([graph.T_map_base[node_id] for node_id in ids]),
        pairs=np.array([(row_of[link.from_id], row_of[link.to_id]) for link in ordered], dtype=np.int64).reshape(-1, 2),
        shared=np.zeros(len(ordered), dtype=np.int64),
        kinds=np.array(kinds, dtype=np.int64),
        T_first_second=np.array([link.T_from_to for link in ordered]).reshape(-1, 4, 4),
        information=np.array([link.information for link in ordered]).reshape(-1, 6, 6),
        ids=np.array(ids, dtype=np.int64),
    )


def _ascending(link: Link) -> Link:
    """Return a link that leads from the smaller id to the larger one."""
    return link if link.from_id < link.to_id else link.inverse()


def result_of(session: Session, track: FrameTrack, parameters: RtabmapParameters, setup: Setup) -> MappingResult:
    """Return trajectory, nodes and maps, and close the database."""
    graph, database = session.graph, session.keeping.database
    ids = chosen_component(graph, session.own_nodes, localising=session.localising)
    joined = what_joined(graph, ids, session.own_nodes)
    if joined:
        setup.log.note(joined)
    sensors = partial(_sensors, database)
    up, floor_m = _turn_upright(session, ids, setup)
    placed = track.placed({node_id: graph.T_map_base[node_id] for node_id in ids})
    if session.localising:  # the map is what it was
        ids = [node_id for node_id in ids if node_id in session.closing.fixed.ids]
    T_map_node = np.array([graph.T_map_base[node_id] for node_id in ids])
    stamps = np.array([graph.nodes[node_id].stamp_ns for node_id in ids], dtype=np.int64)
    if not parameters.rgbd.create_occupancy_grid:
        setup.log.note(
            "RGBD/CreateOccupancyGrid is off: no map of the plane is made (--set RGBD/CreateOccupancyGrid=true)"
        )
    maps = build_maps(
        zip(ids, T_map_node, strict=True), sensors, parameters, map_frame=setup.map_frame, stamp_ns=int(stamps[-1]),
        octree=setup.octree, floor_m=floor_m, keep=None if session.localising else session.keeping.keep_grid,
    )  # fmt: skip
    pictures = _pictures(session)
    closures = place_closures(session.closing.records, database)
    summary = summary_of(session, track, ids, placed, closures, parameters)
    tell_what_is_missing(
        track, placed, graph, session.own_nodes, setup.log, "frame" if setup.rig is not None else "scan"
    )
    session.close(ids, maps.grid)
    return MappingResult(
        trajectory=_trajectory(placed.stamps_ns, placed.T_map_base, setup),
        keyframes=_trajectory(stamps, T_map_node, setup),
        keyframe_graph=keyframe_graph(graph, ids), steps=columns(session.records), grid=maps.grid, cloud=maps.cloud,
        octree=maps.octree, summary={**summary, "up_from": up}, closures=closures,
        keyframe_views=pictures[0], place_views=pictures[1],
        database=None if setup.database is None else setup.database.path,
        views=None if setup.database is None or setup.rig is None else NodeViews(
            database=setup.database.path, ids=np.array(ids, dtype=np.int64), T_map_base=T_map_node,
        ),
    )  # fmt: skip


def _pictures(session: Session) -> tuple[tuple[KeyframeView, ...], tuple[PlaceView, ...]]:
    """Return what the report shows of nodes of this run, and of closures."""
    database, stamp_of = session.keeping.database, stamps_of(session.keeping.database)
    own = [node_id for node_id in session.own_nodes if node_id in stamp_of]
    views = node_views(database, own, np.array([stamp_of[node_id] for node_id in own], dtype=np.int64))
    return views, place_views(database, session.closing.sights, stamp_of, session.own_nodes[0])


def _sensors(database: Database, node_id: int) -> tuple[NodeImages | None, NodeScan | None]:
    return database.read_images(node_id), database.read_scan(node_id)


def _turn_upright(session: Session, ids: list[int], setup: Setup) -> tuple[str, float | None]:
    """Turn the map so that z is up, unless its base is known to be upright; return what told it, and z of the floor if that did."""
    graph = session.graph
    known = setup.rig is None or setup.rig.base_is_upright
    if known:
        return "base", None
    T_map_base = np.array([graph.T_map_base[node_id] for node_id in ids])
    sensors = partial(_sensors, session.keeping.database)
    level = any(link.kind == LinkKind.GRAVITY for link in graph.links_among(ids))
    if level or ids[0] not in session.own_nodes:
        return "imu" if level else "database", find_level_floor(ids, T_map_base, sensors, setup.seed)
    T_up_map, found = find_upright(ids, T_map_base, session.closing.T_base_camera, sensors, setup.seed)
    graph.place(ids, T_up_map @ T_map_base)
    return found.source, found.floor_m


def _trajectory(stamps_ns: NDArray[np.int64], T_map_base: Floats, setup: Setup) -> Trajectory:
    positions, quats = se3.to_position_quaternion(T_map_base)
    return Trajectory(stamps_ns, positions, quats, frame_id=setup.map_frame, child_frame_id=setup.base_frame)
