# SPDX-License-Identifier: MIT
"""Which pairs of node and submap are worth a search."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slamcli.cartographer.constraints_3d import Candidate
from slamcli.cartographer.graph_3d import Graph3D
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.posegraph import Id

APART_FACTOR = 1.5
"""A node is searched in a submap if the way between them is longer than this many times the allowed distance."""


def loop_candidates(
    graph: Graph3D, parameters: CartographerParameters, tried: set[tuple[Id, Id]], *, wide: bool
) -> list[Candidate]:
    """Return pairs of a node and a submap that lie within the allowed distance of each other, in the order of their ids.

    The distance is that to the nearest node of the submap, for a submap may be long. Nodes are taken at a spacing along the
    path; pairs that are close along the path as well tell nothing new. Every so many of them, as ``sampling_ratio`` says,
    are also searched by branch and bound (if `wide`); all are tried at their estimated poses.
    """
    builder, spacing = parameters.pose_graph.constraint_builder, parameters.slamcli_3d.search_spacing
    sampled = np.concatenate([_spaced(graph, t, spacing) for t in _trajectories(graph)])
    order = np.lexsort(([graph.nodes[i].id.number for i in sampled], [graph.nodes[i].id.trajectory for i in sampled]))
    sampled = sampled[order]
    ways, positions = _ways(graph), graph.T_map_node[:, :3, 3]
    found: list[Candidate] = []
    every, count = max(1, round(1.0 / builder.sampling_ratio)) if builder.sampling_ratio > 0 else 0, 0
    for row, members in enumerate(graph.members()):
        submap = graph.submaps[row]
        if not members or not submap.finished:
            continue
        own = np.array([graph.node_row(member.node) for member in members])
        away, _ = cKDTree(positions[own]).query(positions[sampled])
        begin, end = ways[own].min(), ways[own].max()
        for node in sampled[away <= builder.max_constraint_distance]:
            seen = graph.nodes[node].id
            if {seen.trajectory, submap.id.trajectory} <= graph.frozen or (submap.id, seen) in tried:
                continue
            same = seen.trajectory == submap.id.trajectory
            if same and max(begin - ways[node], ways[node] - end) < APART_FACTOR * builder.max_constraint_distance:
                continue
            found.append(Candidate(row, int(node), wide=wide and every > 0 and count % every == 0))
            count += 1
    return found


def _trajectories(graph: Graph3D) -> list[int]:
    return sorted({node.id.trajectory for node in graph.nodes})


def _spaced(graph: Graph3D, trajectory: int, spacing_m: float) -> NDArray[np.int64]:
    """Return rows of a trajectory's nodes that are a spacing apart along the path, the first and the last among them."""
    rows = graph.trajectory_rows(trajectory)
    if not len(rows) or spacing_m <= 0.0:
        return rows
    way = _ways(graph)[rows]
    steps = np.floor(way / spacing_m)
    first = np.concatenate([[True], np.diff(steps) > 0])
    first[-1] = True
    return rows[first]


def _ways(graph: Graph3D) -> NDArray[np.float64]:
    """Return for each node the way to it from its trajectory's first, metres, (N,)."""
    out = np.zeros(len(graph.nodes))
    for trajectory in _trajectories(graph):
        rows = graph.trajectory_rows(trajectory)
        steps = np.linalg.norm(np.diff(graph.T_map_node[rows, :3, 3], axis=0), axis=1)
        out[rows] = np.concatenate([[0.0], np.cumsum(steps)])
    return out
