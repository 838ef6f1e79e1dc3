# SPDX-License-Identifier: MIT
"""The figures of one result: of its summary, its time and memory, and against what is true."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import SlamcliError
from slamcli.pipelines.evaluate import evaluate_trajectory
from slamcli.pipelines.evaluate_map import evaluate_map
from slamcli.pipelines.evaluate_relations import evaluate_relations
from slamcli.pipelines.evaluation_request import Score, find_kind
from slamcli.pipelines.sweep_request import Subject
from slamcli.recordings import Mends
from slamcli.runtime import RunLog


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """What a result scored."""

    figures: Mapping[str, float]
    failure: str = ""
    """Why it has no score; empty if it has one."""


def score_result(folder: Path, subject: Subject, mends: Mends) -> Measured:
    """Return every figure of a folder that ``slamcli map`` wrote.

    Those of its ``run.json``: ``summary.*``, ``time.total_s``, ``time.realtime_factor``, ``peak_memory_bytes``; and those of its
    evaluation, by the keys that ``slamcli evaluate`` gives them.
    """
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    figures = dict(_numbers(run["summary"], "summary"))
    timing = run["timing"]
    figures |= {
        f"time.{name}": float(timing[name]) for name in ("total_s", "realtime_factor") if timing[name] is not None
    }
    figures["peak_memory_bytes"] = float(run["peak_memory_bytes"])
    if subject.reference is None:
        return Measured(figures=figures)
    try:
        score = _evaluated(folder, subject.reference, mends)
    except SlamcliError as error:
        return Measured(figures=figures, failure=f"no score: {error}")
    return Measured(figures={**figures, **{key: float(value) for key, value in score.figures().items()}})


def coverage(figures: Mapping[str, float]) -> float:
    """Return how much of the recording a result covers, as far as its figures say it; NaN where none does."""
    for key in ("coverage.poses", "relations.coverage", "map.coverage"):
        if key in figures:
            return figures[key]
    return math.nan


def _evaluated(folder: Path, reference: str, mends: Mends) -> Score:
    kind, trajectory = find_kind(reference), folder / "trajectory.tum"
    quiet = RunLog()  # what is remarked of one run is not what is to be known of a sweep
    if kind == "relations":
        return evaluate_relations(trajectory, reference, mends=mends, log=quiet)
    if kind == "map":
        return evaluate_map(folder / "map.yaml", reference, log=quiet)
    return evaluate_trajectory(trajectory, reference, mends=mends, log=quiet)


def _numbers(values: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, float]]:
    for name, value in values.items():
        key = f"{prefix}.{name}"
        if isinstance(value, Mapping):
            yield from _numbers(value, key)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            yield key, float(value)
