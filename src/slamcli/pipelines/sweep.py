# SPDX-License-Identifier: MIT
"""Many values of native parameters on the same recording: the recipe of ``slamcli sweep``."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import EstimationError, RecordingError, UsageError
from slamcli.outputs import check_directory
from slamcli.pipelines.config import NativeConfig, load_native
from slamcli.pipelines.evaluation_request import check_reference, find_kind
from slamcli.pipelines.jobs import Job, JobOutcome, run_jobs
from slamcli.pipelines.sweep_axes import Axis, parse_axis, value_text
from slamcli.pipelines.sweep_objective import (
    DEFAULTS,
    OF_REFERENCE,
    WITHOUT_TRUTH,
    Objective,
    find_figure,
    find_objective,
)
from slamcli.pipelines.sweep_ranking import SetResult, rank_sets, without_lost
from slamcli.pipelines.sweep_request import SweepRequest
from slamcli.pipelines.sweep_runs import Bookkeeper, Run, RunResult, job_of, plan_runs
from slamcli.pipelines.sweep_sets import ParameterSet, parameter_sets
from slamcli.runtime import RunLog

Told = Callable[[RunResult, int, int], None]
"""Is called with each result as it comes, how many there are by now, and how many there will be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """What a sweep found."""

    request: SweepRequest
    axes: tuple[Axis, ...]
    """What was varied."""
    fixed: Mapping[str, Any]
    """What ``--set`` gave one value, by native name."""
    baseline: NativeConfig
    """The parameters without what is varied."""
    objective: Objective
    sets: tuple[SetResult, ...]
    """The best first."""

    @property
    def best(self) -> SetResult:
        """The set of rank 1."""
        return self.sets[0]

    @property
    def best_run(self) -> RunResult:
        """The run of the best set with the first seed on the first recording."""
        return self.best.runs[0]

    @property
    def results(self) -> tuple[RunResult, ...]:
        """All runs, set by set in the order of ranks."""
        return tuple(result for one in self.sets for result in one.runs)


def run_sweep(request: SweepRequest, log: RunLog, told: Told = lambda *_: None) -> Sweep:
    """Run every set with every seed on every recording, rank the sets, and keep what is to be kept.

    What was run before into the same folder, with the same values on the same recording, is not run again.

    Raises
    ------
    InputError
        If a parameter, a value, an option or an input is wrong; before anything runs as far as it can be known then.
    EstimationError
        If no run came to a value of the objective.
    """
    axes, fixed = _axes(request)
    texts = [f"{name}={value_text(value)}" for name, value in fixed.items()]
    base = load_native(request.algo, request.config_files, texts, log, request.launch_arguments)
    objective = _objective(request)
    sets = parameter_sets(axes, base.parameters, request.algo, draws=request.draws, seed=request.first_seed)
    if len(sets) * request.num_seeds == 1:
        raise UsageError("nothing is varied: name several values with --set KEY=V1,V2, or several seeds with --seeds N")
    _check_places(request)
    runs = plan_runs(request, sets)
    results = _run_all(request, runs, texts, objective, log, told)
    results = without_lost(results, request.least_coverage)
    ranked = rank_sets(sets, results, request.subjects, objective)
    if not ranked[0].spread.count:
        raise EstimationError(f"every run failed; the first one: {results[0].failure}")
    sweep = Sweep(
        request=request, axes=tuple(axes), fixed=fixed, baseline=base, objective=objective, sets=tuple(ranked)
    )
    _tell(sweep, log)
    _keep(sweep, texts)
    return sweep


def _axes(request: SweepRequest) -> tuple[list[Axis], dict[str, Any]]:
    """Return what is varied, and what ``--set`` gives one value."""
    found: dict[str, Axis] = {}
    for text in request.sets:
        axis = parse_axis(text, request.algo)
        if axis.name in found:
            raise UsageError(f"--set {axis.name} is given twice: name all its values in one")
        found[axis.name] = axis
    fixed = {axis.name: axis.values[0] for axis in found.values() if len(axis.values) == 1}
    return [axis for axis in found.values() if axis.name not in fixed], fixed


def _objective(request: SweepRequest) -> Objective:
    references = [subject.reference for subject in request.subjects if subject.reference is not None]
    for reference in references:  # told now what is wrong with it, and not after hours
        check_reference(reference, request.mends)
    kinds = {find_kind(reference) for reference in references}
    if len(kinds) > 1:
        raise UsageError(f"--ref: recordings have references of different kinds ({', '.join(sorted(kinds))})")
    key = request.objective
    if key is None:
        return find_objective(DEFAULTS[kinds.pop()] if kinds else WITHOUT_TRUTH, request.maximise)
    if not kinds and key.partition(".")[0] in OF_REFERENCE:
        raise UsageError(f"--objective {key}: is a figure of a comparison with what is true: name that with --ref")
    return find_objective(key, request.maximise)


def _check_places(request: SweepRequest) -> None:
    for subject in request.subjects:
        for path in subject.inputs:
            if not path.exists():
                raise RecordingError(f"{path}: no such file")
    check_directory(request.output)


def _run_all(
    request: SweepRequest, runs: Sequence[Run], fixed: Sequence[str], objective: Objective, log: RunLog, told: Told
) -> list[RunResult]:
    """Run what is not done yet, and measure each result when it is there."""
    by_name = {run.name: run for run in runs}
    found: dict[str, RunResult] = {}
    books = Bookkeeper(request, objective, log)
    folders = _Folders(request, runs, objective)

    def take(outcome: JobOutcome) -> None:
        run = by_name[outcome.name]
        if outcome.exit_code == 2 and run.one.is_baseline:
            raise UsageError(f"the baseline does not run: {outcome.message.removeprefix('slamcli: ')}")
        result = books.take(run, outcome)
        if not result.failure:
            find_figure(objective.key, result.figures)
        found[run.name] = result
        told(result, len(found), len(runs))
        folders.take(result)

    is_new = not request.output.exists()
    with log.stage("runs"):
        books.prepare(runs)
        jobs = [job_of(run, request, fixed) for run in runs]
        try:
            _run_jobs(request, jobs, told=take)
        except UsageError:
            if is_new and not found:  # nothing was done: nothing is left
                shutil.rmtree(request.output, ignore_errors=True)
            raise
    return [found[run.name] for run in runs]


def _run_jobs(
    request: SweepRequest,
    jobs: Sequence[Job],
    told: Callable[[JobOutcome], None] = lambda _: None,
    *,
    fresh: bool = False,
) -> None:
    run_jobs(
        jobs, workers=request.workers, records=request.output / "jobs", told=told, fresh=fresh, keep_stdout=False,
        scheduler=request.scheduler, memory_limit_bytes=request.memory_limit_bytes,
    )  # fmt: skip


class _Folders:
    """Removes the folders of runs as soon as their set cannot be the best any more, so that a long sweep stays small."""

    def __init__(self, request: SweepRequest, runs: Sequence[Run], objective: Objective) -> None:
        self._keep = request.keep
        self._objective = objective
        self._waiting = {run.one.name: request.num_seeds * len(request.subjects) for run in runs}
        self._done: dict[str, list[RunResult]] = {}
        self._best: tuple[float, str] | None = None

    def take(self, result: RunResult) -> None:
        """Note that a run is done, and remove what is not needed any more."""
        if self._keep == "all":
            return
        if self._keep == "none":
            shutil.rmtree(result.run.folder, ignore_errors=True)
            return
        name = result.run.one.name
        self._done.setdefault(name, []).append(result)
        if len(self._done[name]) == self._waiting[name]:
            self._compare(name)

    def _compare(self, name: str) -> None:
        values = [math.nan if r.failure else r.figures.get(self._objective.key, math.nan) for r in self._done[name]]
        whole = all(math.isfinite(value) for value in values)
        median = sorted(values)[len(values) // 2] if whole else math.nan
        if whole and (self._best is None or self._objective.better(median, self._best[0])):
            loser = self._best[1] if self._best is not None else ""
            self._best = (median, name)
        else:
            loser = name
        for result in self._done.get(loser, ()):
            shutil.rmtree(result.run.folder, ignore_errors=True)


def _keep(sweep: Sweep, fixed: Sequence[str]) -> None:
    """Leave the folders that are asked for: run the best set again where they went too early, and remove those of others."""
    request = sweep.request
    kept: set[Path] = set()
    if request.keep == "best":
        runs = [result.run for result in sweep.best.runs if not result.failure]
        missing = [run for run in runs if not (run.folder / "run.json").is_file()]
        _run_jobs(request, [job_of(run, request, fixed) for run in missing], fresh=True)
        kept = {run.folder for run in runs}
    if request.keep != "all":
        for file in sorted((request.output / "runs").rglob("*-s*.json")):
            folder = file.with_suffix("")
            if folder not in kept and (folder / "run.json").is_file():
                shutil.rmtree(folder, ignore_errors=True)


def _tell(sweep: Sweep, log: RunLog) -> None:
    """Say what a reader of the table must know."""
    failed = [result for result in sweep.results if result.failure]
    if failed:
        log.warn(
            f"{len(failed)} of {len(sweep.results)} runs failed; the first one ({failed[0].run.name}): {failed[0].failure}"
        )
    if sweep.request.num_seeds > 1 and all(_without_spread(one) for one in sweep.sets):
        log.note("the seed changes nothing here: one run of each set says as much (leave out --seeds)")
    if sweep.request.num_seeds == 1 and len(sweep.sets) > 1:
        log.note("one seed: whether a difference is more than chance cannot be said (--seeds 6 or more)")


def _without_spread(one: SetResult) -> bool:
    return all(s.count < 2 or s.minimum == s.maximum for s in one.per_recording.values()) and not one.spread.failed


__all__ = ["ParameterSet", "Sweep", "run_sweep"]
