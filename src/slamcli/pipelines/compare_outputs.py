# SPDX-License-Identifier: MIT
"""What a comparison leaves in its folder: the document, the tables, the pictures, the page and the record of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.evaluation.compare_story import medians_over_time
from slamcli.outputs import atomic_file
from slamcli.pipelines.compare_document import Row
from slamcli.pipelines.compare_request import CompareRequest
from slamcli.pipelines.compare_scores import Truth, lay_over
from slamcli.pipelines.run_record import run_document, to_json
from slamcli.reports.compare_page import comparison_page
from slamcli.reports.compare_pictures import Shown, map_pictures, overlay_picture, trajectory_picture
from slamcli.reports.compare_tables import comparison_markdown
from slamcli.reports.svg import Series
from slamcli.runtime import RunLog

_COLOURS = (0, 1, 3, 4, 5)
"""Of the results, in their order; the page's third colour is the truth's."""


def write_comparison(
    output: Path,
    document: Mapping[str, Any],
    rows: Sequence[Row],
    truth: Truth,
    begin_ns: int,
    request: CompareRequest,
    log: RunLog,
    total_s: float,
) -> None:
    """Write everything but the results themselves, which their own runs wrote; each file appears whole or not at all.

    Parameters
    ----------
    begin_ns
        Start of the recording: charts count seconds from it.
    total_s
        How long the comparison took so far, for the record of the run.
    """
    shown = [
        Shown(name=row.compared.name, trajectory=row.laid.trajectory, grid=row.laid.grid, colour=_COLOURS[i % len(_COLOURS)], marks=tuple(row.laid.place(f.at_m) for f in row.findings if f.at_m is not None))
        for i, row in enumerate(rows) if row.laid is not None
    ]  # fmt: skip
    true_path = None
    if truth.trajectory is not None:
        first = next(row.compared.trajectory for row in rows if row.compared.trajectory is not None)
        true_path = lay_over(truth.trajectory, None, first).trajectory
    pictures = {
        "maps.png": map_pictures(shown, true_path),
        "overlay.png": overlay_picture(shown),
        "trajectories.png": trajectory_picture(shown, true_path),
    }
    for name, picture in pictures.items():
        if picture:
            with atomic_file(output / name, "wb") as stream:
                stream.write(picture)
        else:
            (output / name).unlink(missing_ok=True)  # of an earlier comparison
    against = "the truth" if truth.trajectory is not None else shown[0].name
    errors, residuals = _series(rows, begin_ns)
    texts = {
        "compare.json": to_json(document),
        "compare.md": comparison_markdown(document),
        "report.html": comparison_page(document, pictures, errors, residuals, against, request.command),
    }
    outputs = sorted([*texts, *(name for name, picture in pictures.items() if picture), "run.json"])
    texts["run.json"] = to_json(
        _run_record(document, [row.compared.run for row in rows if row.compared.run], request, log, outputs, total_s)
    )
    for name, text in texts.items():
        with atomic_file(output / name) as stream:
            stream.write(text)


def _series(rows: Sequence[Row], begin_ns: int) -> tuple[list[Series], list[Series]]:
    """Return errors over time and median residuals over time, of the results that have them."""
    errors, residuals = [], []
    for i, row in enumerate(rows):
        colour, name = _COLOURS[i % len(_COLOURS)], row.compared.name
        if row.scores.errors is not None:
            found = row.scores.errors
            order = np.argsort(found.stamps_ns, kind="stable")
            x = (found.stamps_ns[order] - begin_ns) / 1e9
            errors.append(Series(label=name, x=x, y=found.errors_m[order], colour=colour))
        stamps, medians = medians_over_time(row.consistency.residual_stamps_ns, row.consistency.residuals_m)
        if len(stamps):
            residuals.append(Series(label=name, x=(stamps - begin_ns) / 1e9, y=medians, colour=colour))
    return errors, residuals


def _run_record(
    document: Mapping[str, Any],
    runs: Sequence[Mapping[str, Any]],
    request: CompareRequest,
    log: RunLog,
    outputs: list[str],
    total_s: float,
) -> dict[str, Any]:
    results = document["results"]
    length_s = max((float((row.get("timing") or {}).get("recording_s") or 0.0) for row in runs), default=0.0)
    return run_document(
        command=request.command or "slamcli compare", algo=",".join(dict.fromkeys(entry["algo"] for entry in results)),
        parameters={
            "references": document["references"], "start_s": request.start_s, "duration_s": request.duration_s,
            "results": {entry["name"]: entry["state"] for entry in results},
        },
        changed={}, seed=request.seed, jobs=request.jobs, inputs=document["inputs"], topics={}, frames={}, log=log, total_s=total_s,
        duration_s=length_s,
        summary={f"{entry['name']}.{key}": value for entry in results for key, value in entry["figures"].items()}, outputs=outputs,
    )  # fmt: skip
