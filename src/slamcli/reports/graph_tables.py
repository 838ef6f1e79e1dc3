# SPDX-License-Identifier: MIT
"""Tables and headline figures of a pose graph: the worst loop closures, and why searches were rejected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slamcli.posegraph import LoopSearch
from slamcli.posegraph.place_closure import without_figures
from slamcli.reports import page, scales
from slamcli.reports.graph_arrays import GraphArrays

_WORST = 20


def graph_cards(
    graph: GraphArrays, searches: Sequence[LoopSearch], summary: Mapping[str, Any]
) -> list[tuple[str, str, bool]]:
    """Return the headline figures of a graph: value, what it is, whether it is a warning."""
    loops = int(graph.inter.sum())
    facts = [
        (f"{len(graph.submap_names):,}", "submaps", False),
        (f"{len(graph.stamps_ns):,}", "nodes", False),
        (f"{len(graph.inter) - loops:,}", "constraints within submaps", False),
        (f"{loops:,}", "loop constraints", False),
    ]
    if searches:
        accepted, trials = int(graph.accepted.sum()), num_trials(searches, summary)
        facts.append((f"{trials:,}", "loop searches", False))
        facts.append((f"{accepted:,} ({100 * accepted / trials:.0f}\N{NO-BREAK SPACE}%)", "accepted", False))
    known = graph.residuals_m[graph.inter & np.isfinite(graph.residuals_m)]
    if len(known):
        facts.append((f"{np.median(known) * 100:.1f} cm", "median residual of loop constraints", False))
    before, after = summary.get("optimisation_cost_before"), summary.get("optimisation_cost_after")
    if isinstance(before, (int, float)) and isinstance(after, (int, float)):
        share = 100 * (after / before - 1) if before > 0 else 0.0
        change = (
            f" ({share:+.{0 if abs(share) >= 1 else 1}f}\N{NO-BREAK SPACE}%)".replace("-", "−")
            if abs(share) >= 0.05
            else ""
        )
        facts.append((f"{after:.3g}{change}", "cost after the last optimisation", False))
    return facts


def num_trials(searches: Sequence[LoopSearch], summary: Mapping[str, Any]) -> int:
    """Return how many pairs were searched: a run may only tell of those that came to something, and count the others."""
    counted = summary.get("loop_trials")
    return max(len(searches), counted) if isinstance(counted, int) else len(searches)


def worst_closures(graph: GraphArrays) -> str:
    """Return the table of the loop constraints that the optimised poses are farthest from."""
    loops = np.flatnonzero(graph.inter & (graph.constraint_nodes >= 0) & (graph.constraint_submaps >= 0))
    if not len(loops):
        return ""
    scores = {
        (node, submap): score
        for node, submap, score, ok in zip(
            graph.search_nodes.tolist(), graph.search_submaps.tolist(), graph.scores.tolist(), graph.accepted.tolist(),
            strict=True,
        )
        if ok
    }  # fmt: skip
    badness = np.maximum(graph.residuals_m[loops] / 0.1, np.degrees(graph.residuals_rad[loops]))
    several = len(np.unique(graph.trajectories)) > 1
    rows = []
    for c in loops[np.lexsort((loops, -np.nan_to_num(badness)))][:_WORST].tolist():
        node, submap = int(graph.constraint_nodes[c]), int(graph.constraint_submaps[c])
        x, y = (np.round(graph.positions_m[node, :2], 1) + 0.0).tolist()  # no "-0.0"
        score = scores.get((node, submap))
        when = f"{graph.trajectories[node]}: " if several else ""
        rows.append((
            f"{when}{graph.elapsed_s[node]:.1f} s", f"{x:.1f}, {y:.1f}", graph.submap_names[submap],
            _between(graph, node, submap), "" if score is None else f"{score:.3f}",
            f"{graph.residuals_m[c]:.3f} m", f"{np.degrees(graph.residuals_rad[c]):.2f}°",
        ))  # fmt: skip
    columns = ["node at", "place in m", "submap", "time between", "score", "translation residual", "rotation residual"]
    return page.table(columns, rows, numeric=range(3, 7))


def _between(graph: GraphArrays, node: int, submap: int) -> str:
    """Return the time between building the submap and the node; nothing across trajectories, whose clocks may differ."""
    middle = int(graph.middles[submap])
    if middle < 0 or graph.trajectories[middle] != graph.trajectories[node]:
        return ""
    return scales.duration(abs(float(graph.elapsed_s[node] - graph.elapsed_s[middle])))


def rejections(searches: Sequence[LoopSearch], trials: int) -> str:
    """Return the table of what became of the searches: reasons, how often, and the scores among them."""
    by_reason: dict[str, list[float]] = {}
    for search in searches:
        if not search.accepted:
            by_reason.setdefault(without_figures(search.reason) or "rejected", []).append(search.score)
    groups = [("accepted", [s.score for s in searches if s.accepted])]
    groups += sorted(by_reason.items(), key=lambda item: (-len(item[1]), item[0]))
    groups.append(("found nothing", [0.0] * (trials - len(searches))))
    rows = [
        (what, f"{len(scores):,}", f"{100 * len(scores) / trials:.1f} %", *_spread(scores))
        for what, scores in groups
        if scores
    ]
    columns = ["what became of it", "searches", "share", "median score", "best score"]
    return page.table(columns, rows, numeric=range(1, 5))


def rounds(searches: Sequence[LoopSearch]) -> str:
    """Return the table of rounds of searching; nothing if there was one."""
    numbers = sorted({search.round for search in searches})
    if len(numbers) < 2:
        return ""
    rows = []
    for number in numbers:
        its = [search for search in searches if search.round == number]
        rows.append((number, len(its), sum(search.accepted for search in its)))
    return page.table(["round", "searches", "accepted"], rows, numeric=(0, 1, 2))


def _spread(scores: Sequence[float]) -> tuple[str, str]:
    found = [s for s in scores if s > 0]
    return (f"{np.median(found):.3f}", f"{max(found):.3f}") if found else ("", "")
