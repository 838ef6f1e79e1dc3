# SPDX-License-Identifier: MIT
"""The state of a mapping run to a ``.pbstream`` that Cartographer loads."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from slamcli.formats.pbstream import grids, points, schema
from slamcli.formats.pbstream.container import MAGIC, write_message
from slamcli.formats.pbstream.poses import fill, numbers_from, ticks_of
from slamcli.formats.pbstream.sensor_messages import sensor_messages
from slamcli.outputs import atomic_file
from slamcli.posegraph import MapState, Node, Submap

_VERSION = 2
_TAGS = {"intra": 0, "inter": 1}
_NODES_AT_ONCE = 256  # so that memory does not grow with the length of the run
_NO_POINTS = np.zeros((0, 3), np.float32)


def write_state(path: str | os.PathLike[str], state: MapState) -> None:
    """Write a state as Cartographer does (version 2), unfinished submaps with their grids too.

    Kept to the last bit: grids, histograms, weights, ids, sensor readings, positions. Rounded: stamps to 100 ns, points
    to 1 mm, a few rotations in space to 2e-16. Not kept, because the format has no place for it: which trajectories are
    frozen, and velocities in odometry. Where a trajectory has no options from another file, empty ones are
    written: Cartographer wants an entry for each trajectory and, to load a state, reads nothing in it.

    Raises
    ------
    DataError
        If a pose or point is not finite, or a point farther than 8.3 km away.
    UsageError
        If the file cannot be written.
    """
    with atomic_file(path, "wb") as stream:
        stream.write(MAGIC)
        write_message(stream, schema.Header(format_version=_VERSION).SerializeToString())
        for message in _messages(state):
            write_message(stream, message.SerializeToString(deterministic=True))


def _messages(state: MapState) -> Iterator[Any]:
    nodes = sorted(state.nodes, key=lambda node: node.id)
    submaps = sorted(state.submaps, key=lambda submap: submap.id)
    yield _pose_graph(state, nodes, submaps)
    options = schema.Data()
    options.all_trajectory_builder_options.options_with_sensor_ids.extend(
        state.options.get(trajectory, b"") for trajectory in state.trajectories
    )
    options.all_trajectory_builder_options.SetInParent()
    yield options
    is_3d = any(submap.high_resolution is not None or submap.rotational_histogram is not None for submap in submaps)
    local = numbers_from((submap.T_local_submap for submap in submaps), "local submap")
    yield from (_submap(submap, pose, is_3d) for submap, pose in zip(submaps, local, strict=True))
    local = numbers_from((node.T_local_node for node in nodes), "local node")
    for first in range(0, len(nodes), _NODES_AT_ONCE):
        part = nodes[first : first + _NODES_AT_ONCE]
        clouds = points.encode([node.points_m for node in part])
        coarse = points.encode([_NO_POINTS if (p := node.low_resolution_points_m) is None else p for node in part])
        yield from map(_node, part, local[first : first + _NODES_AT_ONCE], clouds, coarse)
    yield from sensor_messages(state)


def _pose_graph(state: MapState, nodes: Sequence[Node], submaps: Sequence[Submap]) -> Any:
    data = schema.Data()
    graph = data.pose_graph
    graph.SetInParent()
    poses = numbers_from((constraint.T_submap_node for constraint in state.constraints), "constraint")
    for constraint, pose in zip(state.constraints, poses, strict=True):
        entry = graph.constraint.add()
        _fill_id(entry.submap_id, constraint.submap)
        _fill_id(entry.node_id, constraint.node)
        fill(entry.relative_pose, pose)
        entry.tag = _TAGS[constraint.kind]
        entry.translation_weight, entry.rotation_weight = constraint.translation_weight, constraint.rotation_weight
    trajectories = {number: graph.trajectory.add(trajectory_id=number) for number in state.trajectories}
    for node, pose in zip(nodes, numbers_from((node.T_map_node for node in nodes), "node"), strict=True):
        entry = trajectories[node.id.trajectory].node.add(timestamp=ticks_of(node.stamp_ns), node_index=node.id.number)
        fill(entry.pose, pose)
    for submap, pose in zip(submaps, numbers_from((submap.T_map_submap for submap in submaps), "submap"), strict=True):
        fill(trajectories[submap.id.trajectory].submap.add(submap_index=submap.id.number).pose, pose)
    landmarks = numbers_from(state.landmarks.values(), "landmark")
    for name, pose in zip(state.landmarks, landmarks, strict=True):
        fill(graph.landmark_poses.add(landmark_id=name.encode("utf-8", "surrogateescape")).global_pose, pose)
    return data


def _fill_id(message: Any, id: tuple[int, int]) -> None:
    message.trajectory, message.number = id
    message.SetInParent()


def _submap(submap: Submap, local_pose: Sequence[float], is_3d: bool) -> Any:
    data = schema.Data()
    _fill_id(data.submap.submap_id, submap.id)
    message = data.submap.submap_3d if is_3d else data.submap.submap_2d
    fill(message.local_pose, local_pose)
    message.num_range_data, message.finished = submap.num_range_data, submap.finished
    if submap.grid is not None:
        grids.fill_grid(message.grid, submap.grid)
    if submap.high_resolution is not None:
        grids.fill_hybrid_grid(message.high_resolution_hybrid_grid, submap.high_resolution)
    if submap.low_resolution is not None:
        grids.fill_hybrid_grid(message.low_resolution_hybrid_grid, submap.low_resolution)
    if submap.rotational_histogram is not None:
        message.rotational_scan_matcher_histogram.extend(submap.rotational_histogram.tolist())
    return data


def _node(
    node: Node, local_pose: Sequence[float], points_m: tuple[int, bytes], low_resolution_points_m: tuple[int, bytes]
) -> Any:
    data = schema.Data()
    _fill_id(data.node.node_id, node.id)
    message = data.node.node_data
    message.timestamp = ticks_of(node.stamp_ns)
    quat = message.gravity_alignment
    quat.x, quat.y, quat.z, quat.w = np.asarray(node.gravity_alignment_xyzw, np.float64).tolist()
    fill(message.local_pose, local_pose)
    flat, high = message.filtered_gravity_aligned_point_cloud, message.high_resolution_point_cloud
    low = message.low_resolution_point_cloud
    for cloud in (flat, high, low):
        cloud.SetInParent()
    is_3d = node.low_resolution_points_m is not None or node.rotational_histogram is not None
    cloud = high if is_3d else flat
    cloud.num_points, cloud.point_data = points_m
    low.num_points, low.point_data = low_resolution_points_m
    if node.rotational_histogram is not None:
        message.rotational_scan_matcher_histogram.extend(node.rotational_histogram.tolist())
    return data
