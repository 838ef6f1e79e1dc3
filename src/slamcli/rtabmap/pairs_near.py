# SPDX-License-Identifier: MIT
"""Which nodes of a finished map are worth comparing once more: those that lie near each other and that nothing ties."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slamcli.rtabmap.map_graph import MapGraph

_NEAR_M, _NEAR_RAD = 2.0, 0.8
"""Nodes that are farther apart or look elsewhere are not compared."""
_MOST_PER_NODE = 8
_MOST = 3000
"""Pairs; of more, those that lie nearest."""


def pairs_near(graph: MapGraph, node_ids: Sequence[int]) -> list[tuple[int, int]]:
    """Return pairs (older, newer) of nodes, the newer one of `node_ids`, by the newer, then the nearest first.

    Both lie in one map, near each other, and look the same way; no link ties them.
    """
    ids = np.array([node_id for node_id in graph.nodes if node_id > 0], dtype=np.int64)
    if len(ids) < 2:
        return []
    poses = np.array([graph.T_map_base[node_id] for node_id in ids.tolist()])
    part_of = _maps(graph, ids)
    tree = cKDTree(poses[:, :3, 3])
    wanted = set(node_ids)
    found: list[tuple[float, int, int]] = []
    for row in np.flatnonzero(np.isin(ids, list(wanted))).tolist():
        newer = int(ids[row])
        near = np.array(tree.query_ball_point(poses[row, :3, 3], _NEAR_M), dtype=np.int64)
        near = near[(ids[near] < newer) & (part_of[near] == part_of[row])]
        apart = _apart(poses[near], poses[row])
        ordered = sorted(
            (float(far), int(ids[other])) for far, other in zip(apart, near, strict=True) if np.isfinite(far)
        )
        free = [(far, other, newer) for far, other in ordered if not graph.are_linked(other, newer)]
        found += free[:_MOST_PER_NODE]
    nearest = sorted(found)[:_MOST]
    return [(older, newer) for _, older, newer in sorted(nearest, key=lambda pair: (pair[2], pair[0], pair[1]))]


def _apart(T_map_others: NDArray[np.float64], T_map_here: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far poses (N, 4, 4) are from one, metres and radians together; infinite if they look elsewhere."""
    way = np.linalg.norm(T_map_others[:, :3, 3] - T_map_here[:3, 3], axis=1)
    cosine = (np.einsum("nij,ij->n", T_map_others[:, :3, :3], T_map_here[:3, :3]) - 1.0) / 2.0
    turn = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.where(turn <= _NEAR_RAD, way + turn, np.inf)


def _maps(graph: MapGraph, ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return which map each node is in: the oldest node that links tie it to."""
    oldest: dict[int, int] = {}
    for node_id in ids.tolist():
        if node_id not in oldest:
            members = [other for other in graph.component(node_id) if other > 0]
            oldest.update(dict.fromkeys(members, members[0]))
    return np.array([oldest[node_id] for node_id in ids.tolist()], dtype=np.int64)
