# SPDX-License-Identifier: MIT
"""Submaps, nodes and constraints of a run in space while it is being optimised."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap


class Graph3D:
    """All trajectories: those of a loaded state and the one that was just recorded.

    Poses are kept in arrays, one row per node and submap; the records' own are filled in at the end.
    """

    def __init__(self, state: MapState | None) -> None:
        self.nodes: list[Node] = []
        self.submaps: list[Submap] = []
        self.constraints: list[Constraint] = []
        self.frozen: frozenset[int] = state.frozen if state is not None else frozenset()
        self.T_map_node = np.zeros((0, 4, 4))
        self.T_map_submap = np.zeros((0, 4, 4))
        if state is not None:
            for node in state.nodes:
                if node.low_resolution_points_m is None or node.rotational_histogram is None:
                    raise DataError(
                        f"the loaded state is of 2D mapping (node {node.id.number} of trajectory {node.id.trajectory} has no"
                        " points of low resolution): it cannot be gone on with in 3D"
                    )
            self.add(state.nodes, state.submaps, state.constraints)

    def add(self, nodes: Iterable[Node], submaps: Iterable[Submap], constraints: Iterable[Constraint]) -> None:
        """Add what was recorded, at the poses that it has."""
        self.nodes.extend(nodes)
        self.submaps.extend(submaps)
        self.constraints.extend(constraints)
        self.T_map_node = np.array([node.T_map_node for node in self.nodes]).reshape(-1, 4, 4)
        self.T_map_submap = np.array([submap.T_map_submap for submap in self.submaps]).reshape(-1, 4, 4)
        self._node_rows = {node.id: i for i, node in enumerate(self.nodes)}
        self._submap_rows = {submap.id: i for i, submap in enumerate(self.submaps)}

    def node_row(self, id: Id) -> int:
        """Return the row of a node."""
        return self._node_rows[id]

    def submap_row(self, id: Id) -> int:
        """Return the row of a submap."""
        return self._submap_rows[id]

    def members(self) -> list[list[Constraint]]:
        """Return for each submap the constraints to the nodes that it is made of."""
        out: list[list[Constraint]] = [[] for _ in self.submaps]
        for constraint in self.constraints:
            if constraint.kind == "intra" and constraint.node in self._node_rows:
                out[self._submap_rows[constraint.submap]].append(constraint)
        return out

    def trajectory_rows(self, trajectory: int) -> NDArray[np.int64]:
        """Return the rows of a trajectory's nodes, in their order."""
        rows = [i for i, node in enumerate(self.nodes) if node.id.trajectory == trajectory]
        return np.array(sorted(rows, key=lambda i: self.nodes[i].id.number), dtype=np.int64)

    def move_trajectory(self, trajectory: int, T_new_old: NDArray[np.float64]) -> None:
        """Move all poses of a trajectory rigidly."""
        nodes = np.array([node.id.trajectory == trajectory for node in self.nodes])
        submaps = np.array([submap.id.trajectory == trajectory for submap in self.submaps])
        self.T_map_node[nodes] = T_new_old @ self.T_map_node[nodes]
        self.T_map_submap[submaps] = T_new_old @ self.T_map_submap[submaps]

    def connected(self, trajectories: Sequence[int]) -> dict[int, int]:
        """Return for each trajectory the least one that it is tied to by constraints; itself where there is none."""
        root = {t: t for t in trajectories}

        def find(t: int) -> int:
            while root[t] != t:
                t = root[t]
            return t

        for constraint in self.constraints:
            a, b = find(constraint.submap.trajectory), find(constraint.node.trajectory)
            root[max(a, b)] = min(a, b)
        return {t: find(t) for t in trajectories}

    def optimised(self) -> tuple[tuple[Node, ...], tuple[Submap, ...]]:
        """Return all nodes and submaps with the poses of the arrays."""
        nodes = tuple(replace(node, T_map_node=T) for node, T in zip(self.nodes, self.T_map_node, strict=True))
        submaps = tuple(
            replace(submap, T_map_submap=T) for submap, T in zip(self.submaps, self.T_map_submap, strict=True)
        )
        return nodes, submaps
