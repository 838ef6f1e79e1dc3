# SPDX-License-Identifier: MIT
"""The plots of a sweep as inline SVG, in the colours of the page."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from slamcli.reports import scales
from slamcli.reports.chart_frame import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    Frame,
    data_range,
    drawing,
    legend,
    legend_height,
    path,
)
from slamcli.reports.sweep_views import (
    CostView,
    PairView,
    ParameterView,
    baseline_median,
    digits,
    objective_label,
    thinned,
    value_label,
)

_WIDTH, _HEIGHT = 720, 300
_CELL = 34
_CHARACTER = 7.0
"""Width of a letter of a tick, about, in units of the drawing."""


def parameter_chart(view: ParameterView, document: Mapping[str, Any]) -> str:
    """Return the objective over the values of one parameter."""
    base = baseline_median(document)
    shown = np.isfinite(view.best[:, 1])
    y_low, y_high = data_range([view.run_values, view.best[shown].ravel(), np.array([base])], pad=0.08)
    x_low, x_high = data_range([view.at], pad=0.06)
    entries = [("runs", "dots faint"), ("median and quartiles" if view.alone else "best set with the value", "c0")]
    if not view.alone:
        entries.append(("median over all sets with it", "c1"))
    if np.isfinite(base):
        entries.append(("baseline", "limit"))
    room = legend_height(entries, _WIDTH)
    frame = Frame(
        x_low, x_high, y_low, y_high, _left(y_low, y_high), TOP + room, _WIDTH - RIGHT, _HEIGHT + room - BOTTOM
    )
    parts = [_y_axis(frame, document), _value_ticks(frame, view), legend(entries, _WIDTH)]
    if np.isfinite(base):
        parts.append(f'<path class="limit" d="M{frame.left} {float(frame.y(np.array(base))):.1f}H{frame.right}"/>')
    run_x, run_y = frame.x(view.run_at), frame.y(view.run_values)
    dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in zip(run_x, run_y, strict=True))
    parts.append(f'<path class="dots faint" style="stroke-width:4;stroke-opacity:.7" d="{dots}"/>')
    if not view.alone:
        if view.numeric:
            parts.append(f'<path class="line c1" stroke-dasharray="5 4" d="{path(frame, view.at, view.marginal)}"/>')
        parts.append(f'<path class="dots c1" style="stroke-width:5" d="{_dots(frame, view.at, view.marginal)}"/>')
    parts.append(_spreads(frame, view))
    return drawing(f"{document['objective']['key']} over {view.name}", _WIDTH, _HEIGHT + room, parts)


def _spreads(frame: Frame, view: ParameterView) -> str:
    """Return medians with bars from quartile to quartile."""
    parts = [f'<path class="line c0" d="{path(frame, view.at, view.best[:, 1])}"/>'] if view.numeric else []
    x, quartiles = frame.x(view.at), frame.y(view.best)
    bars = "".join(
        f"M{px:.1f} {low:.1f}V{high:.1f}M{px - 5:.1f} {low:.1f}h10M{px - 5:.1f} {high:.1f}h10"
        for px, (low, _, high) in zip(x, quartiles, strict=True)
        if np.isfinite(low) and low != high
    )
    parts.append(f'<path class="line c0" d="{bars}"/>')
    parts.append(f'<path class="dots c0" style="stroke-width:7" d="{_dots(frame, view.at, view.best[:, 1])}"/>')
    for px, count in zip(x, view.failed, strict=True):
        if count:
            parts.append(
                f'<text class="tick" x="{px:.1f}" y="{frame.top + 10}" text-anchor="middle">{count} failed</text>'
            )
    return "".join(parts)


def pair_chart(pair: PairView, document: Mapping[str, Any]) -> str:
    """Return a table of colours: the median objective of each pair of values."""
    rows, columns = pair.cells.shape
    left = 30 + round(_CHARACTER * max(len(value_label(value)) for value in pair.second.values))
    left = max(left, LEFT)
    width = (_WIDTH - left - RIGHT) / columns
    height = rows * _CELL
    finite = pair.cells[np.isfinite(pair.cells)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    smallest = document["objective"]["best"] == "smallest"
    parts = []
    for row, column in np.ndindex(rows, columns):
        x, y = left + column * width, TOP + (rows - 1 - row) * _CELL
        value = float(pair.cells[row, column])
        if not np.isfinite(value):
            parts.append(f'<path class="open" d="M{x + 1:.1f} {y + 1}h{width - 2:.1f}v{_CELL - 2}h-{width - 2:.1f}z"/>')
            continue
        share = (value - low) / (high - low) if high > low else 0.5
        good = 1.0 - share if smallest else share
        parts.append(
            f'<path fill="var(--c0)" fill-opacity="{0.08 + 0.82 * good:.2f}" d="M{x + 1:.1f} {y + 1}h{width - 2:.1f}v{_CELL - 2}h-{width - 2:.1f}z"/>'
            f'<text class="label" style="fill:{"#fff" if good > 0.62 else "var(--ink)"}" x="{x + width / 2:.1f}" y="{y + _CELL / 2 + 4:.1f}" text-anchor="middle">{digits(value)}</text>'
        )
    for column in thinned([left + column * width for column in range(columns)], 40.0):
        text = escape(value_label(pair.first.values[column]))
        parts.append(
            f'<text class="tick" x="{left + (column + 0.5) * width:.1f}" y="{TOP + height + 16}" text-anchor="middle">{text}</text>'
        )
    for row in range(rows):
        text = escape(value_label(pair.second.values[row]))
        y = TOP + (rows - 1 - row) * _CELL + _CELL / 2 + 4
        parts.append(f'<text class="tick" x="{left - 6}" y="{y:.1f}" text-anchor="end">{text}</text>')
    middle = (left + _WIDTH - RIGHT) / 2
    parts.append(
        f'<text class="label" x="{middle:.0f}" y="{TOP + height + 34}" text-anchor="middle">{escape(pair.first.label)}</text>'
    )
    parts.append(
        f'<text class="label" transform="translate(13 {TOP + height / 2:.0f}) rotate(-90)" text-anchor="middle">{escape(pair.second.label)}</text>'
    )
    return drawing(f"{objective_label(document)} over two parameters", _WIDTH, TOP + height + BOTTOM, parts)


def cost_chart(cost: CostView, document: Mapping[str, Any]) -> str:
    """Return the time of a run against the objective, one point per set, with a line through those that none beats in both."""
    y_low, y_high = data_range([cost.values], pad=0.1)
    x_low, x_high = data_range([cost.times_s], pad=0.06)
    entries = [("sets", "dots c0"), ("no set is faster and better", "c2")]
    if cost.baseline >= 0:
        entries.append(("baseline", "dots c1"))
    room = legend_height(entries, _WIDTH)
    frame = Frame(
        x_low, x_high, y_low, y_high, _left(y_low, y_high), TOP + room, _WIDTH - RIGHT, _HEIGHT + room - BOTTOM
    )
    front = list(cost.front)
    parts = [_y_axis(frame, document), legend(entries, _WIDTH)]
    for value in scales.ticks(x_low, x_high, 8):
        x = float(frame.x(np.array(value)))
        parts.append(f'<path class="axis" d="M{x:.1f} {frame.bottom}v4"/>')
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{frame.bottom + 16}" text-anchor="middle">{scales.number(value)}</text>'
        )
    middle = (frame.left + frame.right) / 2
    parts.append(
        f'<text class="label" x="{middle:.0f}" y="{frame.bottom + 33}" text-anchor="middle">time of a run in s (median)</text>'
    )
    if cost.baseline >= 0:  # a ring around its point
        at = [cost.baseline]
        parts.append(
            f'<path class="dots c1" style="stroke-width:13" d="{_dots(frame, cost.times_s[at], cost.values[at])}"/>'
        )
    parts.append(f'<path class="line c2" d="{path(frame, cost.times_s[front], cost.values[front])}"/>')
    parts.append(f'<path class="dots c0" style="stroke-width:7" d="{_dots(frame, cost.times_s, cost.values)}"/>')
    parts.append(
        f'<path class="dots c2" style="stroke-width:7" d="{_dots(frame, cost.times_s[front], cost.values[front])}"/>'
    )
    return drawing("time against the objective", _WIDTH, _HEIGHT + room, parts)


def _left(low: float, high: float) -> int:
    """Return the room for the labels of the objective's axis."""
    longest = max((len(scales.number(value)) for value in scales.ticks(low, high, 8)), default=0)
    return max(LEFT, 36 + round(_CHARACTER * longest))


def _y_axis(frame: Frame, document: Mapping[str, Any]) -> str:
    """Return lines and ticks of the objective, and the line below; the ticks along it stand at the values."""
    parts = [f'<path class="axis" d="M{frame.left} {frame.bottom}H{frame.right}"/>']
    for value in scales.ticks(frame.y_low, frame.y_high, 8):
        y = float(frame.y(np.array(value)))
        parts.append(f'<path class="grid" d="M{frame.left} {y:.1f}H{frame.right}"/>')
        parts.append(
            f'<text class="tick" x="{frame.left - 6}" y="{y + 4:.1f}" text-anchor="end">{scales.number(value)}</text>'
        )
    middle = (frame.top + frame.bottom) / 2
    label = escape(objective_label(document))
    parts.append(
        f'<text class="label" transform="translate(13 {middle:.0f}) rotate(-90)" text-anchor="middle">{label}</text>'
    )
    return "".join(parts)


def _value_ticks(frame: Frame, view: ParameterView) -> str:
    labels = [value_label(value) for value in view.values]
    places = frame.x(view.at).tolist()
    least = _CHARACTER * max(len(label) for label in labels) + 8
    parts = [f'<path class="axis" d="M{x:.1f} {frame.bottom}v4"/>' for x in places]
    parts += [
        f'<text class="tick" x="{places[i]:.1f}" y="{frame.bottom + 16}" text-anchor="middle">{escape(labels[i])}</text>'
        for i in thinned(places, least)
    ]
    middle = (frame.left + frame.right) / 2
    name = escape(view.label + (" (logarithmic)" if view.log else ""))
    parts.append(f'<text class="label" x="{middle:.0f}" y="{frame.bottom + 33}" text-anchor="middle">{name}</text>')
    return "".join(parts)


def _dots(frame: Frame, at: Any, values: Any) -> str:
    return "".join(f"M{x:.1f} {y:.1f}h0" for x, y in zip(frame.x(at), frame.y(values), strict=True) if np.isfinite(y))
