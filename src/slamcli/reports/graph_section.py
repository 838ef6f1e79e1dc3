# SPDX-License-Identifier: MIT
"""The part of a report that tells of a pose graph: where loops were closed, how well, and where they were not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.posegraph import LoopSearch, MapState
from slamcli.reports import page, scatter, step_charts, svg
from slamcli.reports.figures.submaps import thumbnails
from slamcli.reports.graph_arrays import GraphArrays, graph_arrays
from slamcli.reports.graph_map import RESIDUAL_CLASSES, graph_map, residual_classes
from slamcli.reports.graph_tables import graph_cards, num_trials, rejections, rounds, worst_closures
from slamcli.reports.submap_matrix import matrix_chart, untied
from slamcli.trajectory import Trajectory

_MIN_SCORE = "constraint_builder.min_score"


def graph_sections(
    state: MapState | None,
    searches: Sequence[LoopSearch],
    run: Mapping[str, Any],
    grid: OccupancyGrid | None,
    trajectory: Trajectory | None,
) -> list[str]:
    """Return the sections of a state as markup, none without one.

    Charts over time show the nodes that were made during `trajectory`: those of a loaded state are of another day.
    """
    graph = graph_arrays(state, searches) if state is not None else None
    if state is None or graph is None or graph.is_empty:
        return []
    run_nodes, began_ns = nodes_in_run(graph, trajectory)
    return [
        page.section(
            "Pose graph",
            page.cards(graph_cards(graph, searches, run.get("summary") or {})),
            page.figure(graph_map(graph, grid), caption=_MAP_CAPTION),
            _correction(graph, run_nodes, began_ns),
        ),
        page.section("Loop closures", *_closures(graph, searches, run, run_nodes, began_ns)),
        page.section("Submaps", _thumbnails(state, graph)),
    ]


_MAP_CAPTION = (
    "Switches above show and hide what is drawn. A loop constraint runs from the node to where the robot was in the middle of building "
    "the submap; its colour is the residual, what the optimised poses still disagree with the match by. Few constraints that are worse than their "
    "neighbours are wrong matches; many along one stretch are drift that the loop could not spread. Directions in which a match "
    "is blind, as along a corridor, are left out of it where the run knows them. Where the map is double and no line leads, a loop was not found: look at the rejected searches."
)


_REASONS = (
    "score: the best match is worse than min_score; ambiguous: it holds the scan in no direction; no second match agrees: a find in a wide "
    "window that stands alone; contradicts: the optimised graph pulls it apart."
)


def nodes_in_run(graph: GraphArrays, trajectory: Trajectory | None) -> tuple[NDArray[np.int64], int]:
    """Return the nodes (K,) that were made in the run, and when it began; all nodes where no trajectory tells.

    They are those of the newest trajectory in its time: a loaded state may be of the same recording.
    """
    order = np.argsort(graph.stamps_ns, kind="stable")
    if trajectory is None or not len(trajectory):
        return order, int(graph.stamps_ns.min(initial=np.iinfo(np.int64).max))
    first, last = int(trajectory.stamps_ns.min()), int(trajectory.stamps_ns.max())
    inside = order[(graph.stamps_ns[order] >= first) & (graph.stamps_ns[order] <= last)]
    own = graph.trajectories[inside] == graph.trajectories[inside].max(initial=-1)
    return inside[own], int(trajectory.stamps_ns[0])


def _correction(graph: GraphArrays, nodes: NDArray[np.int64], began_ns: int) -> str:
    """Return the chart of how far the optimisation moved each node against local SLAM."""
    if not len(nodes):
        return ""
    x, x_label = step_charts.time_axis(graph.stamps_ns[nodes], began_ns)
    moved = np.linalg.norm(graph.positions_m - graph.local_positions_m, axis=1)[nodes]
    turned = np.degrees(graph.correction_rad[nodes])
    unit, factor = ("m", 1.0) if float(moved.max()) > 0.05 else ("mm", 1e3)
    charts = [
        svg.line_chart(
            svg.Chart(title=title, x_label=x_label, y_label=label, series=[svg.Series(label=title, x=x, y=y, colour=c)])
        )
        for title, label, y, c in (
            ("moved", f"moved by {unit}", moved * factor, 0),
            ("turned", "turned by °", turned, 1),
        )
    ]
    told = (
        "How far the optimised poses are from those of local SLAM alone, laid on the map at the first node: the drift that the graph took out. "
        f"It grows slowly; a step is a place where local SLAM slipped or a loop was closed wrongly. At the end {moved[-1]:.2f} m and {turned[-1]:.1f}°."
    )
    return page.figure("".join(charts), "Correction by the graph", told)


def _closures(
    graph: GraphArrays,
    searches: Sequence[LoopSearch],
    run: Mapping[str, Any],
    nodes: NDArray[np.int64],
    began_ns: int,
) -> list[str]:
    parts = []
    if not graph.inter.any():
        parts.append('<p class="soft">No loop was closed: the map is as good as local SLAM.</p>')
    parts += _residuals(graph, nodes, began_ns)
    if searches:
        least = _least_score(run)
        found = graph.scores > 0
        groups = [
            ("accepted", graph.scores[graph.accepted & found]),
            ("rejected", graph.scores[~graph.accepted & found]),
        ]
        trials = num_trials(searches, run.get("summary") or {})
        nothing = trials - int(np.count_nonzero(found))
        told = f"{nothing:,} more searches found nothing above their bound." if nothing else ""
        parts.append(
            page.figure(
                scatter.histogram("scores of loop searches", "score", groups, limit=least),
                "Scores of loop searches",
                told,
            )
        )
        parts.append(page.figure(rejections(searches, trials), "What became of the searches", _REASONS))
        parts.append(page.figure(rounds(searches), "Rounds of searching") if rounds(searches) else "")
    worst = worst_closures(graph)
    parts.append(
        page.figure(worst, "Worst loop constraints", "By residual, 10 cm counting as much as 1°.") if worst else ""
    )
    if len(graph.submap_names) > 1:
        open_pairs = untied(graph)
        pairs = int(np.count_nonzero(open_pairs)) // 2
        told = (
            f"Number of loop constraints between submaps. {pairs:,} pairs of submaps were built within 5 m of each other, not one after the other, and "
            "are not tied by a loop constraint (squares): harmless with a wall between them, else where a double wall comes from."
        )
        parts.append(page.figure(matrix_chart(graph, open_pairs), "Which submaps are tied", told))
    return parts


def _residuals(graph: GraphArrays, nodes: NDArray[np.int64], began_ns: int) -> list[str]:
    in_run = np.isin(graph.constraint_nodes, nodes)
    use = np.isfinite(graph.residuals_m) & in_run
    if not use.any():
        return []
    elapsed = (graph.stamps_ns[graph.constraint_nodes] - began_ns) / 1e9
    long = float(elapsed[use].max()) > 600
    x, x_label = (elapsed / 60, "time in min") if long else (elapsed, "time in s")
    classes = residual_classes(np.nan_to_num(graph.residuals_m), np.nan_to_num(graph.residuals_rad))
    charts = []
    for title, y, unit, lowest in (
        ("translation", graph.residuals_m, "m", 1e-4),
        ("rotation", np.degrees(graph.residuals_rad), "°", 1e-3),
    ):
        points = [
            scatter.Points(label="within a submap", x=x[use & ~graph.inter], y=y[use & ~graph.inter], kind="faint")
        ]
        for i, (_, _, words) in enumerate(RESIDUAL_CLASSES):
            its = use & graph.inter & (classes == i)
            if its.any():
                points.append(scatter.Points(label=words, x=x[its], y=y[its], kind=f"r{i}"))
        charts.append(
            scatter.scatter_chart(
                f"{title} residuals of constraints", x_label, f"{title} in {unit}", points, lowest=lowest
            )
        )
    told = (
        "What the optimised poses differ by from each constraint, at the time of its node. Loop constraints have the colours of the map above; grey are "
        "those of nodes within their own submap: where these rise, the optimisation bends submaps, because of a wrong loop or a slip."
    )
    return [page.figure("".join(charts), "Residuals of constraints", told)]


def _told(content: str, title: str, caption: str = "") -> str:
    return page.figure(content, title, caption) if content else ""


def _least_score(run: Mapping[str, Any]) -> tuple[str, float] | None:
    parameters = run.get("parameters") or {}
    value = next((v for k, v in parameters.items() if str(k).endswith(_MIN_SCORE)), None)
    return None if value is None else (f"min_score {float(value):g}", float(value))


def _thumbnails(state: MapState, graph: GraphArrays) -> str:
    when = [f", {graph.elapsed_s[middle]:.0f} s" if middle >= 0 else "" for middle in graph.middles.tolist()]
    words = [
        f"{name}: {submap.num_range_data} scans{at}{'' if submap.finished else ', not finished'}"
        for name, submap, at in zip(graph.submap_names, state.submaps, when, strict=True)
    ]
    pictures, shown = thumbnails(state.submaps, words)
    left_out = f" {shown:,} of {len(words):,} are shown." if pictures and shown < len(words) else ""
    told = "Each as local SLAM built it, in the direction of its own frame: a blurred or double one is a fault of local SLAM, not of loop closure."
    return page.figure(pictures, caption=told + left_out) if pictures else ""
