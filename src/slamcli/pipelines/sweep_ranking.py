# SPDX-License-Identifier: MIT
"""From runs to ranks: what each set amounts to over seeds and recordings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from slamcli.pipelines.sweep_objective import Objective
from slamcli.pipelines.sweep_request import Subject
from slamcli.pipelines.sweep_runs import RunResult
from slamcli.pipelines.sweep_scoring import extent
from slamcli.pipelines.sweep_sets import ParameterSet
from slamcli.pipelines.sweep_statistics import Comparison, Spread, compare, mean_ranks


@dataclass(frozen=True, slots=True, kw_only=True)
class SetResult:
    """What one set amounts to."""

    one: ParameterSet
    runs: tuple[RunResult, ...]
    """Of all recordings and seeds, in that order."""
    values: tuple[float, ...]
    """The objective of each run, NaN where it failed; of several recordings as a multiple of the baseline's median there."""
    spread: Spread
    per_recording: Mapping[str, Spread]
    """The objective itself, by the recording's name."""
    against_baseline: Comparison
    mean_rank: float
    """Over recordings; of one recording its rank by the median."""
    rank: int = 0
    """1 is best; sets in which a run failed come after all others."""


def without_lost(results: Sequence[RunResult], least: float) -> list[RunResult]:
    """Return the results, those that cover much less than the best of their recording as failed.

    A run that loses its way early has small errors on the little that it covers, and must not win by that.
    """
    widest: dict[str, float] = {}
    for result in results:
        seen = extent(result.figures)
        if not result.failure and math.isfinite(seen):
            name = result.run.subject.name
            widest[name] = max(widest.get(name, 0.0), seen)
    return [_judged(result, widest.get(result.run.subject.name, 0.0), least) for result in results]


def _judged(result: RunResult, widest: float, least: float) -> RunResult:
    seen = extent(result.figures)
    if result.failure or not math.isfinite(seen) or widest <= 0:
        return result
    covered = seen / widest
    failure = "" if covered >= least else f"covers only {100 * covered:.3g} % of what the best run covers"
    return dataclasses.replace(result, failure=failure, covered=covered)


def rank_sets(
    sets: Sequence[ParameterSet], results: Sequence[RunResult], subjects: Sequence[Subject], objective: Objective
) -> list[SetResult]:
    """Return all sets, the best first.

    Parameters
    ----------
    sets
        What was tried, the baseline first.
    results
        Of every set, recording and seed, in this order.
    subjects
        The recordings.
    objective
        What sets are ranked by: its median over seeds; of several recordings the mean rank over them, and for equal ones the
        median of the multiples of the baseline.
    """
    count = len(results) // len(sets)
    rows = [results[i * count : (i + 1) * count] for i in range(len(sets))]
    raw = [[_value(result, objective) for result in row] for row in rows]
    seeds = count // len(subjects)
    units = [_unit(raw[0], i, seeds) if len(subjects) > 1 else 1.0 for i in range(len(subjects)) for _ in range(seeds)]
    columns = [[Spread.of(values[i * seeds : (i + 1) * seeds]).median for values in raw] for i in range(len(subjects))]
    ranks = mean_ranks(columns, maximise=objective.maximise)
    scaled = [tuple(float(v / unit) for v, unit in zip(values, units, strict=True)) for values in raw]
    found = [
        SetResult(
            one=one, runs=tuple(row), values=values, spread=Spread.of(values),
            per_recording={s.name: Spread.of(own[i * seeds : (i + 1) * seeds]) for i, s in enumerate(subjects)},
            against_baseline=compare(values, scaled[0], maximise=objective.maximise), mean_rank=rank,
        )
        for one, row, values, own, rank in zip(sets, rows, scaled, raw, ranks, strict=True)
    ]  # fmt: skip
    ordered = sorted(found, key=lambda each: _order(each, objective, single=len(subjects) == 1))
    return [dataclasses.replace(each, rank=i) for i, each in enumerate(ordered, start=1)]


def _order(each: SetResult, objective: Objective, *, single: bool) -> tuple[bool, float, float, float, bool]:
    """Return what sets are sorted by; the sort is stable, so that equal ones keep their order, the baseline first."""
    median = each.spread.median
    cost = math.inf if not math.isfinite(median) else -median if objective.maximise else median
    spread = each.spread
    return (spread.failed > 0, spread.failure_rate, 0.0 if single else each.mean_rank, cost, not each.one.is_baseline)


def _value(result: RunResult, objective: Objective) -> float:
    return math.nan if result.failure else result.figures.get(objective.key, math.nan)


def _unit(baseline: Sequence[float], index: int, seeds: int) -> float:
    """Return what the objective of a recording is a multiple of: the size of the baseline's median there."""
    median = abs(Spread.of(baseline[index * seeds : (index + 1) * seeds]).median)
    return median if median > 0 else math.nan
