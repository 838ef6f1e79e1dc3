# SPDX-License-Identifier: MIT
"""What ``slamcli localize`` writes: poses with their covariances, the map with the track on it, the report and the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation import AlignMode
from slamcli.formats.trajectories import write_tum
from slamcli.mapper import MappingResult
from slamcli.parameters import Declaration
from slamcli.pipelines.run_record import step_columns, to_json
from slamcli.pipelines.trajectory_score import TrajectoryScore
from slamcli.pipelines.view_alignment import laid_over
from slamcli.reports.figures import map_png
from slamcli.reports.html import report
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

RECORDS = ("report.html", "run.json")
_CLOSE_M, _CLOSE_DEG = 0.3, 10.0
"""Nearer than both to the truth counts as localised."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """What lies in the folder before the records, and what was made for it that the report shows too."""

    names: tuple[str, ...]
    map_image: bytes
    truth: Trajectory | None


def write_localization(
    folder: Path,
    result: MappingResult,
    covariances: NDArray[np.float64],
    score: TrajectoryScore | None,
    log: RunLog,
) -> Written:
    """Write ``trajectory.tum``, ``poses.csv`` and ``map.png`` into `folder`."""
    write_tum(folder / "trajectory.tum", result.trajectory)
    _write_poses(folder / "poses.csv", result, covariances)
    truth = None if score is None else score.reference
    if score is not None and score.options.align is not AlignMode.NONE:
        truth = laid_over(result.trajectory, "truth", score.reference, "fit", log)[1]
    picture = b"" if result.grid is None else map_png(result.grid, trajectory=result.trajectory, truth=truth)
    (folder / "map.png").write_bytes(picture)
    return Written(names=("trajectory.tum", "poses.csv", "map.png"), map_image=picture, truth=truth)


def write_records(
    folder: Path,
    run: Mapping[str, Any],
    result: MappingResult,
    written: Written,
    score: TrajectoryScore | None,
    declared: Sequence[Declaration],
) -> None:
    """Write ``report.html`` and ``run.json``."""
    errors = None
    if score is not None and score.ape is not None and score.ape_rot is not None:
        errors = {
            "stamp_ns": score.aligned.stamps_ns[score.ape.indices],
            "translation_m": score.ape.errors,
            "rotation_rad": np.radians(score.ape_rot.errors),
        }
    page = report(
        run, map_image=written.map_image, steps=result.steps, trajectory=result.trajectory, truth=written.truth,
        errors=errors, grid=result.grid, declared=declared,
    )  # fmt: skip
    (folder / "report.html").write_text(page, encoding="utf-8")
    document = {**run, "steps": step_columns(result.steps)}
    (folder / "run.json").write_text(to_json(document), encoding="utf-8")


def after_convergence(score: TrajectoryScore) -> dict[str, float | None]:
    """Return when the estimate came within 0.3 m and 10 degrees of the truth to stay, and its errors from then on.

    Times count from the first pose that has a true one; where it never stays, everything is None.
    """
    if score.ape is None or score.ape_rot is None:
        return {}
    distances, turns = score.ape.errors, np.abs(score.ape_rot.errors)
    far = np.flatnonzero((distances > _CLOSE_M) | (turns > _CLOSE_DEG))
    first = 0 if not len(far) else int(far[-1]) + 1
    if first >= len(distances):
        return {"converged.after_s": None, "converged.trans_rmse_m": None, "converged.rot_rmse_deg": None}
    stamps = score.aligned.stamps_ns[score.ape.indices]
    return {
        "converged.after_s": float(stamps[first] - stamps[0]) / 1e9,
        "converged.trans_rmse_m": float(np.sqrt(np.mean(distances[first:] ** 2))),
        "converged.rot_rmse_deg": float(np.sqrt(np.mean(turns[first:] ** 2))),
    }


def _write_poses(path: Path, result: MappingResult, covariances: NDArray[np.float64]) -> None:
    """Write one line for each scan: pose, covariance of x, y (metres) and yaw (radians), particles, whether it was used, its fit."""
    steps, poses = result.steps, result.trajectory.poses_se2
    lines = ["stamp_ns,x,y,yaw,cov_xx,cov_xy,cov_xyaw,cov_yy,cov_yyaw,cov_yawyaw,particles,used,scan_fit"]
    rows, columns = np.triu_indices(3)
    for k, (pose, covariance) in enumerate(zip(poses, covariances, strict=True)):
        numbers = [*pose.tolist(), *covariance[rows, columns].tolist()]
        lines.append(
            f"{steps['stamp_ns'][k]},{','.join(f'{value:.9g}' for value in numbers)},"
            f"{steps['particles'][k]},{steps['used'][k]},{steps['scan_fit'][k]:.6g}"
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
