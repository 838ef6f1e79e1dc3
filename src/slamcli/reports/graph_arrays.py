# SPDX-License-Identifier: MIT
"""A pose graph as arrays, ready to be drawn and counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.posegraph import Id, LoopSearch, MapState, Submap
from slamcli.posegraph.constraint_residuals import constraint_residuals, rotation_angle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraphArrays:
    """Nodes (N), submaps (S), constraints (C) and loop searches (L); indices point into nodes and submaps, -1 for none."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,)."""
    elapsed_s: NDArray[np.float64]
    """float64 (N,), since the first node of the same trajectory."""
    trajectories: NDArray[np.int64]
    """int64 (N,), which trajectory each node belongs to."""
    frozen: frozenset[int]
    """Trajectories that were loaded and must not move."""
    positions_m: NDArray[np.float64]
    """float64 (N, 3), map frame, optimised."""
    local_positions_m: NDArray[np.float64]
    """float64 (N, 3), by local SLAM alone, laid on the map at the first node of each trajectory."""
    correction_rad: NDArray[np.float64]
    """float64 (N,), how far the optimisation turned each node against local SLAM."""
    submap_names: tuple[str, ...]
    """Trajectory and number of each submap, the trajectory left out where there is only one."""
    outlines_m: NDArray[np.float64]
    """float64 (S, 4, 2), corners of the known part of each submap in the map frame; NaN where it has no grid."""
    centres_m: NDArray[np.float64]
    """float64 (S, 2), where the robot was in the middle of building each submap."""
    middles: NDArray[np.int64]
    """int64 (S,), the node in the middle of each submap."""
    owners: NDArray[np.int64]
    """int64 (N,), the first submap that each node was put into."""
    inter: NDArray[np.bool_]
    """bool (C,), loop constraints; the others bind a node to a submap that it is part of."""
    constraint_nodes: NDArray[np.int64]
    constraint_submaps: NDArray[np.int64]
    residuals_m: NDArray[np.float64]
    """float64 (C,), how far the optimised poses are from what each constraint says; NaN where a part was trimmed. Of loops that
    were found in this run it is what their search tells, which leaves out directions in which a match is blind."""
    residuals_rad: NDArray[np.float64]
    search_nodes: NDArray[np.int64]
    search_submaps: NDArray[np.int64]
    scores: NDArray[np.float64]
    """float64 (L,)."""
    accepted: NDArray[np.bool_]
    """bool (L,)."""

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to draw."""
        return len(self.stamps_ns) == 0 and len(self.submap_names) == 0


def graph_arrays(state: MapState, searches: Sequence[LoopSearch] = ()) -> GraphArrays:
    """Return the arrays of a state; the same state gives the same arrays."""
    nodes = {node.id: i for i, node in enumerate(state.nodes)}
    submaps = {submap.id: i for i, submap in enumerate(state.submaps)}
    T_map_node = np.array([node.T_map_node for node in state.nodes]).reshape(-1, 4, 4)
    trajectories = np.array([node.id.trajectory for node in state.nodes], dtype=np.int64)
    stamps = np.array([node.stamp_ns for node in state.nodes], dtype=np.int64)
    local, correction = _against_local_slam(state, T_map_node, trajectories)
    constraint_nodes = _places([c.node for c in state.constraints], nodes)
    constraint_submaps = _places([c.submap for c in state.constraints], submaps)
    inter = np.array([c.kind == "inter" for c in state.constraints], dtype=bool)
    residuals_m, residuals_rad = _residuals(state, searches)
    middles = _middles(constraint_nodes, constraint_submaps, ~inter, len(submaps))
    origins = np.array([s.T_map_submap[:2, 3] for s in state.submaps]).reshape(-1, 2)
    origins[middles >= 0] = T_map_node[middles[middles >= 0], :2, 3]
    return GraphArrays(
        stamps_ns=stamps,
        elapsed_s=_elapsed(stamps, trajectories),
        trajectories=trajectories,
        frozen=state.frozen,
        positions_m=T_map_node[:, :3, 3],
        local_positions_m=local,
        correction_rad=correction,
        submap_names=_names(state.submaps),
        outlines_m=np.array([_outline(submap) for submap in state.submaps]).reshape(-1, 4, 2),
        centres_m=origins,
        middles=middles,
        owners=_owners(constraint_nodes, constraint_submaps, ~inter, len(nodes)),
        inter=inter,
        constraint_nodes=constraint_nodes,
        constraint_submaps=constraint_submaps,
        residuals_m=residuals_m,
        residuals_rad=residuals_rad,
        search_nodes=_places([s.node for s in searches], nodes),
        search_submaps=_places([s.submap for s in searches], submaps),
        scores=np.array([s.score for s in searches], dtype=np.float64),
        accepted=np.array([s.accepted for s in searches], dtype=bool),
    )


def _residuals(state: MapState, searches: Sequence[LoopSearch]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    metres, radians = constraint_residuals(state)
    told = {(s.submap, s.node): s for s in searches if s.accepted and np.isfinite(s.translation_residual_m)}
    for i, constraint in enumerate(state.constraints):
        search = told.get((constraint.submap, constraint.node)) if constraint.kind == "inter" else None
        if search is not None and np.isfinite(metres[i]):
            metres[i], radians[i] = search.translation_residual_m, search.rotation_residual_rad
    return metres, radians


def _places(ids: Sequence[Id], known: dict[Id, int]) -> NDArray[np.int64]:
    return np.array([known.get(i, -1) for i in ids], dtype=np.int64)


def _names(submaps: Sequence[Submap]) -> tuple[str, ...]:
    several = len({submap.id.trajectory for submap in submaps}) > 1
    return tuple(f"{s.id.trajectory}.{s.id.number}" if several else str(s.id.number) for s in submaps)


def _elapsed(stamps_ns: NDArray[np.int64], trajectories: NDArray[np.int64]) -> NDArray[np.float64]:
    elapsed = np.zeros(len(stamps_ns))
    for trajectory in np.unique(trajectories):
        its = trajectories == trajectory
        elapsed[its] = (stamps_ns[its] - stamps_ns[its].min()) / 1e9
    return elapsed


def _against_local_slam(
    state: MapState, T_map_node: NDArray[np.float64], trajectories: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where local SLAM alone would have put each node (N, 3), and by what angle (N,) the optimisation turned it."""
    T_local_node = np.array([node.T_local_node for node in state.nodes]).reshape(-1, 4, 4)
    alone = np.empty_like(T_local_node)
    for trajectory in np.unique(trajectories):
        its = trajectories == trajectory
        first = int(np.argmax(its))
        alone[its] = T_map_node[first] @ se3.inverse(T_local_node[first]) @ T_local_node[its]
    turned = se3.inverse(alone) @ T_map_node
    angle = rotation_angle(turned[:, :3, :3]) if len(turned) else np.zeros(0)
    return alone[:, :3, 3], angle


def _outline(submap: Submap) -> NDArray[np.float64]:
    """Return the corners (4, 2) of a submap's known cells in the map frame; NaN without a grid."""
    if submap.grid is not None:
        from slamcli.grids.probability_grid import (
            ProbabilityGrid,  # loads kernels; where there is a grid they are loaded
        )

        cells = submap.grid.cells if isinstance(submap.grid, ProbabilityGrid) else submap.grid.tsd
        rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
        if not len(rows):
            return np.full((4, 2), np.nan)
        x, y = (
            o + submap.grid.resolution_m * np.array([i[0], i[-1] + 1])
            for o, i in zip(submap.grid.origin, (columns, rows), strict=True)
        )
        T_map_grid = submap.T_map_submap @ se3.inverse(submap.T_local_submap)
    elif submap.high_resolution is not None and len(submap.high_resolution.indices):
        low, high = submap.high_resolution.indices.min(axis=0), submap.high_resolution.indices.max(axis=0)
        x, y = (submap.high_resolution.resolution_m * np.array([low[i] - 0.5, high[i] + 0.5]) for i in (0, 1))
        T_map_grid = submap.T_map_submap
    else:
        return np.full((4, 2), np.nan)
    corners = np.array([(x[i], y[j], 0.0, 1.0) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    return (corners @ T_map_grid.T)[:, :2]


def _middles(
    nodes: NDArray[np.int64], submaps: NDArray[np.int64], chosen: NDArray[np.bool_], count: int
) -> NDArray[np.int64]:
    """Return the middle one of the nodes that each submap was built from (count,), -1 for none."""
    middles = np.full(count, -1, dtype=np.int64)
    use = chosen & (nodes >= 0) & (submaps >= 0)
    order = np.lexsort((nodes[use], submaps[use]))
    its_nodes, its_submaps = nodes[use][order], submaps[use][order]
    for submap, first, size in zip(*np.unique(its_submaps, return_index=True, return_counts=True), strict=True):
        middles[submap] = its_nodes[first + size // 2]
    return middles


def _owners(
    nodes: NDArray[np.int64], submaps: NDArray[np.int64], chosen: NDArray[np.bool_], count: int
) -> NDArray[np.int64]:
    owners = np.full(count, np.iinfo(np.int64).max, dtype=np.int64)
    use = chosen & (nodes >= 0) & (submaps >= 0)
    np.minimum.at(owners, nodes[use], submaps[use])
    return np.where(owners == np.iinfo(np.int64).max, -1, owners)
