# SPDX-License-Identifier: MIT
"""Figures of a result without ground truth: whether what its recording saw makes one map."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slamcli.errors import EstimationError, FormatError
from slamcli.evaluation.map_layers import map_layers
from slamcli.evaluation.redrawn_map import redraw
from slamcli.evaluation.seen_points import PlacedPoints, has_pose, place
from slamcli.evaluation.sharpness import Scales, Sharpness, scales_of, sharpness
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_tum
from slamcli.pipelines.compare_points import PointsRequest, RecordedPoints, read_points
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

_FARTHEST_M = 1.0
_NEAR_M, _NEAR_CELLS = 0.1, 2.0
_RESIDUAL_POINTS = 60_000
_LOOPS = frozenset({"inter", "loop", "proximity"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Consistency:
    """What a result says of itself; where a thing cannot be measured its figure is left out."""

    values: Mapping[str, float]
    scales: Scales | None = None
    """Of the figures of points; None where the recording has none."""
    sharpness: Sharpness | None = None
    placed: PlacedPoints | None = None
    residuals_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """float64 (N,), of what was seen to the map's nearest wall, at most 1 m, in the order of time; NaN without a pose or map."""
    residual_stamps_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def figures(self) -> dict[str, float]:
        """Return every figure by its key (see `slamcli.evaluation.figure_catalogue`)."""
        return dict(self.values)


def measure_consistency(folder: Path, recording: PointsRequest | None, log: RunLog) -> Consistency:
    """Return the figures of a folder that ``slamcli map`` wrote.

    Parameters
    ----------
    folder
        The result.
    recording
        What it was made of; None: only what the folder itself tells (the residuals of its graph).

    Raises
    ------
    InputError
        If the folder is no result, or the recording cannot be read.
    """
    if recording is None:
        return consistency_of(folder, None)
    with log.stage("points"):
        points = read_points(recording, [base_frame_of(folder)], log)
    with log.stage("consistency"):
        return consistency_of(folder, points)


def consistency_of(folder: Path, points: RecordedPoints | None) -> Consistency:
    """Return the figures of a result, with points that were read already; see :func:`measure_consistency`."""
    trajectory = result_trajectory(folder)
    values = _loop_residuals(folder)
    if points is None or not len(points.seen):
        return Consistency(values=values)
    scales = scales_of(points.seen)
    try:
        placed = place(points.seen, trajectory, points.T_base_sensor[base_frame_of(folder)])
    except EstimationError:
        return Consistency(values=values, scales=scales)
    sharp = sharpness(placed, scales)
    redrawn = redraw(placed, scales.cell_m) if placed.planar else None
    found = {
        "map.wall_thickness_m": _mean(sharp.wall_thickness_m),
        "map.mean_entropy": sharp.mean_entropy,
        "revisit.distance_m": sharp.revisit_distance_m,
        "map.wall_thickness_p90_m": _quantile(sharp.wall_thickness_m, 0.9),
        "map.entropy": math.nan if redrawn is None else redrawn.entropy_bits,
        "revisit.offset.mean": _mean(sharp.revisit_offset_m),
        "revisit.offset.p90": _quantile(sharp.revisit_offset_m, 0.9),
        "revisit.share": sharp.revisited,
    }
    residuals, stamps, near = _map_residuals(folder, placed)
    if len(residuals):
        found |= {
            "scan.residual.median": float(np.median(residuals)),
            "scan.residual.p90": _quantile(residuals, 0.9),
            "scan.near": float((residuals <= near).mean()),
        }
    found["coverage"] = float(has_pose(points.seen.stamps_ns, trajectory).mean())
    finite = {key: value for key, value in found.items() if math.isfinite(value)}
    return Consistency(
        values=finite | values,
        scales=scales,
        sharpness=sharp,
        placed=placed,
        residuals_m=residuals,
        residual_stamps_ns=stamps,
    )


def result_trajectory(folder: Path) -> Trajectory:
    """Return the trajectory of a result folder.

    Raises
    ------
    FormatError
        If there is none.
    """
    path = folder / "trajectory.tum"
    if not path.exists():
        raise FormatError(f"{folder}: no trajectory.tum: is it a folder that `slamcli map` wrote?")
    return read_tum(path)


def read_run(folder: Path) -> dict[str, Any]:
    """Return ``run.json`` of a result folder.

    Raises
    ------
    FormatError
        If there is none, or it is damaged.
    """
    try:
        document = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FormatError(
            f"{folder}: no readable run.json: is it a folder that `slamcli map` wrote? ({error})"
        ) from None
    if not isinstance(document, dict):
        raise FormatError(f"{folder}/run.json: not an object: is it a folder that `slamcli map` wrote?")
    return document


def base_frame_of(folder: Path) -> str:
    """Return the frame whose poses a result holds."""
    frames = read_run(folder).get("frames")
    return str(frames.get("base") or "") if isinstance(frames, dict) else ""


def _map_residuals(folder: Path, placed: PlacedPoints) -> tuple[NDArray[np.float64], NDArray[np.int64], float]:
    """Return distances to the map's nearest wall and their stamps, and up to where a point is on a wall; empty without a map."""
    none = np.zeros(0), np.zeros(0, dtype=np.int64), _NEAR_M
    if not placed.planar or not (folder / "map.yaml").exists():
        return none
    grid = read_map(folder / "map.yaml").grid
    try:
        walls = map_layers(grid, str(folder)).walls_m
    except EstimationError:
        return none
    step = max(-(-len(placed) // _RESIDUAL_POINTS), 1)
    distances, _ = cKDTree(walls).query(placed.points_m[::step, :2], distance_upper_bound=_FARTHEST_M)
    return np.minimum(distances, _FARTHEST_M), placed.stamps_ns[::step], max(_NEAR_M, _NEAR_CELLS * grid.resolution_m)


def _loop_residuals(folder: Path) -> dict[str, float]:
    """Return by how much the final poses miss what closed loops said, from ``constraints.csv`` or ``links.csv``."""
    for name in ("constraints.csv", "links.csv"):
        path = folder / name
        if not path.exists():
            continue
        with path.open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.DictReader(stream) if row.get("kind") in _LOOPS]
        metres = np.array([float(row["translation_residual_m"]) for row in rows if row.get("translation_residual_m")])
        found = {"loop.count": float(len(rows))}
        if len(metres):
            found |= {"loop.residual.median": float(np.median(metres)), "loop.residual.p90": _quantile(metres, 0.9)}
        return found
    return {}


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else math.nan


def _quantile(values: NDArray[np.float64], share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else math.nan
