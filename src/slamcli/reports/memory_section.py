# SPDX-License-Identifier: MIT
"""The part of a report on how large a memory of places was, and how long its updates took."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import page, svg
from slamcli.reports.node_axis import NodeAxis

_CHARTS: tuple[tuple[str, str, tuple[tuple[str, str], ...], str], ...] = (
    (
        "Memory", "nodes", (("short_term", "short-term"), ("working", "working"), ("long_term", "long-term")),
        ("Nodes in short-term memory (the latest, not compared with), in working memory (compared with), and in long-term memory: in the database alone, "
        "where they are found again only through a neighbour. Updates cost the more the larger working memory is; a limit (Rtabmap/MemoryThr, Rtabmap/TimeThr) keeps it flat."),
    ),
    (
        "Transfer and retrieval", "nodes", (("transferred", "to long-term memory"), ("retrieved", "back to working memory")),
        "At each update. Nodes go where a limit is reached, those of little weight first, and come back with their neighbours.",
    ),
    ("Dictionary", "words", (("words", "words"),), "It grows where new things are seen; a flat stretch is a known place."),
    (
        "Key points of each node", "key points", (("num_features", "key points"),),
        "Few are a blank wall, blur or darkness: nothing can be known again there.",
    ),
    (
        "Inliers of closed loops", "inliers", (("loop_inliers", "inliers"),),
        "Matches that agree with the motion between both nodes, at nodes that closed a loop; 0 elsewhere.",
    ),
    (
        "Likeness to the node before", "0 to 1", (("similarity", "likeness"),),
        "Share of words in common (rehearsal): high where the robot stands or moves little.",
    ),
    (
        "Nodes moved by the optimisation", "nodes", (("optimised", "nodes"),),
        "At updates with new closures.",
    ),
)  # fmt: skip


def memory_sections(steps: Mapping[str, NDArray[Any]], run: Mapping[str, Any], axis: NodeAxis) -> list[str]:
    """Return the section as markup, none without columns of a memory; what is zero all along is left out."""
    if "working" not in steps or not len(axis.x):
        return []
    parts = [_chart(title, unit, names, told, steps, axis) for title, unit, names, told in _CHARTS]
    return [page.section("Memory over time", *parts, _update_time(run, axis))]


def _chart(
    title: str,
    unit: str,
    names: tuple[tuple[str, str], ...],
    told: str,
    steps: Mapping[str, NDArray[Any]],
    axis: NodeAxis,
) -> str:
    series = [
        svg.Series(label=label, x=axis.x, y=np.asarray(steps[name], dtype=np.float64), colour=i)
        for i, (name, label) in enumerate(names)
        if name in steps
    ]
    series = series if any(np.any(one.y) for one in series) else []
    return _drawn(title, unit, series, told, axis) if series else ""


def _update_time(run: Mapping[str, Any], axis: NodeAxis) -> str:
    laps = ((run.get("timing") or {}).get("laps_s") or {}).get("update") or ()
    if len(laps) != len(axis.x):
        return ""
    y = np.array(laps, dtype=np.float64) * 1e3
    told = f"Everything that a node costs beside odometry: median {np.median(y):.1f} ms, 95 % below {np.quantile(y, 0.95):.1f} ms, largest {y.max():.1f} ms."
    return _drawn("Time of each update", "ms", [svg.Series(label="update", x=axis.x, y=y)], told, axis)


def _drawn(title: str, unit: str, series: list[svg.Series], told: str, axis: NodeAxis) -> str:
    chart = svg.Chart(title=title, x_label=axis.label, y_label=unit, series=series)
    return page.figure(svg.line_chart(chart), title, told)
