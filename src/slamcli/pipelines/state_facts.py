# SPDX-License-Identifier: MIT
"""What a saved state holds, for ``slamcli info``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.formats.pbstream.reading import StateFile, read_state_file
from slamcli.geometry import se2, se3
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.posegraph import Constraint, MapState, Submap
from slamcli.runtime import RunLog

_PLANAR = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryFacts:
    """One trajectory of a state."""

    number: int
    nodes: int
    submaps: int
    unfinished: int
    """Submaps that scans were still going into."""
    start_ns: int | None
    end_ns: int | None
    length_m: float
    """Of the optimised path from node to node."""
    points: int
    """In all nodes."""
    imu: int
    odometry: int
    fixed_frame_poses: int
    landmark_observations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StateFacts:
    """What a state holds."""

    path: Path
    version: int
    size_bytes: int
    kind: str
    """``2D probability grids``, ``2D signed distances``, ``3D`` or ``no submaps``."""
    resolutions_m: tuple[float, ...]
    trajectories: tuple[TrajectoryFacts, ...]
    constraints_intra: int
    constraints_inter: int
    constraints_between_trajectories: int
    landmarks: tuple[str, ...]
    extent_m: tuple[float, float, float, float] | None
    """Least x, y and greatest x, y of the known cells (2D) or of the nodes, in the map."""
    planar: bool
    """Whether no node is tilted or off the plane."""


def state_facts(path: str | os.PathLike[str], log: RunLog | None = None) -> StateFacts:
    """Return what is in a ``.pbstream``.

    Raises
    ------
    FormatError
        If it is none, or a damaged one.
    """
    file = read_state_file(path, log=log)
    state = file.state
    kinds = Counter(constraint.kind for constraint in state.constraints)
    return StateFacts(
        path=file.path,
        version=file.version,
        size_bytes=file.size_bytes,
        kind=_kind(state),
        resolutions_m=_resolutions(state.submaps),
        trajectories=tuple(_trajectory(file, number) for number in sorted({*file.trajectories, *state.trajectories})),
        constraints_intra=kinds["intra"],
        constraints_inter=kinds["inter"],
        constraints_between_trajectories=sum(map(_is_between, state.constraints)),
        landmarks=tuple(state.landmarks),
        extent_m=_extent(state),
        planar=all(_is_planar(node.T_map_node) for node in state.nodes),
    )


def _kind(state: MapState) -> str:
    if not state.submaps:
        return "no submaps"
    if any(submap.high_resolution is not None or submap.rotational_histogram is not None for submap in state.submaps):
        return "3D"
    is_tsdf = any(isinstance(submap.grid, TsdfGrid) for submap in state.submaps)
    return "2D signed distances" if is_tsdf else "2D probability grids"


def _resolutions(submaps: Sequence[Submap]) -> tuple[float, ...]:
    grids = [grid for submap in submaps for grid in (submap.grid, submap.high_resolution, submap.low_resolution)]
    return tuple(sorted({float(f"{grid.resolution_m:.6g}") for grid in grids if grid is not None}))


def _is_between(constraint: Constraint) -> bool:
    return constraint.submap.trajectory != constraint.node.trajectory


def _is_planar(T: NDArray[np.float64]) -> bool:
    return bool(abs(T[2, 3]) < _PLANAR and abs(T[2, 2] - 1.0) < _PLANAR)


def _trajectory(file: StateFile, number: int) -> TrajectoryFacts:
    state = file.state
    nodes = [node for node in state.nodes if node.id.trajectory == number]
    submaps = [submap for submap in state.submaps if submap.id.trajectory == number]
    positions = np.array([node.T_map_node[:3, 3] for node in nodes]).reshape(-1, 3)
    stamps = [node.stamp_ns for node in nodes]
    return TrajectoryFacts(
        number=number,
        nodes=len(nodes),
        submaps=len(submaps),
        unfinished=sum(not submap.finished for submap in submaps),
        start_ns=min(stamps, default=None),
        end_ns=max(stamps, default=None),
        length_m=float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()),
        points=sum(len(node.points_m) for node in nodes),
        imu=len(state.imu.get(number, ())),
        odometry=len(state.odometry.get(number, ())),
        fixed_frame_poses=len(state.fixed_frame_poses.get(number, ())),
        landmark_observations=len(state.landmark_observations.get(number, ())),
    )


def _extent(state: MapState) -> tuple[float, float, float, float] | None:
    found = [corners for submap in state.submaps if (corners := _corners(submap)) is not None]
    if not found:
        found = [node.T_map_node[:2, 3] for node in state.nodes]
    if not found:
        return None
    points = np.vstack(found)
    (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return x0, y0, x1, y1


def _corners(submap: Submap) -> NDArray[np.float64] | None:
    """Return the corners (4, 2) in the map of the box of a planar grid's known cells."""
    grid = submap.grid
    if grid is None:
        return None
    known = grid.cells > 0
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return None
    x = grid.origin[0] + grid.resolution_m * np.array([columns[0], columns[-1] + 1])
    y = grid.origin[1] + grid.resolution_m * np.array([rows[0], rows[-1] + 1])
    T_map_local = se2.compose(se3.to_se2(submap.T_map_submap), se2.inverse(se3.to_se2(submap.T_local_submap)))
    return se2.transform_points(T_map_local, [[a, b] for a in x for b in y])


def document(facts: StateFacts) -> dict[str, Any]:
    """Return the facts for ``--json``."""
    extent = facts.extent_m
    return {
        "files": [str(facts.path)],
        "format": "pbstream",
        "version": facts.version,
        "size_bytes": facts.size_bytes,
        "kind": facts.kind,
        "planar": facts.planar,
        "resolutions_m": list(facts.resolutions_m),
        "trajectories": [asdict(entry) for entry in facts.trajectories],
        "nodes": sum(entry.nodes for entry in facts.trajectories),
        "submaps": sum(entry.submaps for entry in facts.trajectories),
        "constraints_intra": facts.constraints_intra,
        "constraints_inter": facts.constraints_inter,
        "constraints_between_trajectories": facts.constraints_between_trajectories,
        "landmarks": list(facts.landmarks),
        "extent_m": None if extent is None else list(extent),
    }
