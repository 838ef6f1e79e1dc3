# SPDX-License-Identifier: MIT
"""Charts of single values as inline SVG: points over time, and how often values occur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.reports.chart_frame import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    Frame,
    axes,
    data_range,
    drawing,
    legend,
    legend_height,
)

_WIDTH, _HEIGHT = 720, 220


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Points:
    """One kind of points of a scatter chart; those that are not finite are left out."""

    label: str
    x: NDArray[np.float64]
    """float64 (N,)."""
    y: NDArray[np.float64]
    """float64 (N,)."""
    kind: str = "c0"
    """Class of the colour: ``c0`` to ``c5``, ``r0`` to ``r3``, or ``faint``."""


def scatter_chart(
    title: str, x_label: str, y_label: str, points: Sequence[Points], *, lowest: float | None = None
) -> str:
    """Return an ``<svg>`` element of points, later kinds over earlier ones.

    With `lowest` (positive) the y axis is logarithmic, and values below are drawn there, so that exact zeros are seen.
    """
    ys = [p.y if lowest is None else np.log10(np.maximum(p.y, lowest)) for p in points]
    x_low, x_high = data_range([p.x for p in points], pad=0.01)
    y_low, y_high = data_range(ys, pad=0.06)
    entries = [(p.label, f"dots {p.kind}") for p in points]
    room = legend_height(entries)
    frame = Frame(x_low, x_high, y_low, y_high, LEFT, TOP + room, _WIDTH - RIGHT, _HEIGHT + room - BOTTOM)
    parts = [axes(frame, x_label, y_label, log_y=lowest is not None), legend(entries)]
    parts += [
        f'<path class="dots {p.kind}" d="{_dots(frame.x(p.x), frame.y(y))}"/>' for p, y in zip(points, ys, strict=True)
    ]
    return drawing(title, _WIDTH, _HEIGHT + room, parts)


def histogram(
    title: str,
    x_label: str,
    groups: Sequence[tuple[str, NDArray[np.float64]]],
    *,
    limit: tuple[str, float] | None = None,
    bins: int = 50,
) -> str:
    """Return an ``<svg>`` element of how often values occur, up to two groups (label, float64 (N,)) stacked.

    `limit` is a label and a value at which a dashed line stands.
    """
    values = [g[np.isfinite(g)] for _, g in groups]
    x_low, x_high = data_range([*values, np.array([] if limit is None else [limit[1]])], pad=0.03)
    edges = np.linspace(x_low, x_high, bins + 1)
    counts = np.array([np.histogram(v, edges)[0] for v in values])
    frame = Frame(
        x_low, x_high, 0.0, max(1.0, 1.05 * float(counts.sum(axis=0).max())),
        LEFT, TOP + 16, _WIDTH - RIGHT, _HEIGHT - BOTTOM,
    )  # fmt: skip
    entries = [(label, f"c{i}") for i, (label, _) in enumerate(groups)]
    parts = [axes(frame, x_label, "how many", whole_y=True)]
    x, below = frame.x(edges), np.zeros(bins)
    for i, count in enumerate(counts):
        foot, head = frame.y(below), frame.y(below + count)
        bars = "".join(
            f"M{x[k] + 0.4:.1f} {foot[k]:.1f}V{head[k]:.1f}H{x[k + 1] - 0.4:.1f}V{foot[k]:.1f}Z"
            for k in np.flatnonzero(count)
        )
        parts.append(f'<path class="bar{i}" d="{bars}"/>')
        below += count
    if limit is not None:
        entries.append((limit[0], "limit"))
        parts.append(f'<path class="limit" d="M{frame.x(np.array([limit[1]]))[0]:.1f} {frame.top}V{frame.bottom}"/>')
    return drawing(title, _WIDTH, _HEIGHT, [*parts, legend(entries)])


def _dots(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    """Return the ``d`` of dots; of those that would lie over each other one is drawn."""
    finite = np.isfinite(x) & np.isfinite(y)
    at = np.unique(np.round(np.column_stack([x[finite], y[finite]]) * 2) / 2, axis=0)
    return "".join(f"M{px:g} {py:g}h0" for px, py in at)
