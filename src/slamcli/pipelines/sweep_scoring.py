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
from slamcli.pipelines.compare_points import PointsRequest, RecordedPoints, read_points
from slamcli.pipelines.consistency import base_frame_of, consistency_of
from slamcli.pipelines.evaluate import evaluate_trajectory
from slamcli.pipelines.evaluate_map import evaluate_map
from slamcli.pipelines.evaluate_relations import evaluate_relations
from slamcli.pipelines.evaluation_request import Score, find_kind
from slamcli.recordings import Mends
from slamcli.runtime import RunLog


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """What a result scored."""

    figures: Mapping[str, float]
    failure: str = ""
    """Why it has no score; empty if it has one."""


class Eyes:
    """What the sensor of one recording saw; read when it is first needed, once for all results."""

    def __init__(self, request: PointsRequest) -> None:
        self._request = request
        self._points: dict[str, RecordedPoints | None] = {}

    def figures(self, folder: Path, log: RunLog) -> dict[str, float]:
        """Return the figures of a result and its recording alone (see `slamcli.pipelines.consistency`)."""
        base = base_frame_of(folder)
        if base not in self._points:
            with log.stage("points"):
                self._points[base] = read_points(self._request, [base], RunLog())
        with log.stage("consistency"):
            return consistency_of(folder, self._points[base]).figures()


def score_result(folder: Path, reference: str | None, mends: Mends, eyes: Eyes | None, log: RunLog) -> Measured:
    """Return every figure of a folder that ``slamcli map`` wrote.

    Those of its ``run.json``: ``summary.*``, ``time.total_s``, ``time.realtime_factor``, ``peak_memory_bytes``; and those of its
    evaluation, by the keys that ``slamcli evaluate`` gives them; with `eyes` also those that need no truth.
    """
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    figures = dict(_numbers(run["summary"], "summary"))
    timing = run["timing"]
    figures |= {
        f"time.{name}": float(timing[name]) for name in ("total_s", "realtime_factor") if timing[name] is not None
    }
    figures["peak_memory_bytes"] = float(run["peak_memory_bytes"])
    try:
        if eyes is not None:
            figures |= eyes.figures(folder, log)
        if reference is not None:
            figures |= {key: float(value) for key, value in _evaluated(folder, reference, mends).figures().items()}
    except SlamcliError as error:
        return Measured(figures=figures, failure=f"no score: {error}")
    return Measured(figures=figures)


def extent(figures: Mapping[str, float]) -> float:
    """Return how much of the recording a result covers, in a unit that is the same for all its results; NaN where none is known.

    Of a trajectory it is the number of poses that the truth has a partner for: one that gets lost has fewer.
    """
    for key in ("matched", "relations.matched", "map.coverage", "coverage"):
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
