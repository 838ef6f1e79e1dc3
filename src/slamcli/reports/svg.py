# SPDX-License-Identifier: MIT
"""Charts as inline SVG: a few kilobytes each, sharp at every size, light or dark with the page around them.

Colours are classes (``c0`` to ``c5``, ``axis``, ``grid``) that the page's style sheet fills. Long series are thinned to the smallest
and largest value of each of some hundred columns, so that no spike is lost.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.reports.chart_frame import (
    BOTTOM,
    LEFT,
    RIGHT,
    ROW,
    TOP,
    Frame,
    axes,
    data_range,
    drawing,
    legend,
    legend_height,
    path,
)

_COLUMNS = 600


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """One line of a chart."""

    label: str
    x: NDArray[np.float64]
    """float64 (N,), not decreasing."""
    y: NDArray[np.float64]
    """float64 (N,); the line has a gap where a value is not finite."""
    colour: int = 0
    """Which of the page's six colours."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chart:
    """What :func:`line_chart` draws."""

    title: str
    """Name of the chart for who cannot see it."""
    x_label: str
    y_label: str
    series: Sequence[Series]
    marks_x: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """float64 (M,), events drawn as short ticks at the top."""
    marks_label: str = ""
    from_zero: bool = True
    """Whether the y axis reaches down to 0 if all values are positive."""
    width: int = 720
    height: int = 220


def line_chart(chart: Chart) -> str:
    """Return an ``<svg>`` element with axes, round ticks, units and, for several series, a legend."""
    x_low, x_high = data_range([s.x for s in chart.series], pad=0.0)
    y_low, y_high = data_range([s.y for s in chart.series], pad=0.12 if len(chart.marks_x) else 0.04)
    if chart.from_zero and y_low > -0.05 * (y_high - y_low):
        y_low = min(
            0.0, float(min((np.min(s.y, initial=0.0, where=np.isfinite(s.y)) for s in chart.series), default=0.0))
        )
    entries = [(s.label, f"c{s.colour}") for s in chart.series] if len(chart.series) > 1 or len(chart.marks_x) else []
    if len(chart.marks_x):
        entries.append((chart.marks_label, "mark"))
    room = legend_height(entries, chart.width)
    height = chart.height + max(0, room - ROW)  # the chart itself keeps its size where the legend needs more rows
    frame = Frame(x_low, x_high, y_low, y_high, LEFT, TOP + room, chart.width - RIGHT, height - BOTTOM)
    parts = [axes(frame, chart.x_label, chart.y_label), legend(entries, chart.width)]
    if len(chart.marks_x):
        parts.append(_marks(frame, chart.marks_x))
    parts += [f'<path class="line c{s.colour}" d="{path(frame, *thin(s.x, s.y))}"/>' for s in chart.series]
    return drawing(chart.title, chart.width, height, parts)


def plane_chart(title: str, lines: Sequence[tuple[str, NDArray[np.float64]]], width: int = 720) -> str:
    """Return an ``<svg>`` element with up to six paths (label, float64 (N, 2) metres) from above, both axes to the same scale."""
    points = np.concatenate([p for _, p in lines])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.ones(2))
    span = np.maximum(high - low, max(1e-3, 0.02 * float((high - low).max())))
    centre, span = (low + high) / 2, span * 1.06
    plot_width, top = width - LEFT - RIGHT, TOP + 16
    scale = min(plot_width / span[0], 640 / span[1])
    plot_height = max(120.0, float(span[1] * scale))
    half = np.array([plot_width, plot_height]) / scale / 2
    frame = Frame(
        float(centre[0] - half[0]), float(centre[0] + half[0]), float(centre[1] - half[1]), float(centre[1] + half[1]),
        LEFT, top, width - RIGHT, round(top + plot_height),
    )  # fmt: skip
    colours = [f"c{i}" for i in (2, 0, 1, 3, 4, 5)]  # the first line is the truth, green as in the map
    labels = [(name, colour) for (name, _), colour in zip(lines, colours, strict=False)]
    parts = [axes(frame, "x in m", "y in m", equal=True), legend(labels)]
    for (_, line), colour in zip(lines, colours, strict=False):
        parts.append(f'<path class="line {colour}" d="{path(frame, *_thin_path(frame, line))}"/>')
    return drawing(title, width, frame.bottom + BOTTOM, parts)


def thin(
    x: NDArray[np.float64], y: NDArray[np.float64], columns: int = _COLUMNS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return at most ``2 * columns`` of the points: the lowest and the highest of each column, in their order."""
    if len(x) <= 2 * columns:
        return x, y
    edges = np.linspace(0, len(x), columns + 1).astype(np.int64)
    keep = []
    for first, last in itertools.pairwise(edges):
        part = y[first:last]
        finite = np.isfinite(part)
        if not finite.any():
            keep.append(first)
            continue
        low, high = np.where(finite, part, np.inf).argmin(), np.where(finite, part, -np.inf).argmax()
        keep += sorted({int(first + low), int(first + high)})
    chosen = np.array(keep, dtype=np.int64)
    return x[chosen], y[chosen]


def _marks(frame: Frame, at: NDArray[np.float64]) -> str:
    x = np.unique(np.round(frame.x(at[np.isfinite(at)]), 0))
    return f'<path class="line mark" d="{"".join(f"M{v:.0f} {frame.top}v7" for v in x)}"/>'


def _thin_path(frame: Frame, path: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points of a path that lie at least half a unit of the drawing apart, and gaps."""
    place = np.round(np.column_stack([frame.x(path[:, 0]), frame.y(path[:, 1])]) * 1.5)
    keep = np.ones(len(path), dtype=bool)
    keep[1:] = (place[1:] != place[:-1]).any(axis=1)
    return path[keep, 0], path[keep, 1]
