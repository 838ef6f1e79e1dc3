# SPDX-License-Identifier: MIT
"""A ``.pbstream`` to the state of a mapping run."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from slamcli.errors import DataError, FormatError
from slamcli.formats.pbstream import schema
from slamcli.formats.pbstream.container import read_messages
from slamcli.formats.pbstream.poses import numbers_of, transforms_of
from slamcli.formats.pbstream.records import Records, id_of
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap
from slamcli.runtime import RunLog

_VERSIONS = (1, 2)
_LEGACY_FIRST_BYTES = (0x12, 0x22)  # constraints or trajectories: the pose graph itself
_KINDS: dict[int, Literal["intra", "inter"]] = {0: "intra", 1: "inter"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateFile:
    """A ``.pbstream`` and what is in it."""

    path: Path
    version: int
    """Of the format: 2, or 1, whose 3D submaps have no histogram."""
    size_bytes: int
    state: MapState
    trajectories: tuple[int, ...]
    """All that the file names, those without nodes and submaps too."""
    messages: dict[str, int] = field(default_factory=dict)
    """Number of messages by their name."""


def read_state(path: str | os.PathLike[str], *, log: RunLog | None = None) -> MapState:
    """Return the state in a ``.pbstream``; no trajectory is frozen, the file does not say.

    Raises
    ------
    FormatError
        As `read_state_file`.
    """
    return read_state_file(path, log=log).state


def read_state_file(path: str | os.PathLike[str], *, log: RunLog | None = None) -> StateFile:
    """Return what is in a ``.pbstream`` of version 1 or 2.

    Sensor data is in the tracking frame. Poses of the graph without data and constraints without their node or submap
    (of submaps that were not finished when Cartographer saved) are left out and counted in the log.

    Raises
    ------
    FormatError
        If the file cannot be read, is damaged, or is of another version; the message names file and place.
    """
    path, log = Path(path), log or RunLog()
    messages = read_messages(path)
    version = _version(next(messages, None), path)
    graph: Any = None
    options: tuple[bytes, ...] = ()
    records = Records()
    counts: Counter[str] = Counter()
    for at, data in messages:
        message, where = _parse(schema.Data, data, path, at), f"{path}, byte {at}"
        for descriptor, value in message.ListFields():
            counts[descriptor.name] += 1
            if descriptor.name == "pose_graph":
                graph = value
            elif descriptor.name == "all_trajectory_builder_options":
                options = tuple(value.options_with_sensor_ids)
            else:
                _add(records, descriptor.name, value, where)
    if graph is None:
        raise FormatError(f"{path}: no pose graph in it; the file was cut off after its header")
    trajectories = tuple(trajectory.trajectory_id for trajectory in graph.trajectory)
    state = MapState(
        nodes=_nodes(records, graph, path, log),
        submaps=_submaps(records, graph, path, log),
        constraints=_constraints(graph, records, path, log),
        landmarks=_landmarks(graph, path),
        options=dict(zip(trajectories, options, strict=False)),
        **records.sensor_data(),
    )
    if version == 1 and any(submap.rotational_histogram is not None for submap in state.submaps):
        log.warn(
            f"{path}: of version 1, whose 3D submaps have no rotational histogram: no loop closures are found in them"
        )
    size = path.stat().st_size
    return StateFile(
        path=path, version=version, size_bytes=size, state=state, trajectories=trajectories, messages=dict(counts)
    )


def _version(first: tuple[int, bytes] | None, path: Path) -> int:
    if first is None:
        raise FormatError(f"{path}: an empty state: no message follows the first eight bytes")
    at, data = first
    if data[:1] and data[0] in _LEGACY_FIRST_BYTES:
        raise FormatError(
            f"{path}: written by Cartographer before 1.0, without a header: "
            "migrate it with Cartographer's own cartographer_migrate_serialization_format"
        )
    version = int(_parse(schema.Header, data, path, at).format_version)
    if version not in _VERSIONS:
        raise FormatError(f"{path}: format version {version}; versions 1 and 2 can be read")
    return version


def _parse(kind: Any, data: bytes, path: Path, at: int) -> Any:
    try:
        return kind.FromString(data)
    except DecodeError as error:
        raise FormatError(f"{path}, byte {at}: a message is not the protobuf it should be") from error


def _add(records: Records, kind: str, value: Any, where: str) -> None:
    try:
        records.add(kind, value, where)
    except DataError as error:
        raise FormatError(f"{where}: {error}") from error


def _poses(graph: Any, field: str, number: str, path: Path) -> dict[Id, NDArray[np.float64]]:
    ids: list[Id] = []
    numbers = []
    for trajectory in graph.trajectory:
        for entry in getattr(trajectory, field):
            ids.append(id_of(trajectory.trajectory_id, getattr(entry, number), str(path)))
            numbers.append(numbers_of(entry.pose))
    if len(set(ids)) != len(ids):
        raise FormatError(f"{path}: a {field} is in the pose graph twice")
    return dict(zip(ids, transforms_of(numbers, f"{path}: a {field} of the pose graph"), strict=True))


def _nodes(records: Records, graph: Any, path: Path, log: RunLog) -> tuple[Node, ...]:
    poses = _poses(graph, "node", "node_index", path)
    local = transforms_of([node.local_pose for node in records.nodes.values()], f"{path}: a node's local pose")
    nodes = [
        Node(
            id=key,
            stamp_ns=node.stamp_ns,
            T_local_node=T_local_node,
            T_map_node=_pose(poses, key, "node", path),
            gravity_alignment_xyzw=node.gravity_alignment_xyzw,
            points_m=node.points_m,
            low_resolution_points_m=node.low_resolution_points_m,
            rotational_histogram=node.rotational_histogram,
        )
        for (key, node), T_local_node in zip(records.nodes.items(), local, strict=True)
    ]
    _count_left_out(set(poses) - set(records.nodes), "nodes", path, log)
    return tuple(sorted(nodes, key=lambda node: node.id))


def _submaps(records: Records, graph: Any, path: Path, log: RunLog) -> tuple[Submap, ...]:
    poses = _poses(graph, "submap", "submap_index", path)
    local = transforms_of([submap.local_pose for submap in records.submaps.values()], f"{path}: a submap's local pose")
    submaps = [
        Submap(
            id=key,
            T_local_submap=T_local_submap,
            T_map_submap=_pose(poses, key, "submap", path),
            num_range_data=submap.num_range_data,
            finished=submap.finished,
            grid=submap.grid,
            high_resolution=submap.high_resolution,
            low_resolution=submap.low_resolution,
            rotational_histogram=submap.rotational_histogram,
        )
        for (key, submap), T_local_submap in zip(records.submaps.items(), local, strict=True)
    ]
    _count_left_out(set(poses) - set(records.submaps), "submaps", path, log)
    return tuple(sorted(submaps, key=lambda submap: submap.id))


def _pose(poses: dict[Id, NDArray[np.float64]], key: Id, what: str, path: Path) -> NDArray[np.float64]:
    if key not in poses:
        raise FormatError(f"{path}: {what} {key.number} of trajectory {key.trajectory} has no pose in the pose graph")
    return poses[key]


def _count_left_out(missing: set[Id], what: str, path: Path, log: RunLog) -> None:
    if missing:
        log.note(f"{path}: {len(missing)} {what} of the pose graph have no data and are left out")


def _constraints(graph: Any, records: Records, path: Path, log: RunLog) -> tuple[Constraint, ...]:
    what = f"{path}: a constraint"
    transforms = transforms_of([numbers_of(entry.relative_pose) for entry in graph.constraint], what)
    constraints, lost = [], 0
    for entry, T_submap_node in zip(graph.constraint, transforms, strict=True):
        submap = id_of(entry.submap_id.trajectory, entry.submap_id.number, what)
        node = id_of(entry.node_id.trajectory, entry.node_id.number, what)
        weights = entry.translation_weight, entry.rotation_weight
        if entry.tag not in _KINDS or not all(0 <= weight < 1e15 for weight in weights):
            raise FormatError(f"{what} from {tuple(submap)} to {tuple(node)}: kind {entry.tag}, weights {weights}")
        if submap not in records.submaps or node not in records.nodes:
            lost += 1
            continue
        constraints.append(
            Constraint(
                submap=submap,
                node=node,
                T_submap_node=T_submap_node,
                kind=_KINDS[entry.tag],
                translation_weight=weights[0],
                rotation_weight=weights[1],
            )
        )
    if lost:
        log.note(f"{path}: {lost} constraints of nodes or submaps without data are left out")
    return tuple(constraints)


def _landmarks(graph: Any, path: Path) -> dict[str, NDArray[np.float64]]:
    names = [entry.landmark_id.decode("utf-8", "surrogateescape") for entry in graph.landmark_poses]
    poses = transforms_of([numbers_of(entry.global_pose) for entry in graph.landmark_poses], f"{path}: a landmark")
    return dict(zip(names, poses, strict=True))
