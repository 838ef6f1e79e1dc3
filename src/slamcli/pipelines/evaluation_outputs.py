# SPDX-License-Identifier: MIT
"""What an evaluation leaves on disk: figures, errors, the aligned trajectory, a plot, and the record of the run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import write_tum
from slamcli.outputs import atomic_directory, atomic_file
from slamcli.pipelines.evaluate import TrajectoryScore
from slamcli.pipelines.evaluate_map import MapScore
from slamcli.pipelines.evaluate_relations import RelationsScore
from slamcli.pipelines.evaluation_request import Request, Score
from slamcli.pipelines.run_record import describe_inputs, run_document, to_json
from slamcli.pipelines.trajectories import parse_source
from slamcli.runtime import RunLog


def write_outputs(
    request: Request, score: Score, document: Mapping[str, Any], log: RunLog, *, plot: str | None, output: str | None
) -> None:
    """Write the plot and the output folder that were asked for.

    Raises
    ------
    UsageError
        If a name cannot be written to.
    """
    if plot is not None and Path(plot).suffix.lower() != ".png":
        raise UsageError(f"--plot {plot}: the picture is a PNG, name it so")
    if plot is None and output is None:
        return
    with log.stage("plot"):
        picture = draw(score)
    if plot is not None:
        with atomic_file(plot, "wb") as stream:
            stream.write(picture)
    if output is not None:
        _write_folder(Path(output), request, score, document, log, picture)


def draw(score: Score) -> bytes:
    """Return a PNG of what was compared and of its errors."""
    from slamcli.reports.evaluation_plot import Series, map_plot, relations_plot, trajectory_plot

    if isinstance(score, RelationsScore):
        result, trajectory = score.result, score.trajectory
        at = (score.relations.first_ns[result.matched] - trajectory.stamps_ns.min()) / 1e9
        rows = [
            Series("translation in m", at, result.trans_m),
            Series("rotation in deg", at, np.degrees(result.rot_rad)),
        ]
        return relations_plot(trajectory, rows)
    if isinstance(score, MapScore):
        errors = score.errors
        return map_plot(score.walls_m, errors.to_reference_m, score.reference.walls_m, errors.to_map_m)
    if not isinstance(score, TrajectoryScore):
        raise UsageError("there is no plot of this kind of score")
    reference = score.reference
    stamps: NDArray[np.float64] = reference.stamps_s - reference.stamps_s[0]
    if not reference.timed:
        stamps = np.arange(len(reference), dtype=np.float64)
    named = {"ATE": score.ape, "ATE rotation": score.ape_rot, "RPE": score.rpe, "RPE rotation": score.rpe_rot}
    rows = [
        Series(
            f"{name} in {errors.relation.unit}" if errors.relation.unit else name, stamps[errors.indices], errors.errors
        )
        for name, errors in named.items()
        if errors is not None
    ]
    colours = None if score.ape is None else Series(rows[0].label, stamps, score.ape.errors)
    return trajectory_plot(reference, score.aligned, colours, rows)


def _write_folder(
    output: Path, request: Request, score: Score, document: Mapping[str, Any], log: RunLog, picture: bytes
) -> None:
    with atomic_directory(output) as folder:
        (folder / "plot.png").write_bytes(picture)
        (folder / "evaluation.json").write_text(to_json(document), encoding="utf-8")
        if isinstance(score, TrajectoryScore):
            write_tum(folder / "aligned.tum", score.aligned)
            _write_errors(folder / "errors.csv", score)
        elif isinstance(score, RelationsScore):
            _write_relation_errors(folder / "errors.csv", score)
        outputs = sorted([*(path.name for path in folder.iterdir()), "run.json"])
        (folder / "run.json").write_text(to_json(_run_record(request, score, log, outputs)), encoding="utf-8")


def _write_errors(path: Path, score: TrajectoryScore) -> None:
    """Write one line per matched pose; a relative error stands at the second pose of its pair (all pairs: the last one)."""
    columns = {"ate": score.ape, "ate_rot_deg": score.ape_rot, "rpe": score.rpe, "rpe_rot_deg": score.rpe_rot}
    table = np.full((len(score.matched), len(columns)), np.nan)
    for column, errors in enumerate(columns.values()):
        if errors is not None:
            table[errors.indices, column] = errors.errors
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(f"estimate_stamp_ns,reference_stamp_ns,{','.join(columns)}\n")
        stamps = zip(score.matched.estimate.stamps_ns.tolist(), score.matched.reference.stamps_ns.tolist(), strict=True)
        for (estimate, reference), row in zip(stamps, table.tolist(), strict=True):
            cells = ["" if value != value else repr(value) for value in row]
            stream.write(f"{estimate},{reference},{','.join(cells)}\n")


def _write_relation_errors(path: Path, score: RelationsScore) -> None:
    result, relations = score.result, score.relations
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write("first_stamp_ns,second_stamp_ns,trans_m,rot_deg\n")
        rows = zip(
            relations.first_ns[result.matched].tolist(),
            relations.second_ns[result.matched].tolist(),
            result.trans_m.tolist(),
            np.degrees(result.rot_rad).tolist(),
            strict=True,
        )
        for first, second, trans, rot in rows:
            stream.write(f"{first},{second},{trans!r},{rot!r}\n")


def _run_record(request: Request, score: Score, log: RunLog, outputs: list[str]) -> dict[str, Any]:
    paths = [parse_source(text).path for text in (request.estimate, request.reference)]
    if isinstance(score, MapScore):
        paths += [read_map(path).image for path in paths]
    mends = {"mends": dict(request.given_mends)} if request.given_mends else {}
    document = run_document(
        command="evaluate", algo="", parameters={**request.options, **mends},
        changed={name: request.options[name] for name in sorted(request.given)} | mends, seed=0, jobs=1, inputs=describe_inputs(paths),
        topics={}, frames={}, log=log, total_s=sum(log.seconds.values()), duration_s=0.0, summary=score.figures(), outputs=outputs,
    )  # fmt: skip
    return {**document, "estimate": request.estimate, "reference": request.reference}
