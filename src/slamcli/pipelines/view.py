# SPDX-License-Identifier: MIT
"""Pictures of whatever slamcli reads or writes: results, maps, trajectories and recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.formats.clouds import read_cloud
from slamcli.formats.maps import read_map
from slamcli.formats.octomap import read_octomap
from slamcli.formats.trajectories import read_trajectory
from slamcli.grids import OccupancyGrid
from slamcli.outputs import atomic_file
from slamcli.pipelines.replay_inputs import read_run
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.view_alignment import Alignment, laid_over
from slamcli.pipelines.view_source import OCTREES, default_output, find_kind
from slamcli.reports.figures import map_png, raster, track
from slamcli.reports.figures.cloud import cloud_view
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

if TYPE_CHECKING:
    from slamcli.posegraph import MapState
    from slamcli.recordings.mends import Mends

RECORDINGS = (".mcap", ".bag", "")
"""As what results are written besides pictures; without a suffix a ROS 2 folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewed:
    """What was drawn, and where it lies."""

    kind: str
    """result, map, cloud, state, database, trajectory or recording."""
    output: Path
    facts: Mapping[str, Any]
    """Figures of what is shown, for ``--json``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions:
    """How to draw."""

    truth: Path | None = None
    """Ground truth to draw beside the trajectory: whatever `load_trajectory` takes, a data-set folder too."""
    align: Alignment = "auto"
    """How what is drawn beside the first trajectory is laid over it; auto is fit for files, and start for those topics
    of a recording that are in another frame."""
    title: str | None = None
    """None for the name of what is shown."""
    max_pixels: int = 2000
    start_s: float | None = None
    duration_s: float | None = None
    scans: int = 200
    """Number of scans that are drawn of a recording, spread over it."""
    mends: Mends | None = None
    """What is mended while a recording is read."""
    recording: Sequence[Path] = ()
    """What a result was made of; empty: looked for by its record."""


def view(
    sources: Sequence[Path], output: Path | None = None, options: ViewOptions | None = None, log: RunLog | None = None
) -> Viewed:
    """Draw a result folder, a map, trajectories or a recording to a PNG and return where it lies.

    Parameters
    ----------
    sources
        One result folder, map.yaml, point cloud, saved state or database of RTAB-Map, one or more trajectory files, or the files of one recording.
    output
        The PNG, or an .mcap for a result. None for `slamcli.pipelines.view_source.default_output`.
    options
        How to draw.
    log
        Takes notes and warnings.

    Raises
    ------
    InputError
        If a source is missing or is none of these, or the output cannot be written.
    """
    options, log = options or ViewOptions(), log if log is not None else RunLog()
    kind = find_kind(sources)
    output = output or default_output(sources[0], kind)
    suffix = output.suffix.lower()
    if suffix in RECORDINGS and kind not in ("recording", "cloud"):
        return Viewed(kind=kind, output=output, facts=_write_recording(sources, kind, output, options, log))
    if suffix != ".png":
        raise UsageError(f"{output}: pictures are written as .png, results also as .mcap or .bag")
    if options.recording:
        raise UsageError("--recording is for what plays: --serve, --export, and -o FILE.mcap or .bag of a result")
    if kind == "recording":
        from slamcli.pipelines.view_recording import draw_recording

        image, facts = draw_recording(sources, options, log)
    elif kind == "cloud":
        image, facts = _draw_cloud(sources[0], options, log)
    elif kind == "trajectory":
        image, facts = _draw_trajectories(sources, options, log)
    else:
        image, facts = _draw_map(sources[0], kind, options, log)
    with atomic_file(output, "wb") as stream:
        stream.write(image)
    return Viewed(kind=kind, output=output, facts=facts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Content:
    """What lies in a result, a map or a trajectory file."""

    grid: OccupancyGrid | None
    trajectory: Trajectory | None
    truth: tuple[str, Trajectory] | None
    """Name and trajectory."""
    facts: dict[str, Any]


def _read(source: Path, kind: str, options: ViewOptions, log: RunLog) -> _Content:
    yaml = {"result": source / "map.yaml", "map": source}.get(kind)
    path = {"result": source / "trajectory.tum", "trajectory": source}.get(kind)
    grid = trajectory = None
    facts = _run_facts(source / "run.json", log) if kind == "result" else {}
    if yaml is not None and (kind == "map" or yaml.is_file()):
        read = read_map(yaml)
        grid, facts = read.grid, facts | map_facts(read.grid)
        for warning in read.warnings:
            log.warn(warning)
    if path is not None and (kind == "trajectory" or path.is_file()):
        trajectory = read_trajectory(path, log=log)
        facts |= trajectory_facts(trajectory)
    if kind == "state":
        from slamcli.formats.pbstream.reading import read_state  # brings numba, which other pictures do not need
        from slamcli.pipelines.config import load_native
        from slamcli.pipelines.saved_state import result_of

        state, parameters = read_state(source, log=log), load_native("cartographer").parameters
        drawn = result_of(state, "cartographer", parameters, map_frame="map", base_frame="base_link", log=log)
        grid, trajectory = drawn.grid, drawn.trajectory
        facts |= dict(drawn.summary) | ({} if grid is None else map_facts(grid)) | trajectory_facts(trajectory)
    if kind == "database":
        from slamcli.pipelines.view_database import read_database_map

        grid, trajectory = read_database_map(source, log)
        facts |= ({} if grid is None else map_facts(grid)) | trajectory_facts(trajectory)
    if grid is None and trajectory is None:
        raise UsageError(f"{source}: neither map.yaml nor trajectory.tum lies in this result")
    truth = read_truth(options, trajectory, log)
    return _Content(grid=grid, trajectory=trajectory, truth=truth, facts=facts)


def read_truth(options: ViewOptions, base: Trajectory | None, log: RunLog) -> tuple[str, Trajectory] | None:
    """Return name and trajectory of the ground truth that was asked for, laid over `base`."""
    if options.truth is None:
        return None
    truth = load_trajectory(options.truth, log=log)
    return laid_over(base, "ground truth", truth, options.align, log) if base is not None else ("ground truth", truth)


def _write_recording(
    sources: Sequence[Path], kind: str, output: Path, options: ViewOptions, log: RunLog
) -> dict[str, Any]:
    from slamcli.reports.mcap import write_replay, write_result

    if len(sources) > 1:
        raise UsageError(f"{output}: a recording holds one result or trajectory; {len(sources)} were given")
    content = _read(sources[0], kind, options, log)
    if kind == "result" and content.trajectory is not None:
        from slamcli.pipelines.replay import load_replay

        replay = load_replay(sources[0], recording=options.recording, truth=options.truth, mends=options.mends, log=log)
        messages = write_replay(output, replay)
        return content.facts | {"growth": replay.growth, "messages": messages}
    truth = content.truth[1] if content.truth is not None else None
    messages = write_result(
        output, grid=content.grid, trajectory=content.trajectory, truth=truth, state=_state(sources[0], kind, log)
    )
    return content.facts | {"messages": messages}


def _state(source: Path, kind: str, log: RunLog) -> MapState | None:
    if kind != "state":
        return None
    from slamcli.formats.pbstream.reading import read_state

    return read_state(source, log=log)


def _draw_map(source: Path, kind: str, options: ViewOptions, log: RunLog) -> tuple[bytes, dict[str, Any]]:
    """Draw a map, or a result: its map with its trajectory, or the trajectory alone where there is no map."""
    content = _read(source, kind, options, log)
    title = source.resolve().name if options.title is None else options.title
    if content.grid is None and content.trajectory is not None:
        image = track.track_image(content.trajectory, truth=content.truth, title=title, max_pixels=options.max_pixels)
        return raster.png(image), content.facts
    if content.grid is None:
        raise UsageError(f"{source}: no map in it")
    picture = map_png(
        content.grid,
        trajectory=content.trajectory,
        truth=content.truth[1] if content.truth is not None else None,
        truth_label=content.truth[0] if content.truth is not None else "",
        title=title,
        max_pixels=options.max_pixels,
    )
    return picture, content.facts


def _draw_trajectories(sources: Sequence[Path], options: ViewOptions, log: RunLog) -> tuple[bytes, dict[str, Any]]:
    read = [read_trajectory(source, log=log) for source in sources]
    if len(read) > 6:
        raise UsageError(f"{len(read)} trajectories: six can be told apart")
    others = [
        laid_over(read[0], source.name, trajectory, options.align, log)
        for source, trajectory in zip(sources[1:], read[1:], strict=True)
    ]
    truth = read_truth(options, read[0], log)
    image = track.track_image(
        read[0],
        others,
        truth=truth,
        label=sources[0].name,
        title=options.title or "",
        max_pixels=options.max_pixels,
    )
    facts = trajectory_facts(read[0])
    if len(read) > 1:
        facts["others"] = [{"file": str(s), **trajectory_facts(t)} for s, t in zip(sources[1:], read[1:], strict=True)]
    return raster.png(image), facts


def _draw_cloud(source: Path, options: ViewOptions, log: RunLog) -> tuple[bytes, dict[str, Any]]:
    """Draw a point cloud, or what is occupied in an octree, from above, with the trajectory that is given as truth."""
    if source.suffix.lower() in OCTREES:
        octree = read_octomap(source)
        points = octree.select(octree.occupied).centres_m.astype(np.float32)
    else:
        points = read_cloud(source).points_m
    if not len(points):
        raise UsageError(f"{source}: a point cloud without points")
    truth = None if options.truth is None else load_trajectory(options.truth, log=log)
    image = cloud_view(points, (0, 1), trajectory=truth, max_pixels=options.max_pixels)
    low, high = points.min(axis=0), points.max(axis=0)
    return raster.png(image), {"points": len(points), "low_m": low.tolist(), "high_m": high.tolist()}


def map_facts(grid: OccupancyGrid) -> dict[str, Any]:
    """Return size and areas of a map."""
    area = grid.resolution_m**2
    return {
        "width_cells": grid.width,
        "height_cells": grid.height,
        "resolution_m": grid.resolution_m,
        "origin": list(grid.origin),
        "known_area_m2": float(np.count_nonzero(grid.cells >= 0) * area),
        "occupied_area_m2": float(np.count_nonzero(grid.cells >= 65) * area),
    }


def trajectory_facts(trajectory: Trajectory) -> dict[str, Any]:
    """Return size, length and duration of a trajectory."""
    stamps: NDArray[np.int64] = trajectory.stamps_ns
    timed = trajectory.timed and len(trajectory) > 0
    return {
        "poses": len(trajectory),
        "length_m": trajectory.length_m,
        "duration_s": float(stamps.max() - stamps.min()) / 1e9 if timed else None,
    }


def _run_facts(path: Path, log: RunLog) -> dict[str, Any]:
    """Return what of a run's record belongs beside its picture."""
    run = read_run(path, log)
    return {key: run[key] for key in ("algo", "seed", "timing", "summary") if key in run}
