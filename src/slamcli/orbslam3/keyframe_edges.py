# SPDX-License-Identifier: MIT
"""The graph of a map's living keyframes, as a result holds it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.essential_graph import shared_points
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.posegraph.keyframe_graph import EDGE_KINDS, KeyframeGraph

_LEAST_SHARED = 15
"""Keyframes that share fewer points are not neighbours (ORB-SLAM, section III-D)."""
_TREE, _LOOP = EDGE_KINDS.index("tree"), EDGE_KINDS.index("loop")


def keyframe_graph(sparse_map: SparseMap, T_map_base: NDArray[np.float64]) -> KeyframeGraph:
    """Return the covisibility graph, the spanning tree and the loops of the living keyframes, whose poses (K, 4, 4) are given."""
    living = sparse_map.living_keyframes
    row = np.full(sparse_map.num_keyframes, -1, dtype=np.int64)
    row[living] = np.arange(len(living))
    shared = shared_points(sparse_map)[np.ix_(living, living)]
    kinds = np.where(np.triu(shared >= _LEAST_SHARED, 1), 0, -1)
    parents = sparse_map.parent[living]
    ties = [(row[k], row[parent], _TREE) for k, parent in zip(living, parents, strict=True) if parent >= 0]
    ties += [(row[a], row[b], _LOOP) for a, b in sparse_map.loop_edges]
    for a, b, kind in ties:
        if a >= 0 and b >= 0 and a != b:
            kinds[min(a, b), max(a, b)] = kind
    first, second = np.nonzero(kinds >= 0)
    return KeyframeGraph(
        stamps_ns=sparse_map.stamp_ns[living].copy(), T_map_base=T_map_base, pairs=np.column_stack([first, second]),
        shared=shared[first, second], kinds=kinds[first, second],
    )  # fmt: skip
