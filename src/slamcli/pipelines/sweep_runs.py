# SPDX-License-Identifier: MIT
"""The runs of a sweep: which jobs they are, and what is kept of each: a small file of figures."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from slamcli.outputs import atomic_file
from slamcli.pipelines.compare_points import PointsRequest
from slamcli.pipelines.jobs import Job, JobOutcome
from slamcli.pipelines.run_record import describe_inputs
from slamcli.pipelines.sweep_axes import value_text
from slamcli.pipelines.sweep_best import FoundInput
from slamcli.pipelines.sweep_objective import Objective, needs_no_truth
from slamcli.pipelines.sweep_request import Subject, SweepRequest
from slamcli.pipelines.sweep_scoring import Eyes, score_result
from slamcli.pipelines.sweep_sets import ParameterSet
from slamcli.pipelines.trajectories import parse_source
from slamcli.runtime import RunLog

_SCORING = 1
"""Changes when other figures are taken from a result: those on disk are then measured again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One set with one seed on one recording."""

    subject: Subject
    one: ParameterSet
    seed: int
    folder: Path
    """Where ``slamcli map`` writes."""

    @property
    def name(self) -> str:
        """Of the job: stable from recording, values and seed."""
        own = f"{self.one.name}-s{self.seed}"
        return f"{self.subject.name}.{own}" if self.subject.name else own

    @property
    def figures_file(self) -> Path:
        """Where its figures are kept, beside its folder."""
        return self.folder.with_name(f"{self.folder.name}.json")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """What became of one run."""

    run: Run
    figures: Mapping[str, float]
    """By key; empty if it failed."""
    failure: str
    """Why it failed; empty if it did not."""
    exit_code: int
    wall_s: float
    cpu_s: float
    peak_memory_bytes: int
    reused: bool
    """Whether an earlier sweep had run it."""
    covered: float = math.nan
    """How much of the recording it covers, as a share of what the best run covers; NaN where that is not known."""


def found_by(run: Run) -> FoundInput:
    """Return what a run found in its recording; nothing where it has not run."""
    known = _read(run.figures_file)
    return FoundInput() if known is None else FoundInput(**known["found"])


def plan_runs(request: SweepRequest, sets: Sequence[ParameterSet]) -> list[Run]:
    """Return all runs: the baseline of every recording first, then set by set, so that a sweep that is stopped has whole sets."""
    return [
        Run(
            subject=subject, one=one, seed=seed,
            folder=request.output / "runs" / subject.name / f"{one.name}-s{seed}",
        )
        for one in sets
        for subject in request.subjects
        for seed in request.seeds
    ]  # fmt: skip


def job_of(run: Run, request: SweepRequest, fixed: Sequence[str]) -> Job:
    """Return the job that makes a run; its output is the file of figures, which outlives the folder.

    The reference is no input of the job: that figures are those of another reference is seen from the file.
    """
    words = ["map", "--algo", request.algo, *map(str, run.subject.inputs)]
    for file in request.config_files:
        words += ["--config", str(file)]
    for name, value in request.launch_arguments.items():
        words += ["--arg", f"{name}={value}"]
    words += request.map_options
    for text in (*fixed, *(f"{name}={value_text(value)}" for name, value in run.one.changes.items())):
        words += ["--set", text]
    words += ["--seed", str(run.seed), "--jobs", str(request.jobs), "-o", str(run.folder)]
    inputs = (*run.subject.inputs, *(file for file in request.config_files if file.exists()))
    return Job(name=run.name, arguments=tuple(words), output=run.figures_file, makes=run.folder, inputs=inputs)


class Bookkeeper:
    """Turns finished jobs into figures, once; knows which folders may go."""

    def __init__(self, request: SweepRequest, objective: Objective, log: RunLog) -> None:
        self._request = request
        self._log = log
        alone = needs_no_truth(objective.key)
        self._eyes = {s.name: Eyes(_points(request, s)) for s in request.subjects if alone}
        self._keys = {subject.name: _scoring_key(subject, alone=alone) for subject in request.subjects}

    def prepare(self, runs: Sequence[Run]) -> None:
        """Measure again what was measured in another way, or forget it, so that it runs again."""
        for run in runs:
            known = _read(run.figures_file)
            if known is not None and known["scoring"] == self._keys[run.subject.name]:
                continue
            if not run.figures_file.exists():
                continue
            if (run.folder / "run.json").is_file():
                self._measure(run)
            else:
                run.figures_file.unlink()

    def take(self, run: Run, outcome: JobOutcome) -> RunResult:
        """Return what became of a run, and keep its figures."""
        if not outcome.done:
            shutil.rmtree(run.folder, ignore_errors=True)
            run.figures_file.unlink(missing_ok=True)
            return _result(run, outcome, {}, _reason(outcome))
        known = _read(run.figures_file) if outcome.reused else None
        if known is None:
            known = self._measure(run)
        figures = {name: math.nan if value is None else float(value) for name, value in known["figures"].items()}
        own = {"time.wall_s": outcome.wall_s, "time.cpu_s": outcome.cpu_s}
        return _result(run, outcome, {**figures, **own} if figures else {}, str(known["failure"]))

    def _measure(self, run: Run) -> dict[str, Any]:
        eyes = self._eyes.get(run.subject.name)
        measured = score_result(run.folder, run.subject.reference, self._request.mends, eyes, self._log)
        figures = {name: value if math.isfinite(value) else None for name, value in measured.figures.items()}
        document = {
            "scoring": self._keys[run.subject.name], "failure": measured.failure, "figures": figures,
            "found": asdict(FoundInput.of(run.folder)),
        }  # fmt: skip
        with atomic_file(run.figures_file) as stream:
            json.dump(document, stream, indent=1)
        return document


def _points(request: SweepRequest, subject: Subject) -> PointsRequest:
    asked = request.sensors
    return PointsRequest(
        inputs=subject.inputs, mends=request.mends, start_s=asked.start_s, duration_s=asked.duration_s,
        scan_topics=asked.names.scans, points_topics=asked.names.points, cameras=asked.cameras,
        camera_files=asked.camera_files,
    )  # fmt: skip


def _result(run: Run, outcome: JobOutcome, figures: Mapping[str, float], failure: str) -> RunResult:
    return RunResult(
        run=run, figures=figures, failure=failure, exit_code=outcome.exit_code, wall_s=outcome.wall_s,
        cpu_s=outcome.cpu_s, peak_memory_bytes=outcome.peak_memory_bytes, reused=outcome.reused,
    )  # fmt: skip


def _reason(outcome: JobOutcome) -> str:
    if outcome.exit_code < 0:
        return f"ended by signal {-outcome.exit_code}"
    return outcome.message.removeprefix("slamcli: ") or f"exit code {outcome.exit_code}"


def _scoring_key(subject: Subject, *, alone: bool) -> str:
    """Return what says that figures are those of this reference, and whether those that need none are among them."""
    known: list[Any] = [_SCORING, alone]
    if subject.reference is not None:
        source = parse_source(subject.reference)
        path = Path(source.path)
        known += [source.part, describe_inputs([path]) if path.exists() else str(path)]
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()


def _read(file: Path) -> dict[str, Any] | None:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        return document if {"scoring", "failure", "figures", "found"} <= document.keys() else None
    except (OSError, ValueError, AttributeError):
        return None
