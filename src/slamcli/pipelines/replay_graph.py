# SPDX-License-Identifier: MIT
"""The graph and the submaps of a result, from the files that its tier leaves."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats.trajectories import read_trajectory
from slamcli.geometry import se3
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.replay_tracks import GraphTrack, SubmapTrack
from slamcli.posegraph import MapState, Submap
from slamcli.reports.graph_arrays import GraphArrays, graph_arrays
from slamcli.runtime import RunLog

_KINDS = {
    "odometry": "sequence", "tree": "sequence", "loop": "loop", "proximity": "loop", "covisible": "covisible",
}  # fmt: skip
"""Kinds of a tier's own table to those of `GraphTrack`."""
_RESIDUALS = ("translation_residual_m", "rotation_residual_rad")


def load_graph(folder: Path, log: RunLog) -> tuple[GraphTrack | None, SubmapTrack | None]:
    """Return graph and submaps of a result, None where it has none.

    Raises
    ------
    FormatError
        If a file of them is damaged.
    """
    if (folder / "state.pbstream").is_file():
        from slamcli.formats.pbstream.reading import read_state

        return graph_of_state(read_state(folder / "state.pbstream", log=log))
    if (folder / "keyframes.tum").is_file():
        return _graph_of_keyframes(folder, log), None
    return None, None


def graph_of_state(state: MapState) -> tuple[GraphTrack | None, SubmapTrack | None]:
    """Return graph and submaps of a state, None where it has none."""
    arrays = graph_arrays(state)
    return _graph(arrays), _submaps(state, arrays)


def _graph(graph: GraphArrays) -> GraphTrack | None:
    """Return nodes, the way from each to the next, and loops: from a node to the middle one of those in the submap."""
    number = len(graph.stamps_ns)
    if not number:
        return None
    first = np.flatnonzero(graph.trajectories[:-1] == graph.trajectories[1:])
    sequence = np.column_stack([first, first + 1])
    _, finished = _spans(graph)
    drawn = graph.inter & (graph.constraint_nodes >= 0) & (graph.constraint_submaps >= 0)
    nodes, submaps = graph.constraint_nodes[drawn], graph.constraint_submaps[drawn]
    placed = graph.middles[submaps] >= 0
    nodes, submaps = nodes[placed], submaps[placed]
    residuals_m, residuals_rad = (r[drawn][placed] for r in (graph.residuals_m, graph.residuals_rad))
    unmeasured = np.full(len(sequence), np.nan)
    loops = np.column_stack([nodes, graph.middles[submaps]])
    return GraphTrack(
        stamps_ns=graph.stamps_ns,
        positions_m=graph.positions_m,
        edges=np.concatenate([sequence, loops]).astype(np.int64),
        kinds=_codes(["sequence"] * len(sequence) + ["loop"] * len(loops)),
        edge_stamps_ns=np.concatenate(
            [graph.stamps_ns[sequence[:, 1]], np.maximum(graph.stamps_ns[nodes], finished[submaps])]
        ),
        residual_m=np.concatenate([unmeasured, residuals_m]),
        residual_rad=np.concatenate([unmeasured, residuals_rad]),
    )


def _spans(graph: GraphArrays) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the stamps of the first and last node in each submap; those of the whole graph where a submap has none."""
    count = len(graph.submap_names)
    within = ~graph.inter & (graph.constraint_nodes >= 0) & (graph.constraint_submaps >= 0)
    stamps = graph.stamps_ns[graph.constraint_nodes[within]]
    submaps = graph.constraint_submaps[within]
    whole = (int(graph.stamps_ns.min()), int(graph.stamps_ns.max())) if len(graph.stamps_ns) else (0, 0)
    limits = np.iinfo(np.int64)
    begun, finished = np.full(count, limits.max), np.full(count, limits.min)
    np.minimum.at(begun, submaps, stamps)
    np.maximum.at(finished, submaps, stamps)
    empty = begun == limits.max
    begun[empty], finished[empty] = whole
    return begun, finished


def _submaps(state: MapState, graph: GraphArrays) -> SubmapTrack | None:
    if not state.submaps:
        return None
    begun, finished = _spans(graph)
    return SubmapTrack(
        names=graph.submap_names,
        begun_ns=begun,
        finished_ns=finished,
        outlines_m=graph.outlines_m,
        heights_m=np.array([submap.T_map_submap[2, 3] for submap in state.submaps]),
        grids=tuple(_drawn(submap) for submap in state.submaps),
    )


def _drawn(submap: Submap) -> OccupancyGrid | None:
    """Return a planar submap as an occupancy grid that is turned into its place in the map."""
    if submap.grid is None:
        return None
    from slamcli.grids.probability_grid import ProbabilityGrid

    grid = submap.grid.cropped()
    if isinstance(grid, ProbabilityGrid):
        occupied = grid.probabilities().astype(np.float64)
        known = grid.cells > 0
    else:
        known = grid.tsd > 0
        occupied = 1.0 - np.abs(grid.tsd.astype(np.float64) - 16384.0) / 16383.0
    share = np.clip((np.where(known, occupied, 0.0) - 0.1) / 0.8, 0.0, 1.0)
    cells = np.where(known, np.rint(100.0 * share), OccupancyGrid.UNKNOWN).astype(np.int8)
    T = submap.T_map_submap @ se3.inverse(submap.T_local_submap)
    corner = T @ np.array([*grid.origin, 0.0, 1.0])
    return OccupancyGrid(
        cells, grid.resolution_m, (float(corner[0]), float(corner[1]), math.atan2(T[1, 0], T[0, 0])), "map"
    )


def _graph_of_keyframes(folder: Path, log: RunLog) -> GraphTrack | None:
    nodes = read_trajectory(folder / "keyframes.tum", log=log)
    if not len(nodes):
        return None
    edges: list[tuple[int, int]] = []
    kinds: list[str] = []
    residuals: list[tuple[float, float]] = []
    path = next((p for name in ("links.csv", "covisibility.csv") if (p := folder / name).is_file()), None)
    if path is not None:
        places = {stamp: i for i, stamp in enumerate(nodes.stamps_ns.tolist())}
        for number, row in enumerate(_rows(path), start=2):
            try:
                ends = [places.get(_stamp_ns(row[name])) for name in ("stamp_a_s", "stamp_b_s")]
                kind = _KINDS[row["kind"]]
                residual = tuple(float(row.get(name) or "nan") for name in _RESIDUALS)
            except (KeyError, ValueError, TypeError) as error:
                raise FormatError(f"{path}: line {number}: no edge of a graph ({error})") from error
            if ends[0] is not None and ends[1] is not None:
                edges.append((ends[0], ends[1]))
                kinds.append(kind)
                residuals.append((residual[0], residual[1]))
    pairs = np.array(edges, dtype=np.int64).reshape(-1, 2)
    measured = np.array(residuals, dtype=np.float64).reshape(-1, 2)
    return GraphTrack(
        stamps_ns=nodes.stamps_ns, positions_m=nodes.positions_m, edges=pairs, kinds=_codes(kinds),
        edge_stamps_ns=nodes.stamps_ns[pairs].max(axis=1, initial=np.iinfo(np.int64).min),
        residual_m=measured[:, 0], residual_rad=measured[:, 1],
    )  # fmt: skip


def _rows(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path}: {error}") from error


def _stamp_ns(text: str) -> int:
    """Return nanoseconds of decimal seconds, exactly."""
    sign = -1 if text.startswith("-") else 1
    whole, _, rest = text.lstrip("-").partition(".")
    return sign * (int(whole) * 1_000_000_000 + int(f"{rest:0<9}"[:9]))


def _codes(kinds: Sequence[str]) -> NDArray[np.uint8]:
    return np.array([GraphTrack.KINDS.index(kind) for kind in kinds], dtype=np.uint8)
