# SPDX-License-Identifier: MIT
"""What a sweep found as one document: ``sweep.json``, from which table, plots and report are made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from slamcli import __version__
from slamcli.parameters import as_dict
from slamcli.pipelines.run_record import describe_inputs
from slamcli.pipelines.schemas import stamped
from slamcli.pipelines.sweep import Sweep
from slamcli.pipelines.sweep_axes import Axis
from slamcli.pipelines.sweep_ranking import SetResult
from slamcli.pipelines.sweep_request import Subject
from slamcli.pipelines.sweep_runs import RunResult
from slamcli.pipelines.sweep_statistics import Spread
from slamcli.runtime import RunLog, peak_memory_bytes

_ENOUGH_PAIRS = 6


def sweep_document(sweep: Sweep, best: Mapping[str, Any], outputs: Sequence[str], log: RunLog) -> dict[str, Any]:
    """Return the document; what stands under ``timing`` and ``peak_memory_bytes`` may differ from run to run, nothing else.

    Parameters
    ----------
    sweep
        What was found.
    best
        Where the best set's file and run are.
    outputs
        Names of the files beside the document.
    log
        Of the sweep.
    """
    request = sweep.request
    document = {
        "slamcli": __version__,
        "command": request.command,
        "algo": request.algo,
        "search": "grid" if request.draws is None else "random",
        "seeds": list(request.seeds),
        "objective": {
            "key": sweep.objective.key, "best": sweep.objective.direction, "relative": len(request.subjects) > 1,
        },
        "recordings": [_recording(subject) for subject in request.subjects],
        "config_files": [str(file) for file in request.config_files],
        "fixed": dict(sweep.fixed),
        "parameters": [_parameter(axis, sweep) for axis in sweep.axes],
        "verdict": verdict(sweep),
        "best": dict(best),
        "sets": [_set(one) for one in sweep.sets],
        "runs": [_run(result, sweep) for result in sweep.results],
        "warnings": list(log.warnings),
        "notes": list(log.notes),
        "outputs": sorted(outputs),
        "timing": {
            "stages_s": {name: round(seconds, 3) for name, seconds in log.seconds.items()},
            "workers": request.workers,
            "jobs": request.jobs,
        },
        "peak_memory_bytes": peak_memory_bytes(),
    }  # fmt: skip
    finite: dict[str, Any] = _finite(stamped("sweep", document))
    return finite


def verdict(sweep: Sweep) -> str:
    """Return in one sentence what came out, and whether it is more than chance."""
    best, key = sweep.best, sweep.objective.key
    base = next(one for one in sweep.sets if one.one.is_baseline)
    unit = " x the baseline's" if len(sweep.request.subjects) > 1 else ""
    if best.one.is_baseline:
        return f"nothing that was tried is better than the baseline ({key} {_short(best.spread.median)}{unit})"
    head = f"best is {best.one.label}: {key} {_short(best.spread.median)}{unit}"
    if not base.spread.count:
        return f"{head}; the baseline failed in every run"
    head += "" if unit else f", the baseline {_short(base.spread.median)}"
    if base.spread.failed > best.spread.failed:
        head += f"; the baseline failed in {base.spread.failed} of {base.spread.failed + base.spread.count} runs"
    return f"{head}; {_weight(best)}"


def _weight(best: SetResult) -> str:
    against = best.against_baseline
    seen = f"better in {against.better_in} of {against.pairs} pairs"
    if against.verdict == "one run":
        return "one run each: whether that is more than chance needs several seeds"
    if against.verdict in ("better", "worse"):
        return (
            f"{seen}: more than chance (sign test p = {against.p_value:.2g})"
            if against.p_value
            else f"{seen}, and seeds change nothing"
        )
    if against.verdict == "likely better":
        more = f"; {_ENOUGH_PAIRS} pairs or more can show it" if against.pairs < _ENOUGH_PAIRS else ""
        return f"{seen}: likely more than chance{more}"
    return (
        f"{seen}: within the spread (95 % interval of the difference {_short(against.low)} to {_short(against.high)})"
    )


def _short(value: float) -> str:
    return f"{value:.4g}"


def _recording(subject: Subject) -> dict[str, Any]:
    return {
        "name": subject.name or subject.inputs[0].name,
        "inputs": describe_inputs(subject.inputs),
        "reference": subject.reference,
    }


def _parameter(axis: Axis, sweep: Sweep) -> dict[str, Any]:
    drawn = {} if axis.values else {"low": axis.low, "high": axis.high, "whole": axis.whole}
    return {
        "name": axis.name,
        "unit": axis.declaration.unit,
        "help": axis.declaration.help,
        "numeric": axis.numeric,
        "log": axis.log,
        "baseline": as_dict(sweep.baseline.parameters)[axis.name],
        "values": list(axis.values),
        **drawn,
    }


def _set(one: SetResult) -> dict[str, Any]:
    good = [result for result in one.runs if not result.failure]
    return {
        "rank": one.rank,
        "id": one.one.name,
        "baseline": one.one.is_baseline,
        "label": one.one.label,
        "values": dict(one.one.values),
        "changes": dict(one.one.changes),
        **_spread(one.spread),
        "mean_rank": one.mean_rank,
        "recordings": {name or "": _spread(spread) for name, spread in one.per_recording.items()},
        "against_baseline": asdict(one.against_baseline),
        "coverage": _median([result.covered for result in one.runs]),
        "timing": {
            "total_s": _median([result.figures["time.total_s"] for result in good]),
            "realtime_factor": _median([result.figures.get("time.realtime_factor", math.nan) for result in good]),
            "cpu_s": _median([result.cpu_s for result in good]),
        },
        "peak_memory_bytes": max((result.peak_memory_bytes for result in good), default=0),
    }


def _spread(spread: Spread) -> dict[str, Any]:
    return {**asdict(spread), "failure_rate": spread.failure_rate}


def _run(result: RunResult, sweep: Sweep) -> dict[str, Any]:
    run, figures = result.run, result.figures
    own = {key: value for key, value in figures.items() if not key.startswith("time.") and key != "peak_memory_bytes"}
    timed = {key.removeprefix("time."): value for key, value in figures.items() if key.startswith("time.")}
    return {
        "id": run.name,
        "set": run.one.name,
        "recording": run.subject.name or run.subject.inputs[0].name,
        "seed": run.seed,
        "values": dict(run.one.values),
        "objective": math.nan if result.failure else figures.get(sweep.objective.key, math.nan),
        "failure": result.failure,
        "exit_code": result.exit_code,
        "figures": own,
        "timing": timed,
        "peak_memory_bytes": result.peak_memory_bytes,
    }


def _median(values: Sequence[float]) -> float:
    found = np.array([value for value in values if math.isfinite(value)])
    return float(np.median(found)) if len(found) else math.nan


def _finite(value: Any) -> Any:
    """Return a document without numbers that JSON does not have."""
    if isinstance(value, Mapping):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
