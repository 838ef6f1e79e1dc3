# SPDX-License-Identifier: MIT
"""States with fewer submaps: the newest of a trajectory, or those whose area newer ones do not cover."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2, se3
from slamcli.posegraph.map_state import Id, MapState, Submap

_MOST_CELLS = 1 << 28


def without_submaps(state: MapState, dropped: Collection[Id]) -> MapState:
    """Return the state without some submaps, without the nodes that are in no other one, and without their constraints."""
    gone = set(dropped)
    held = {c.node for c in state.constraints if c.kind == "intra"}
    still = {c.node for c in state.constraints if c.kind == "intra" and c.submap not in gone}
    lost = held - still
    return replace(
        state,
        submaps=tuple(submap for submap in state.submaps if submap.id not in gone),
        nodes=tuple(node for node in state.nodes if node.id not in lost),
        constraints=tuple(c for c in state.constraints if c.submap not in gone and c.node not in lost),
    )


def keep_newest(state: MapState, trajectory: int, count: int) -> MapState:
    """Return the state with the newest `count` submaps of a trajectory, as Cartographer's pure localisation keeps them."""
    own = sorted(submap.id for submap in state.submaps if submap.id.trajectory == trajectory)
    return without_submaps(state, own[: max(len(own) - count, 0)])


def trim_overlapping(state: MapState, fresh_count: int, min_area_m2: float, min_added: int) -> MapState:
    """Return the state without the finished submaps whose area newer ones cover; frozen trajectories stay whole.

    Parameters
    ----------
    state
        A state in the plane.
    fresh_count
        Over each cell the newest so many submaps count. How new a submap is says the last node in it.
    min_area_m2
        What is kept counts over at least this area.
    min_added
        Nothing is trimmed of a state with so many submaps or fewer.

    References
    ----------
    Cartographer, ``mapping/internal/2d/overlapping_submaps_trimmer_2d``.
    """
    if len(state.submaps) <= min_added:
        return state
    stamps = {node.id: node.stamp_ns for node in state.nodes}
    newest: dict[Id, int] = {}
    for c in state.constraints:
        if c.kind == "intra":
            newest[c.submap] = max(newest.get(c.submap, stamps[c.node]), stamps[c.node])
    chosen = [submap for submap in state.submaps if submap.finished and submap.grid is not None and submap.id in newest]
    chosen.sort(key=lambda submap: (newest[submap.id], submap.id), reverse=True)
    if not chosen:
        return state
    resolution = min(submap.grid.resolution_m for submap in chosen if submap.grid is not None)
    cells = [_cells(submap, resolution) for submap in chosen]
    corner = np.min([part.min(axis=0) for part in cells if len(part)], axis=0, initial=0)
    size = np.max([part.max(axis=0) for part in cells if len(part)], axis=0, initial=0) - corner + 1
    if int(size[0]) * int(size[1]) > _MOST_CELLS:
        return state
    counts = np.zeros(size, np.uint16)
    dropped = []
    for submap, part in zip(chosen, cells, strict=True):
        where = tuple((part - corner).T)
        covered = int((counts[where] < fresh_count).sum())
        counts[where] += 1
        if covered * resolution**2 < min_area_m2 and submap.id.trajectory not in state.frozen:
            dropped.append(submap.id)
    return without_submaps(state, dropped)


def _cells(submap: Submap, resolution_m: float) -> NDArray[np.int64]:
    """Return the cells (N, 2), x and y in the map in multiples of the resolution, that a submap knows; each once."""
    grid = submap.grid
    if grid is None:
        return np.zeros((0, 2), np.int64)
    rows, columns = np.nonzero(grid.cells)
    points = (np.column_stack([columns, rows]) + 0.5) * grid.resolution_m + np.array(grid.origin)
    T_map_local = se2.compose(se3.to_se2(submap.T_map_submap), se2.inverse(se3.to_se2(submap.T_local_submap)))
    return np.unique(np.floor(se2.transform_points(T_map_local, points) / resolution_m).astype(np.int64), axis=0)
