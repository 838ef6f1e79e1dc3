# SPDX-License-Identifier: MIT
"""Where a planned path goes: CSV, JSON, TUM, MCAP or bag, and a picture of it on the map."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from slamcli.errors import UsageError
from slamcli.outputs import atomic_directory, atomic_file
from slamcli.pipelines.plan import Answer, PlanningSite, require_path
from slamcli.pipelines.run_record import describe_inputs, run_document, to_json
from slamcli.pipelines.schemas import stamped
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

_NS_PER_M = 1_000_000_000


def write_outputs(targets: Sequence[Path], site: PlanningSite, answer: Answer, log: RunLog) -> tuple[Path, ...]:
    """Write the path to files (the suffix says how) or to folders (all formats), and return what was written.

    A folder takes ``path.csv``, ``path.json``, ``path.tum``, ``path.mcap``, ``path.png`` and ``run.json``; beside single
    files the run's record is named after the first of them (``path.run.json``).

    Raises
    ------
    UsageError
        If a suffix is unknown or a target cannot be written.
    """
    require_path(answer)
    kinds = [_kind(target) for target in targets]
    written: list[Path] = []
    files = [target for target, kind in zip(targets, kinds, strict=True) if kind]
    with log.stage("write"):
        for target, kind in zip(targets, kinds, strict=True):
            if kind:
                _WRITERS[kind](target, site, answer)
                written.append(target)
                continue
            with atomic_directory(target) as folder:
                names = [f"path{suffix}" for suffix in (".csv", ".json", ".tum", ".mcap", ".png")]
                for name in names:
                    _WRITERS[Path(name).suffix](folder / name, site, answer)
                _write_record(folder / "run.json", site, answer, log, names)
            written.extend(target / name for name in [*names, "run.json"])
    if files:
        record = files[0].with_suffix(".run.json")
        _write_record(record, site, answer, log, [str(f) for f in files])
        written.append(record)
    return tuple(written)


def check_targets(targets: Sequence[Path]) -> None:
    """Raise UsageError for a target that could not be written, before any work is done."""
    for target in targets:
        _kind(target)


def _kind(target: Path) -> str:
    """Return the suffix that says how to write `target`; empty for a folder."""
    suffix = target.suffix.lower()
    if suffix in _WRITERS:
        return suffix
    if suffix and not target.is_dir():
        raise UsageError(f"{target}: a path is written as {', '.join(_WRITERS)}, or all of them into a folder")
    return ""


def as_trajectory(answer: Answer, frame_id: str) -> Trajectory:
    """Return the path as poses; stamps are what a robot at 1 m/s would have, from 0."""
    path = require_path(answer)
    steps = np.linalg.norm(np.diff(path.points_m, axis=0), axis=1)
    stamps_ns = np.rint(np.concatenate([[0.0], np.cumsum(steps)]) * _NS_PER_M).astype(np.int64)
    return Trajectory.from_se2(stamps_ns, np.column_stack([path.points_m, path.yaws_rad]), frame_id, "base_link")


def _write_csv(target: Path, _site: PlanningSite, answer: Answer) -> None:
    path = require_path(answer)
    with atomic_file(target) as stream:
        stream.write("x,y,yaw\n")
        for (x, y), yaw in zip(path.points_m.tolist(), path.yaws_rad.tolist(), strict=True):
            stream.write(f"{x!r},{y!r},{yaw!r}\n")


def _write_json(target: Path, site: PlanningSite, answer: Answer) -> None:
    with atomic_file(target) as stream:
        document = {"map": str(site.map.path), **answer.document(points=True, timing=False)}
        json.dump(stamped("plan-path", document), stream, indent=1, allow_nan=False)
        stream.write("\n")


def _write_tum(target: Path, site: PlanningSite, answer: Answer) -> None:
    from slamcli.formats.trajectories import write_tum

    write_tum(target, as_trajectory(answer, site.costmap_parameters.global_frame))


def _write_recording(target: Path, site: PlanningSite, answer: Answer) -> None:
    """Write nav_msgs/Path to /plan and the map to /map, for Foxglove and RViz."""
    from slamcli.recordings import create_recording
    from slamcli.recordings.adapters.occupancy_grid import StampedGrid
    from slamcli.recordings.adapters.path import StampedPath

    with create_recording(target) as recording:
        recording.write("/map", StampedGrid(stamp_ns=0, grid=site.map.grid))
        recording.write(
            "/plan", StampedPath(stamp_ns=0, path=as_trajectory(answer, site.costmap_parameters.global_frame))
        )


def _write_png(target: Path, site: PlanningSite, answer: Answer) -> None:
    with atomic_file(target, "wb") as stream:
        stream.write(draw(site, answer))


def draw(site: PlanningSite, answer: Answer) -> bytes:
    """Return a PNG of the path on the map."""
    from slamcli.reports.figures import map_png

    path = require_path(answer)
    radius = site.planner.costmap.inscribed_radius_m
    return map_png(
        site.map.grid,
        path=path.points_m,
        start=answer.start,
        goal=answer.goal,
        title=f"{site.map.path.name}  {path.method}  {path.length_m:.2f} m, clearance {path.clearance_m:.2f} m",
        footprint_radius_m=radius or None,
    )


_WRITERS: dict[str, Callable[[Path, PlanningSite, Answer], None]] = {
    ".csv": _write_csv,
    ".json": _write_json,
    ".tum": _write_tum,
    ".mcap": _write_recording,
    ".bag": _write_recording,
    ".png": _write_png,
}


def _write_record(target: Path, site: PlanningSite, answer: Answer, log: RunLog, outputs: Sequence[str]) -> None:
    changed = {name: value for name, value in site.parameters.items() if value != site.defaults.get(name, value)}
    document = run_document(
        command="plan",
        algo=site.planner.method,
        parameters=site.parameters,
        changed=changed,
        seed=0,
        jobs=1,
        inputs=describe_inputs([site.map.path, site.map.image, *site.costmap_files]),
        topics={},
        frames={"map": site.costmap_parameters.global_frame},
        log=log,
        total_s=sum(log.seconds.values()),
        duration_s=0.0,
        summary=answer.document(timing=False),
        outputs=[*outputs, target.name],
    )
    with atomic_file(target) as stream:
        stream.write(to_json(document))
