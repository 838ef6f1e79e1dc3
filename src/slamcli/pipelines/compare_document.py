# SPDX-License-Identifier: MIT
"""``compare.json``: every result with its figures, ranks and the sentence on where it failed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from slamcli import __version__
from slamcli.evaluation import compare_story
from slamcli.evaluation.compare_story import Finding
from slamcli.evaluation.figure_catalogue import ALL, BY_KEY
from slamcli.pipelines.compare_request import CompareRequest
from slamcli.pipelines.compare_results import Compared
from slamcli.pipelines.compare_scores import Laid, Scores
from slamcli.pipelines.consistency import Consistency
from slamcli.pipelines.schemas import stamped
from slamcli.runtime import RunLog

TIMED = frozenset({"realtime_factor", "cpu_s", "peak_memory_mb"})
"""Figures that differ from run to run of the same bytes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """One result with all that was measured of it."""

    compared: Compared
    scores: Scores
    consistency: Consistency
    figures: Mapping[str, float]
    """By the keys of `slamcli.evaluation.figure_catalogue` and of ``slamcli evaluate``."""
    findings: Sequence[Finding]
    laid: Laid | None
    """In the common frame; None without a result."""

    @property
    def sentence(self) -> str:
        """Where it failed."""
        if self.compared.there:
            return compare_story.sentence(list(self.findings))
        return f"{self.compared.state}: {self.compared.message}" if self.compared.message else self.compared.state


def ordered(figures: Mapping[str, float]) -> dict[str, float]:
    """Return the figures in the order of the catalogue, others behind them."""
    order = {figure.key: i for i, figure in enumerate(ALL)}
    names = sorted(figures, key=lambda key: (order.get(key, len(order)), key))
    return {name: float(figures[name]) for name in names if math.isfinite(figures[name])}


def ranks(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Return for each figure with a better side the rank of each result that has it: 1 is best, equal figures share one; none where all are equal."""
    found: dict[str, dict[str, int]] = {}
    for figure in ALL:
        values = {row.compared.name: row.figures[figure.key] for row in rows if figure.key in row.figures}
        if figure.better == "neither" or len(set(values.values())) < 2:
            continue
        sign = 1.0 if figure.better == "lower" else -1.0
        found[figure.key] = {
            name: 1 + sum(sign * other < sign * value for other in values.values()) for name, value in values.items()
        }
    return found


def comparison_document(
    request: CompareRequest,
    rows: Sequence[Row],
    pairs: Mapping[str, Any],
    sources: Mapping[str, str],
    inputs: Sequence[Mapping[str, Any]],
    log: RunLog,
) -> dict[str, Any]:
    """Return ``compare.json``: what is timed stands under ``timing`` alone."""
    ranked = ranks(rows)
    entrants = []
    for row in rows:
        found = row.compared
        entrants.append(
            {
                "name": found.name,
                "algo": found.entrant.algo or found.run.get("algo", ""),
                "state": found.state,
                "message": found.message,
                "sentence": row.sentence,
                "findings": [
                    {
                        "kind": f.kind,
                        "at_s": round(f.at_s, 3),
                        "text": f.text,
                        "at_m": None if f.at_m is None else list(f.at_m),
                    }
                    for f in row.findings
                ],
                "folder": found.name if found.entrant.result is None else str(found.entrant.result),
                "set": list(found.entrant.sets),
                "config": [str(path) for path in found.entrant.config_files],
                "mode": found.entrant.mode,
                "figures": {key: value for key, value in row.figures.items() if key not in TIMED},
                "ranks": {key: of[found.name] for key, of in ranked.items() if found.name in of and key not in TIMED},
                "notes": list(row.scores.notes),
                "timing": {
                    **{key: value for key, value in row.figures.items() if key in TIMED},
                    "wall_s": None if found.outcome is None else found.outcome.wall_s,
                },
            }
        )
    shown = {key for row in rows for key in row.figures}
    scales = next((row.consistency.scales for row in rows if row.consistency.scales is not None), None)
    document = {
        "slamcli": __version__,
        "inputs": list(inputs),
        "references": dict(sources),
        "seed": request.seed,
        "start_s": request.start_s,
        "duration_s": request.duration_s,
        "results": entrants,
        "agreement": {pair: dict(values) for pair, values in pairs.items()},
        "best": {
            key: [name for name, rank in of.items() if rank == 1] for key, of in ranked.items() if key not in TIMED
        },
        "figures": {
            key: {"label": f.label, "unit": f.unit, "better": f.better, "about": f.about}
            for key, f in BY_KEY.items() if key in shown
        },
        "scales": None if scales is None else {
            "radius_m": scales.radius_m, "visit_gap_s": scales.visit_gap_s, "cell_m": scales.cell_m,
        },
        "workers": request.workers,
        "warnings": list(log.warnings),
        "notes": list(log.notes),
    }  # fmt: skip
    return stamped("compare", document)
