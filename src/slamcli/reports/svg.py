# SPDX-License-Identifier: MIT
"""Charts as inline SVG: a few kilobytes each, sharp at every size, light or dark with the page around them.

Colours are classes (``c0`` to ``c5``, ``axis``, ``grid``) that the page's style sheet fills. Long series are thinned to the smallest
and largest value of each of some hundred columns, so that no spike is lost.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import scales

_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 14, 14, 40
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
    x_low, x_high = _range([s.x for s in chart.series], pad=0.0)
    y_low, y_high = _range([s.y for s in chart.series], pad=0.12 if len(chart.marks_x) else 0.04)
    if chart.from_zero and y_low > -0.05 * (y_high - y_low):
        y_low = min(
            0.0, float(min((np.min(s.y, initial=0.0, where=np.isfinite(s.y)) for s in chart.series), default=0.0))
        )
    legend = [(s.label, f"c{s.colour}") for s in chart.series] if len(chart.series) > 1 or len(chart.marks_x) else []
    if len(chart.marks_x):
        legend.append((chart.marks_label, "mark"))
    top = _TOP + (16 if legend else 0)
    frame = _Frame(x_low, x_high, y_low, y_high, _LEFT, top, chart.width - _RIGHT, chart.height - _BOTTOM)
    parts = [_axes(frame, chart.x_label, chart.y_label), _legend(legend)]
    if len(chart.marks_x):
        parts.append(_marks(frame, chart.marks_x))
    parts += [f'<path class="line c{s.colour}" d="{_path(frame, *thin(s.x, s.y))}"/>' for s in chart.series]
    return _svg(chart.title, chart.width, chart.height, parts)


def plane_chart(title: str, lines: Sequence[tuple[str, NDArray[np.float64]]], width: int = 720) -> str:
    """Return an ``<svg>`` element with up to six paths (label, float64 (N, 2) metres) from above, both axes to the same scale."""
    points = np.concatenate([p for _, p in lines])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.ones(2))
    span = np.maximum(high - low, max(1e-3, 0.02 * float((high - low).max())))
    centre, span = (low + high) / 2, span * 1.06
    plot_width, top = width - _LEFT - _RIGHT, _TOP + 16
    scale = min(plot_width / span[0], 640 / span[1])
    plot_height = max(120.0, float(span[1] * scale))
    half = np.array([plot_width, plot_height]) / scale / 2
    frame = _Frame(
        float(centre[0] - half[0]), float(centre[0] + half[0]), float(centre[1] - half[1]), float(centre[1] + half[1]),
        _LEFT, top, width - _RIGHT, round(top + plot_height),
    )  # fmt: skip
    colours = [f"c{i}" for i in (2, 0, 1, 3, 4, 5)]  # the first line is the truth, green as in the map
    labels = [(name, colour) for (name, _), colour in zip(lines, colours, strict=False)]
    parts = [_axes(frame, "x in m", "y in m", equal=True), _legend(labels)]
    for (_, path), colour in zip(lines, colours, strict=False):
        parts.append(f'<path class="line {colour}" d="{_path(frame, *_thin_path(frame, path))}"/>')
    return _svg(title, width, frame.bottom + _BOTTOM, parts)


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


@dataclass(frozen=True, slots=True)
class _Frame:
    """Data range and where it lies on the drawing."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float
    left: int
    top: int
    right: int
    bottom: int

    def x(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.left + (value - self.x_low) / (self.x_high - self.x_low) * (self.right - self.left)

    def y(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.bottom - (value - self.y_low) / (self.y_high - self.y_low) * (self.bottom - self.top)


def _range(arrays: Sequence[NDArray[np.float64]], pad: float) -> tuple[float, float]:
    finite = [a[np.isfinite(a)] for a in arrays]
    values = np.concatenate(finite) if finite else np.zeros(0)
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    if not high - low > 1e-9 * max(abs(low), abs(high), 1e-12):
        half = 0.5 if low == 0 else 0.1 * abs(low)
        return low - half, high + half
    return low - pad * (high - low), high + pad * (high - low)


def _axes(frame: _Frame, x_label: str, y_label: str, *, equal: bool = False) -> str:
    parts = []
    count = 8
    y_count = max(2, (frame.bottom - frame.top) // 30)
    x_step = scales.tick_step(frame.x_high - frame.x_low, count)
    y_step = x_step if equal else scales.tick_step(frame.y_high - frame.y_low, y_count)
    for v in scales.multiples(frame.y_low, frame.y_high, y_step):
        y = float(frame.y(np.float64(v)))  # type: ignore[arg-type]
        parts.append(f'<path class="grid" d="M{frame.left} {y:.1f}H{frame.right}"/>')
        parts.append(
            f'<text class="tick" x="{frame.left - 6}" y="{y + 4:.1f}" text-anchor="end">{scales.number(v)}</text>'
        )
    for v in scales.multiples(frame.x_low, frame.x_high, x_step):
        x = float(frame.x(np.float64(v)))  # type: ignore[arg-type]
        if equal:
            parts.append(f'<path class="grid" d="M{x:.1f} {frame.top}V{frame.bottom}"/>')
        parts.append(f'<path class="axis" d="M{x:.1f} {frame.bottom}v4"/>')
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{frame.bottom + 16}" text-anchor="middle">{scales.number(v)}</text>'
        )
    parts.append(f'<path class="axis" d="M{frame.left} {frame.bottom}H{frame.right}"/>')
    middle_x, middle_y = (frame.left + frame.right) / 2, (frame.top + frame.bottom) / 2
    parts.append(
        f'<text class="label" x="{middle_x:.0f}" y="{frame.bottom + 33}" text-anchor="middle">{escape(x_label)}</text>'
    )
    parts.append(
        f'<text class="label" transform="translate(13 {middle_y:.0f}) rotate(-90)" text-anchor="middle">{escape(y_label)}</text>'
    )
    return "".join(parts)


def _legend(entries: Sequence[tuple[str, str]]) -> str:
    parts, x = [], _LEFT
    for label, kind in entries:
        parts.append(
            f'<path class="line {kind}" d="M{x} 14h16"/><text class="label" x="{x + 21}" y="18">{escape(label)}</text>'
        )
        x += 40 + round(8.6 * len(label))
    return "".join(parts)


def _marks(frame: _Frame, at: NDArray[np.float64]) -> str:
    x = np.unique(np.round(frame.x(at[np.isfinite(at)]), 0))
    return f'<path class="line mark" d="{"".join(f"M{v:.0f} {frame.top}v7" for v in x)}"/>'


def _thin_path(frame: _Frame, path: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points of a path that lie at least half a unit of the drawing apart, and gaps."""
    place = np.round(np.column_stack([frame.x(path[:, 0]), frame.y(path[:, 1])]) * 1.5)
    keep = np.ones(len(path), dtype=bool)
    keep[1:] = (place[1:] != place[:-1]).any(axis=1)
    return path[keep, 0], path[keep, 1]


def _path(frame: _Frame, x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    finite = np.isfinite(x) & np.isfinite(y)
    parts, pen = [], "M"
    for ok, px, py in zip(finite.tolist(), frame.x(x).tolist(), frame.y(y).tolist(), strict=True):
        if not ok:
            pen = "M"
            continue
        parts.append(f"{pen}{px:.1f} {py:.1f}")
        pen = "L"
    # A single point between two gaps is drawn as a dot by the round cap of a line without length.
    return "".join(parts) + ("h0" if parts else "")


def _svg(title: str, width: int, height: int, parts: Sequence[str]) -> str:
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}"><title>{escape(title)}</title>'
        f"{''.join(parts)}</svg>"
    )
