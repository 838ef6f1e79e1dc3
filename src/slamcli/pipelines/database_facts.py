# SPDX-License-Identifier: MIT
"""What a database of RTAB-Map holds, for ``slamcli info``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.parameters import convert, declarations
from slamcli.rtabmap import RtabmapParameters
from slamcli.rtabmap.database import Counts, Database, NodeTable, StoredCamera
from slamcli.rtabmap.links import LinkKind

_INTERMEDIATE, _UNUSED = -1, -9


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFacts:
    """One session: nodes of one map id."""

    map_id: int
    nodes: int
    first_id: int
    last_id: int
    start_ns: int
    end_ns: int
    length_m: float
    """Of the path by odometry."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DatabaseFacts:
    """What a database holds."""

    path: Path
    version: str
    """Of RTAB-Map, whose tables it has."""
    size_bytes: int
    nodes: int
    intermediate: int
    """Of them, those between nodes proper, which keep no words."""
    unused: int
    """Of them, those that are not to be used."""
    working: int
    """Of them, those that were in working memory when the last session ended."""
    counts: Counts
    sessions: tuple[SessionFacts, ...]
    links: Mapping[str, int]
    """By kind."""
    closures_between_sessions: int
    landmarks: tuple[int, ...]
    """Numbers of the markers that were seen."""
    sensors: tuple[str, ...]
    """What the first nodes with images and a scan hold, in words."""
    cameras: tuple[StoredCamera, ...]
    """Of the first node that has any."""
    optimised: int
    """Poses of the graph as it was optimised last."""
    grid: tuple[int, int, float] | None
    """Columns, rows and metres per cell of the assembled map."""
    changed: Mapping[str, str]
    """Parameters of the last session that differ from the defaults of slamcli, by name; those without effect here are left out."""
    parameters: int
    """Number of parameters that are kept."""


def database_facts(path: str | os.PathLike[str]) -> DatabaseFacts:
    """Return what is in a database.

    Raises
    ------
    FormatError
        If it is none, a damaged one, or of a version that is not read.
    """
    path = Path(path)
    with Database.read(path) as database:
        table, links, optimised, grid = database.nodes(), database.links(), database.optimised(), database.grid()
        map_ids = dict(zip(table.ids.tolist(), table.map_ids.tolist(), strict=True))
        between = [
            link
            for link in links
            if link.to_id > 0 and map_ids.get(link.from_id) != map_ids.get(link.to_id)
        ]  # fmt: skip
        parameters = database.parameters()
        return DatabaseFacts(
            path=path,
            version=database.version,
            size_bytes=path.stat().st_size,
            nodes=len(table),
            intermediate=int((table.weights == _INTERMEDIATE).sum()),
            unused=int((table.weights == _UNUSED).sum()),
            working=len(database.last_working_ids()),
            counts=database.counts(),
            sessions=tuple(_session(table, map_id) for map_id in dict.fromkeys(table.map_ids.tolist())),
            links=dict(Counter(kind.name.lower() for kind in sorted(link.kind for link in links))),
            closures_between_sessions=len(between),
            landmarks=tuple(sorted({-link.to_id for link in links if link.kind == LinkKind.LANDMARK})),
            sensors=_sensors(database, table),
            cameras=next((found for i in table.ids.tolist() if (found := database.read_cameras(i))), ()),
            optimised=0 if optimised is None else len(optimised.ids),
            grid=None if grid is None else (grid.cells.shape[1], grid.cells.shape[0], grid.resolution_m),
            changed=_changed(parameters),
            parameters=len(parameters),
        )


def _session(table: NodeTable, map_id: int) -> SessionFacts:
    rows = np.flatnonzero(table.map_ids == map_id)
    positions: NDArray[np.float64] = table.T_odom_base[rows, :3, 3]
    positions = positions[np.isfinite(positions).all(axis=1)]
    return SessionFacts(
        map_id=int(map_id),
        nodes=len(rows),
        first_id=int(table.ids[rows[0]]),
        last_id=int(table.ids[rows[-1]]),
        start_ns=int(table.stamps_ns[rows].min()),
        end_ns=int(table.stamps_ns[rows].max()),
        length_m=float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()),
    )


def _sensors(database: Database, table: NodeTable) -> tuple[str, ...]:
    """Return what the first node with images and the first with a scan have."""
    found = []
    images = next((seen for i in table.ids.tolist() if (seen := database.read_images(i)) is not None), None)
    if images is not None:
        height, width = images.colour.shape[:2]
        second = (
            " with depth" if images.depth is not None else " and of a right camera" if images.right is not None else ""
        )
        found.append(f"{'grey' if images.colour.ndim == 2 else 'colour'} images of {width} x {height} pixels{second}")
    scan = next((swept for i in table.ids.tolist() if (swept := database.read_scan(i)) is not None), None)
    if scan is not None:
        reach = f" up to {scan.range_max_m:g} m" if scan.range_max_m > 0 else ""
        found.append(f"{'planar' if scan.planar else '3D'} scans of {len(scan.points)} points{reach}")
    return tuple(found)


def _changed(parameters: Mapping[str, str]) -> dict[str, str]:
    """Return those that have an effect here and whose value is not slamcli's default, or none that it knows."""
    known = {entry.name: entry for entry in declarations(RtabmapParameters) if entry.effective}
    changed = {}
    for name, text in sorted(parameters.items()):
        if name not in known:
            continue
        try:
            same = convert(known[name], text) == known[name].default
        except ConfigError:
            same = False
        if not same:
            changed[name] = text
    return changed


def document(facts: DatabaseFacts) -> dict[str, Any]:
    """Return the facts for ``--json``."""
    return {
        "files": [str(facts.path)],
        "format": "rtabmap",
        "version": facts.version,
        "size_bytes": facts.size_bytes,
        "nodes": facts.nodes,
        "intermediate": facts.intermediate,
        "unused": facts.unused,
        "working": facts.working,
        **asdict(facts.counts),
        "sessions": [asdict(session) for session in facts.sessions],
        "links": dict(facts.links),
        "closures_between_sessions": facts.closures_between_sessions,
        "landmarks": list(facts.landmarks),
        "sensors": list(facts.sensors),
        "calibration": [_camera(camera) for camera in facts.cameras],
        "optimised_poses": facts.optimised,
        "grid": None if facts.grid is None else dict(zip(("columns", "rows", "resolution_m"), facts.grid, strict=True)),
        "parameters": facts.parameters,
        "changed": dict(facts.changed),
    }


def _camera(camera: StoredCamera) -> dict[str, Any]:
    pinhole = camera.pinhole
    return {
        "width": pinhole.width, "height": pinhole.height, "fx": pinhole.fx, "fy": pinhole.fy, "cx": pinhole.cx,
        "cy": pinhole.cy, "baseline_m": pinhole.baseline_m, "T_base_camera": camera.T_base_camera.tolist(),
    }  # fmt: skip
