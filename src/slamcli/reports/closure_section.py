# SPDX-License-Identifier: MIT
"""The part of a report on a memory of places: hypotheses over time, closures that were tried, and why some were refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.posegraph.place_closure import PlaceClosure, without_figures
from slamcli.reports import page, scatter, svg
from slamcli.reports.node_axis import NodeAxis

_MOST_ROWS, _MOST_REASONS = 25, 25
_THRESHOLD = "Rtabmap/LoopThr"

_POSTERIOR_CAPTION = (
    "How sure the memory is, at each node, that it shows a place of working memory again. At and above the line the likeliest place is compared "
    "with the node (from RGBD/AggressiveLoopThr on while nothing ties their maps); ticks are nodes at which a closure was accepted. Low all over where the robot came back: images that look alike "
    "nowhere (blur, other light, other direction), or a memory that let the place go."
)
_PLACE_CAPTION = (
    "Which older node each node was tied to or held for. A line of dots that rises is a known way driven again, one that falls the way back. "
    "A single dot far from any line is doubtful; refused ones beside accepted ones are harmless."
)


def closure_sections(
    steps: Mapping[str, NDArray[Any]], closures: Sequence[PlaceClosure], run: Mapping[str, Any], axis: NodeAxis
) -> list[str]:
    """Return the section as markup, none without hypotheses.

    Parameters
    ----------
    steps
        With a row for each node: ``node``, ``hypothesis`` and ``posterior`` are among the columns (N,).
    closures
        All that were tried.
    """
    if "hypothesis" not in steps:
        return []
    sees = bool(np.any(steps.get("num_features", 0)))
    parts = [page.cards(_cards(closures, sees=sees))]
    if not any(one.accepted for one in closures):
        parts.append('<p class="soft">No place was known again: the map is as good as its odometry.</p>')
    parts += [_posterior(steps, closures, run, axis), _places(steps, closures, axis)]
    parts += [_kinds(closures), _reasons(closures), _refused(closures, axis)]
    return [page.section("Loop closures", *parts)]


def _cards(closures: Sequence[PlaceClosure], *, sees: bool) -> list[tuple[str, str, bool]]:
    accepted = Counter(one.kind for one in closures if one.accepted)
    refused = sum(not one.accepted for one in closures)
    words = {
        "loop": "loops closed by looks",
        "near in space": "ties to places near by",
        "near in time": "ties to the latest nodes",
    }
    found = [
        (f"{accepted.pop(kind, 0):,}", name, False)
        for kind, name in words.items()
        if accepted[kind] or (sees and kind == "loop")
    ]
    found += [(f"{count:,}", f"closures, {kind}", False) for kind, count in sorted(accepted.items()) if count]
    return [*found, (f"{refused:,}", "refused", False)]


def _posterior(
    steps: Mapping[str, NDArray[Any]], closures: Sequence[PlaceClosure], run: Mapping[str, Any], axis: NodeAxis
) -> str:
    y = np.asarray(steps["posterior"], dtype=np.float64)
    if not y.any():
        return ""
    series = [svg.Series(label="probability of the likeliest place", x=axis.x, y=y)]
    limit = (run.get("parameters") or {}).get(_THRESHOLD)
    if limit is not None:
        level = np.full(2, float(limit))
        series.append(svg.Series(label=f"{_THRESHOLD} {float(limit):g}", x=axis.x[[0, -1]], y=level, colour=1))
    closed = axis.of_nodes([one.node for one in closures if one.accepted and one.kind == "loop"])
    chart = svg.Chart(
        title="Loop hypotheses", x_label=axis.label, y_label="probability", series=series, marks_x=np.sort(closed),
        marks_label="loop closed",
    )  # fmt: skip
    return page.figure(svg.line_chart(chart), "Loop hypotheses", _POSTERIOR_CAPTION)


def _places(steps: Mapping[str, NDArray[Any]], closures: Sequence[PlaceClosure], axis: NodeAxis) -> str:
    node, likeliest = (np.asarray(steps[name], dtype=np.float64) for name in ("node", "hypothesis"))
    known = likeliest > 0
    points = [
        scatter.Points(label="node itself", x=axis.x, y=node, kind="faint"),
        scatter.Points(label="likeliest place", x=axis.x[known], y=likeliest[known], kind="c5"),
    ]
    for label, kind, chosen in (
        ("refused", "c3", [one for one in closures if not one.accepted]),
        ("near", "c4", [one for one in closures if one.accepted and one.kind != "loop"]),
        ("loop", "c2", [one for one in closures if one.accepted and one.kind == "loop"]),
    ):
        its = [one for one in chosen if one.older_node > 0]
        older = np.array([one.older_node for one in its], dtype=np.float64)
        points.append(scatter.Points(label=label, x=axis.of_nodes([one.node for one in its]), y=older, kind=kind))
    drawn = [kind for kind in points if len(kind.x)]
    if len(drawn) < 2:
        return ""
    chart = scatter.scatter_chart("which node was tied to which", axis.label, "older node", drawn)
    return page.figure(chart, "Which node was tied to which", _PLACE_CAPTION)


def _kinds(closures: Sequence[PlaceClosure]) -> str:
    counts = Counter((one.kind, one.accepted) for one in closures)
    rows = [(kind, counts[kind, True], counts[kind, False]) for kind in sorted({one.kind for one in closures})]
    table = page.table(["how it was found", "accepted", "refused"], rows, numeric=(1, 2))
    return page.figure(table, "What became of the closures") if table else ""


def _reasons(closures: Sequence[PlaceClosure]) -> str:
    counts = Counter((without_figures(one.reason), one.kind) for one in closures if not one.accepted)
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    rows = [(reason, kind, count) for (reason, kind), count in ordered[:_MOST_REASONS]]
    more = sum(count for _, count in ordered[_MOST_REASONS:])
    if more:
        rows.append(("other reasons", "", more))
    table = page.table(["why", "how it was found", "closures"], rows, numeric=(2,))
    return page.figure(table, "Why closures were refused") if table else ""


def _refused(closures: Sequence[PlaceClosure], axis: NodeAxis) -> str:
    """Return the table of those that came nearest to being accepted: judged by the graph, likeliest, most inliers."""
    refused = [one for one in closures if not one.accepted]
    nearest = sorted(refused, key=lambda one: (-one.strain, -one.posterior, -one.num_inliers, one.node, one.older_node))
    rows = [
        (
            axis.named(one.node), axis.named(one.older_node), one.kind, f"{one.posterior:.2f}" if one.posterior else "",
            f"{one.num_inliers:,} of {one.num_matches:,}" if one.num_inliers else "", one.reason,
        )
        for one in nearest[:_MOST_ROWS]
    ]  # fmt: skip
    columns = ["node", "held for", "how it was found", "probability", "inliers of matches", "why not"]
    table = page.table(columns, rows, numeric=(3, 4), wordy=True)
    left = len(refused) - len(rows)
    told = f"{left:,} more stand in closures.csv." if left > 0 else ""
    return (
        page.figure(table, "Refused closures", "Those that came nearest to being accepted first. " + told)
        if table
        else ""
    )
