# SPDX-License-Identifier: MIT
"""What there is to see in a result, a map, a saved state, a database or a trajectory file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_trajectory
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.replay_inputs import read_run
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.view_alignment import laid_over
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

if TYPE_CHECKING:
    from slamcli.pipelines.view import ViewOptions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Content:
    """What lies in a result, a map or a trajectory file."""

    grid: OccupancyGrid | None
    trajectory: Trajectory | None
    truth: tuple[str, Trajectory] | None
    """Name and trajectory."""
    facts: dict[str, Any]


def read_content(source: Path, kind: str, options: ViewOptions, log: RunLog) -> Content:
    """Return what lies in a result, a map, a state, a database or a trajectory file.

    Raises
    ------
    InputError
        If there is nothing, or it cannot be read.
    """
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
    return Content(grid=grid, trajectory=trajectory, truth=truth, facts=facts)


def read_truth(options: ViewOptions, base: Trajectory | None, log: RunLog) -> tuple[str, Trajectory] | None:
    """Return name and trajectory of the ground truth that was asked for, laid over `base`."""
    if options.truth is None:
        return None
    truth = load_trajectory(options.truth, log=log)
    return laid_over(base, "ground truth", truth, options.align, log) if base is not None else ("ground truth", truth)


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
