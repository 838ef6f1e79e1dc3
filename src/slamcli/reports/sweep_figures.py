# SPDX-License-Identifier: MIT
"""The pictures of a sweep: one per parameter, one of a pair, and time against the objective."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from slamcli.reports.sweep_views import (
    CostView,
    PairView,
    ParameterView,
    baseline_median,
    cost_view,
    digits,
    objective_label,
    pair_view,
    parameter_views,
    thinned,
    value_label,
)

_DPI = 120
_BLUE, _ORANGE, _GREY, _GREEN = "#0072b2", "#d55e00", "0.55", "#009e73"


def sweep_figures(document: Mapping[str, Any]) -> dict[str, bytes]:
    """Return PNGs by file name: one per parameter, ``pairs.png`` of a sweep over two, ``time.png``."""
    pictures = {}
    for view in parameter_views(document):
        pictures[f"{file_stem(view.name)}.png"] = _parameter_picture(view, document)
    pair = pair_view(document)
    if pair is not None:
        pictures["pairs.png"] = _pair_picture(pair, document)
    cost = cost_view(document)
    if cost is not None:
        pictures["time.png"] = _cost_picture(cost, document)
    return pictures


def file_stem(name: str) -> str:
    """Return the name of a parameter as that of a file."""
    return "parameter-" + re.sub(r"[^\w.-]+", "-", name)


def _parameter_picture(view: ParameterView, document: Mapping[str, Any]) -> bytes:
    figure = Figure(figsize=(7.5, 4.5), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    shown = np.isfinite(view.best[:, 1])
    axes.plot(view.run_at, view.run_values, ".", color=_GREY, alpha=0.6, markersize=5, label="runs", zorder=2)
    at, best = view.at[shown], view.best[shown]
    label = "median, quartiles" if view.alone else "best set with the value: median, quartiles"
    spread = np.abs(best[:, [0, 2]] - best[:, 1:2]).T
    axes.errorbar(
        at, best[:, 1], yerr=spread, fmt="o-" if view.numeric else "o", color=_BLUE, capsize=4, markersize=5, linewidth=1.6,
        label=label, zorder=3,
    )  # fmt: skip
    if not view.alone:
        axes.plot(
            view.at,
            view.marginal,
            "s--",
            color=_ORANGE,
            markersize=4,
            linewidth=1,
            label="median over all sets with the value",
            zorder=2.5,
        )
    base = baseline_median(document)
    if np.isfinite(base):
        axes.axhline(base, color="0.3", linestyle=":", linewidth=1.2, label="baseline")
    _mark_failed(axes, view)
    _value_axis(axes, view)
    axes.set_ylabel(objective_label(document))
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")
    return _png(figure)


def _mark_failed(axes: Axes, view: ParameterView) -> None:
    for at, count in zip(view.at, view.failed, strict=True):
        if count:
            axes.text(
                at, 0.99, f"{count} failed", color=_ORANGE, rotation=90, fontsize="small", ha="center", va="top",
                transform=axes.get_xaxis_transform(),
            )  # fmt: skip


def _value_axis(axes: Axes, view: ParameterView) -> None:
    """Label the values themselves where they have room."""
    span = float(np.ptp(view.at)) or 1.0
    axes.set_xlim(float(view.at.min()) - 0.06 * span, float(view.at.max()) + 0.06 * span)
    kept = thinned(view.at.tolist(), span / 14)
    axes.set_xticks(view.at[kept], [value_label(view.values[i]) for i in kept])
    if any(len(value_label(view.values[i])) > 8 for i in kept):
        axes.tick_params(axis="x", labelrotation=25)
    axes.set_xlabel(view.label + (" (logarithmic)" if view.log else ""))


def _pair_picture(pair: PairView, document: Mapping[str, Any]) -> bytes:
    rows, columns = pair.cells.shape
    figure = Figure(figsize=(min(12, 3 + 0.9 * columns), min(10, 2 + 0.6 * rows)), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    low_is_best = document["objective"]["best"] == "smallest"
    image = axes.imshow(pair.cells, origin="lower", aspect="auto", cmap="viridis_r" if low_is_best else "viridis")
    figure.colorbar(image, ax=axes, label=objective_label(document))
    axes.set_xticks(range(columns), [value_label(v) for v in pair.first.values], rotation=25 if columns > 8 else 0)
    axes.set_yticks(range(rows), [value_label(v) for v in pair.second.values])
    axes.set_xlabel(pair.first.label)
    axes.set_ylabel(pair.second.label)
    for row, column in np.ndindex(rows, columns):
        value = float(pair.cells[row, column])
        if np.isfinite(value):
            red, green, blue, _ = image.to_rgba(np.array(value))
            dark = 0.3 * red + 0.59 * green + 0.11 * blue < 0.55
            axes.text(
                column,
                row,
                digits(value),
                ha="center",
                va="center",
                fontsize="small",
                color="white" if dark else "black",
            )
    return _png(figure)


def _cost_picture(cost: CostView, document: Mapping[str, Any]) -> bytes:
    figure = Figure(figsize=(7.5, 4.5), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.plot(cost.times_s, cost.values, "o", color=_BLUE, markersize=6, label="sets (medians)")
    front = list(cost.front)
    axes.plot(
        cost.times_s[front], cost.values[front], "o-", color=_GREEN, linewidth=1.5, label="no set is faster and better", zorder=3,
    )  # fmt: skip
    if cost.baseline >= 0:
        axes.plot(
            cost.times_s[cost.baseline], cost.values[cost.baseline], "s", color=_ORANGE, markersize=9, fillstyle="none",
            label="baseline",
        )  # fmt: skip
    middle = (float(np.min(cost.times_s)) + float(np.max(cost.times_s))) / 2
    away = -11 if document["objective"]["best"] == "smallest" else 5  # from the line, which comes from the left
    for i in front[:8]:
        left = cost.times_s[i] > middle  # into the picture, not out of it
        axes.annotate(
            cost.labels[i][:60], (cost.times_s[i], cost.values[i]), textcoords="offset points", xytext=(-6, away) if left else (6, 5),
            ha="right" if left else "left", fontsize="x-small",
        )  # fmt: skip
    axes.margins(x=0.12, y=0.12)
    axes.set_xlabel("time of a run in s (median)")
    axes.set_ylabel(objective_label(document))
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")
    return _png(figure)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    FigureCanvasAgg(figure).print_png(stream)  # type: ignore[no-untyped-call, unused-ignore]
    return stream.getvalue()
