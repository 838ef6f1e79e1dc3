# SPDX-License-Identifier: MIT
"""Pose graphs as g2o's text files, read and written without loss (Kümmerle et al., ICRA 2011).

One vertex, edge or list of fixed vertices per line::

    VERTEX_SE2 id x y yaw
    EDGE_SE2 from to x y yaw  information (upper triangle by rows, 6 numbers)
    VERTEX_SE3:QUAT id x y z qx qy qz qw
    EDGE_SE3:QUAT from to x y z qx qy qz qw  information (upper triangle by rows, 21 numbers)
    FIX id ...

Metres and radians. An edge's information weighs the pose of ``to`` as it is seen from ``from``, along the axes of the
measured pose: x, y, yaw, or translation before rotation. Lines with other tags are left out with a note.

References
----------
R. Kümmerle, G. Grisetti, H. Strasdat, K. Konolige, W. Burgard, "g2o: A General Framework for Graph Optimization", ICRA
2011, doi:10.1109/ICRA.2011.5979949.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats import text_tables
from slamcli.geometry import se3
from slamcli.outputs import atomic_file
from slamcli.posegraph import Id, MapState
from slamcli.runtime import RunLog

_WHAT = "a g2o pose graph"
_TAGS = {
    "VERTEX_SE2": (2, "vertex"),
    "EDGE_SE2": (2, "edge"),
    "VERTEX_SE3:QUAT": (3, "vertex"),
    "EDGE_SE3:QUAT": (3, "edge"),
}
_POSE_SIZES = {2: 3, 3: 7}
_FREEDOMS = {2: 3, 3: 6}
_LARGEST_ID = 1 << 62
_LEVEL = 1e-9  # m or rad by which a pose may leave the plane and still be planar


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class G2oGraph:
    """Vertices, edges and fixed vertices of a g2o file."""

    dimension: int
    """2 or 3."""
    ids: NDArray[np.int64]
    """int64 (V,), numbers of the vertices."""
    poses: NDArray[np.float64]
    """float64 (V, 3) x, y, yaw, or (V, 7) x, y, z, qx, qy, qz, qw; metres, radians."""
    first: NDArray[np.int64]
    """int64 (E,), number of the vertex from which an edge's pose is measured."""
    second: NDArray[np.int64]
    """int64 (E,), number of the vertex that is seen."""
    measured: NDArray[np.float64]
    """float64 (E, 3) or (E, 7), pose of the second in the first."""
    information: NDArray[np.float64]
    """float64 (E, 3, 3) or (E, 6, 6), symmetric."""
    fixed: NDArray[np.int64]
    """int64 (F,), numbers of the vertices that an optimiser must not move."""
    comments: tuple[str, ...] = ()
    """Remarks, a line each."""


def read_g2o(path: str | os.PathLike[str], *, log: RunLog | None = None) -> G2oGraph:
    """Return the pose graph of a file.

    Parameters
    ----------
    path
        The file.
    log
        Takes a note of lines with unknown tags.

    Raises
    ------
    FormatError
        If the file cannot be read, a line does not have the numbers its tag asks for, poses in the plane and in space
        are mixed, a vertex comes twice, an edge names a vertex that there is none of, or there is no vertex.
    """
    rows: dict[str, list[text_tables.Row]] = {"vertex": [], "edge": [], "fix": []}
    comments: list[str] = []
    unknown: Counter[str] = Counter()
    dimension = 0
    for row in text_tables.read_rows(path, _WHAT, comments=True):
        tag = row.fields[0] if row.fields else ""
        if row.comment:
            comments.append((", " if row.commas else " ").join(row.fields))
        elif tag == "FIX":
            rows["fix"].append(row)
        elif tag in _TAGS:
            of, kind = _TAGS[tag]
            if dimension not in (0, of):
                raise FormatError(
                    f"{path}, line {row.line}: {tag} in a graph of {dimension}D poses: g2o files with both are not read"
                )
            dimension = of
            rows[kind].append(row)
        else:
            unknown[tag] += 1
    if not rows["vertex"]:
        raise FormatError(f"{path}: no VERTEX_SE2 or VERTEX_SE3:QUAT in it: this is not {_WHAT}")
    if unknown and log is not None:
        tags = ", ".join(f"{count} x {text_tables.shown(tag)}" for tag, count in sorted(unknown.items())[:5])
        more = f" and {len(unknown) - 5} other tags" if len(unknown) > 5 else ""
        log.note(f"{path}: {unknown.total()} lines with other tags are left out: {tags}{more}")
    return _graph(path, dimension, rows, tuple(comments))


def _graph(
    path: str | os.PathLike[str], dimension: int, rows: dict[str, list[text_tables.Row]], comments: tuple[str, ...]
) -> G2oGraph:
    """Return the graph of sorted lines."""
    size, freedom = _POSE_SIZES[dimension], _FREEDOMS[dimension]
    vertices = [_parse(path, row, 1, size) for row in rows["vertex"]]
    edges = [_parse(path, row, 2, size + freedom * (freedom + 1) // 2) for row in rows["edge"]]
    ids = np.array([numbers[0] for numbers, _ in vertices], np.int64)
    _check_vertices(path, rows["vertex"], ids.tolist())
    known = set(ids.tolist())
    for row, (numbers, _) in zip(rows["edge"], edges, strict=True):
        for number in numbers:
            if number not in known:
                raise FormatError(f"{path}, line {row.line}: an edge names vertex {number}, which is not in the file")
    fixed = [number for row in rows["fix"] for number in _parse_ids(path, row, row.fields[1:])]
    ends = np.array([numbers for numbers, _ in edges], np.int64).reshape(-1, 2)
    values = np.array([numbers for _, numbers in edges]).reshape(-1, size + freedom * (freedom + 1) // 2)
    information = np.zeros((len(edges), freedom, freedom))
    if len(edges):
        upper = np.triu_indices(freedom)
        information[:, upper[0], upper[1]] = information[:, upper[1], upper[0]] = values[:, size:]
    poses, measured = np.array([numbers for _, numbers in vertices]), values[:, :size].reshape(-1, size).copy()
    if dimension == 3:
        _check_quaternions(path, rows["vertex"], poses)
        _check_quaternions(path, rows["edge"], measured)
    return G2oGraph(
        dimension=dimension, ids=ids, poses=poses, first=ends[:, 0].copy(), second=ends[:, 1].copy(), measured=measured,
        information=information, fixed=np.array(fixed, np.int64), comments=comments,
    )  # fmt: skip


def _parse(path: str | os.PathLike[str], row: text_tables.Row, ids: int, numbers: int) -> tuple[list[int], list[float]]:
    """Return the vertices' numbers and the values of a line."""
    if len(row.fields) != 1 + ids + numbers:
        raise FormatError(
            f"{path}, line {row.line}: {row.fields[0]} with {len(row.fields) - 1} numbers, not {ids + numbers}"
        )
    found = _parse_ids(path, row, row.fields[1 : 1 + ids])
    return found, text_tables.parse_numbers(row.fields[1 + ids :], path, row.line)


def _parse_ids(path: str | os.PathLike[str], row: text_tables.Row, fields: Sequence[str]) -> list[int]:
    found = []
    for field in fields:
        if not (field.isascii() and field.isdigit() and len(field) < 20 and int(field) < _LARGEST_ID):
            raise FormatError(f"{path}, line {row.line}: {text_tables.shown(field)} is not the number of a vertex")
        found.append(int(field))
    return found


def _check_vertices(path: str | os.PathLike[str], rows: Sequence[text_tables.Row], ids: Sequence[int]) -> None:
    seen: dict[int, int] = {}
    for row, number in zip(rows, ids, strict=True):
        if number in seen:
            raise FormatError(f"{path}, line {row.line}: vertex {number} comes twice, first in line {seen[number]}")
        seen[number] = row.line


def _check_quaternions(
    path: str | os.PathLike[str], rows: Sequence[text_tables.Row], poses: NDArray[np.float64]
) -> None:
    zero = np.flatnonzero(np.abs(poses[:, 3:]).max(axis=1, initial=0.0) < 1e-12)
    if len(zero):
        raise FormatError(f"{path}, line {rows[zero[0]].line}: a quaternion of zeros is not a rotation")


def write_g2o(path: str | os.PathLike[str], graph: G2oGraph) -> None:
    """Write a graph: vertices, edges, fixed vertices, comments (GTSAM stops at these); numbers at full precision.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    vertex, edge = ("VERTEX_SE2", "EDGE_SE2") if graph.dimension == 2 else ("VERTEX_SE3:QUAT", "EDGE_SE3:QUAT")
    upper = np.triu_indices(_FREEDOMS[graph.dimension])
    triangles = graph.information[:, upper[0], upper[1]].tolist()
    ends = zip(graph.first.tolist(), graph.second.tolist(), strict=True)
    with atomic_file(path) as stream:
        for number, pose in zip(graph.ids.tolist(), graph.poses.tolist(), strict=True):
            stream.write(f"{vertex} {number} {' '.join(map(repr, pose))}\n")
        for (first, second), pose, triangle in zip(ends, graph.measured.tolist(), triangles, strict=True):
            stream.write(f"{edge} {first} {second} {' '.join(map(repr, [*pose, *triangle]))}\n")
        stream.writelines(f"FIX {number}\n" for number in graph.fixed.tolist())
        stream.writelines(f"# {comment}\n" for comment in graph.comments)


def graph_of_state(state: MapState) -> G2oGraph:
    """Return the pose graph of a mapping run: its submaps, nodes and the constraints between them.

    Vertices 0 to S - 1 are the S submaps in the order of their trajectory and number, S and on the nodes likewise; the
    comments say which. The first submap is fixed, and everything of frozen trajectories. Information is the square of a
    constraint's weights. The graph is planar if every pose in it is. Constraints whose submap or node is gone are left
    out.
    """
    submaps = sorted(state.submaps, key=lambda submap: submap.id)
    nodes = sorted(state.nodes, key=lambda node: node.id)
    submap_numbers = {submap.id: i for i, submap in enumerate(submaps)}
    node_numbers = {node.id: len(submaps) + i for i, node in enumerate(nodes)}
    kept = [c for c in state.constraints if c.submap in submap_numbers and c.node in node_numbers]
    poses = np.array([*(s.T_map_submap for s in submaps), *(n.T_map_node for n in nodes)]).reshape(-1, 4, 4)
    measured = np.array([c.T_submap_node for c in kept]).reshape(-1, 4, 4)
    dimension = 2 if _is_planar(poses) and _is_planar(measured) else 3
    freedom = _FREEDOMS[dimension]
    information = np.zeros((len(kept), freedom, freedom))
    for i, constraint in enumerate(kept):
        moves = dimension  # x, y or x, y, z
        weights = [constraint.translation_weight] * moves + [constraint.rotation_weight] * (freedom - moves)
        information[i] = np.diag(np.square(weights))
    everything = [*(s.id for s in submaps), *(n.id for n in nodes)]
    fixed = [i for i, of in enumerate(everything) if of.trajectory in state.frozen or (i == 0 and submaps)]
    return G2oGraph(
        dimension=dimension, ids=np.arange(len(everything)), poses=_rows(poses, dimension),
        first=np.array([submap_numbers[c.submap] for c in kept], np.int64),
        second=np.array([node_numbers[c.node] for c in kept], np.int64), measured=_rows(measured, dimension),
        information=information, fixed=np.array(fixed, np.int64),
        comments=(*_legend("submaps", [s.id for s in submaps], 0), *_legend("nodes", [n.id for n in nodes], len(submaps))),
    )  # fmt: skip


def _is_planar(transforms: NDArray[np.float64]) -> bool:
    """Whether all transforms move and turn in the plane only."""
    return bool(
        np.all(np.abs(transforms[:, 2, 3]) <= _LEVEL)
        and np.all(np.abs(transforms[:, 2, :2]) <= _LEVEL)
        and np.all(transforms[:, 2, 2] > 0)
    )


def _rows(transforms: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    if dimension == 2:
        return se3.to_se2(transforms)
    return np.concatenate(se3.to_position_quaternion(transforms), axis=1)


def _legend(what: str, ids: Sequence[Id], offset: int) -> list[str]:
    """Return a line for each run of consecutive numbers of a trajectory."""
    lines = []
    begin = 0
    for i in range(1, len(ids) + 1):
        if i < len(ids) and ids[i] == (ids[i - 1].trajectory, ids[i - 1].number + 1):
            continue
        low, high = ids[begin], ids[i - 1]
        lines.append(
            f"vertices {offset + begin} to {offset + i - 1}: {what} {low.number} to {high.number} of trajectory {low.trajectory}"
        )
        begin = i
    return lines
