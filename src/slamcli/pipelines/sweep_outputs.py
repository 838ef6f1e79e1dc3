# SPDX-License-Identifier: MIT
"""The files of a sweep: the document, tables, pictures, the report, and the best set as the system's own file."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from slamcli.outputs import atomic_file
from slamcli.parameters import as_dict
from slamcli.pipelines.native_files import ORBSLAM3
from slamcli.pipelines.run_record import run_document, to_json
from slamcli.pipelines.sweep import Sweep
from slamcli.pipelines.sweep_best import NativeText, native_text
from slamcli.pipelines.sweep_camera import recorded_camera
from slamcli.pipelines.sweep_document import sweep_document
from slamcli.pipelines.sweep_runs import found_by
from slamcli.reports.sweep_figures import sweep_figures
from slamcli.reports.sweep_page import sweep_page
from slamcli.reports.sweep_tables import runs_csv, sweep_markdown
from slamcli.runtime import RunLog

_TEXTS = ("sweep.json", "sweep.csv", "sweep.md", "report.html", "run.json")


def write_sweep(sweep: Sweep, log: RunLog) -> dict[str, Any]:
    """Write everything beside the runs, and return the document of ``sweep.json``."""
    folder = sweep.request.output
    native = _native(sweep)
    for old in folder.glob("best.*"):
        old.unlink()
    _write(folder / f"best{native.suffix}", native.text)
    with log.stage("write"):
        document = sweep_document(sweep, best_of(sweep, f"best{native.suffix}"), (), log)
        pictures = sweep_figures(document)
    document["outputs"] = sorted([*_TEXTS, *pictures, f"best{native.suffix}", "runs", "jobs"])
    for name, picture in pictures.items():
        with atomic_file(folder / name, "wb") as stream:
            stream.write(picture)
    _write(folder / "sweep.json", to_json(document))
    _write(folder / "sweep.csv", runs_csv(document))
    _write(folder / "sweep.md", sweep_markdown(document))
    _write(folder / "report.html", sweep_page(document))
    _write(folder / "run.json", to_json(_run_record(sweep, document, log)))
    return document


def _run_record(sweep: Sweep, document: dict[str, Any], log: RunLog) -> dict[str, Any]:
    """Return what was run on what; the figures stand in ``sweep.json``."""
    base = as_dict(sweep.baseline.parameters)
    best = document["best"]
    return run_document(
        command=document["command"], algo=document["algo"], parameters=base, changed={name: base[name] for name in sweep.fixed},
        seed=sweep.request.first_seed, jobs=sweep.request.jobs,
        inputs=[one for recording in document["recordings"] for one in recording["inputs"]], topics={}, frames={}, log=log,
        total_s=sum(log.seconds.values()), duration_s=0.0,
        summary={
            "sets": len(document["sets"]), "runs": len(document["runs"]), "failed": sum(s["failed"] for s in document["sets"]),
            "objective": document["objective"]["key"], "best": best["set"], "verdict": document["verdict"],
        },
        outputs=document["outputs"],
    )  # fmt: skip


def _native(sweep: Sweep) -> NativeText:
    best = sweep.best
    remark = f"slamcli sweep: {best.one.label}"
    run = sweep.best_run.run
    camera = recorded_camera(sweep.request, run.subject, sweep.baseline) if sweep.request.algo == ORBSLAM3 else {}
    return native_text(sweep.baseline, best.one.changes, found_by(run), camera, remark)


def best_of(sweep: Sweep, file: str) -> dict[str, Any]:
    """Return where the best set's file and run are, and the command that makes it again."""
    request, result = sweep.request, sweep.best_run
    run = result.run
    words = ["slamcli", "map", *map(str, run.subject.inputs), "--algo", request.algo]
    if sweep.baseline.remaps and not file.endswith(".launch"):  # topics stand in launch files alone
        for launch in request.config_files:
            words += ["--config", str(launch)]
    words += ["--config", str(request.output / file), *request.map_options]
    words += ["--seed", str(run.seed)]
    there = (run.folder / "run.json").is_file()
    return {
        "set": run.one.name,
        "values": dict(run.one.values),
        "run": run.name,
        "folder": run.folder.relative_to(request.output).as_posix() if there else None,
        "file": file,
        "command": shlex.join(words),
    }


def _write(path: Path, text: str) -> None:
    with atomic_file(path) as stream:
        stream.write(text)
