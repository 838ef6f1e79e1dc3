# SPDX-License-Identifier: MIT
"""What every chart stands in: the range of its data on the drawing, axes with round ticks, a legend, and the ``<svg>`` around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import scales

LEFT, RIGHT, TOP, BOTTOM = 62, 14, 14, 40
"""Room for labels around the plot, in units of the drawing."""
ROW = 16
"""Height of a row of the legend."""


@dataclass(frozen=True, slots=True)
class Frame:
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
        """Return where values of the x axis lie on the drawing."""
        return self.left + (value - self.x_low) / (self.x_high - self.x_low) * (self.right - self.left)

    def y(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where values of the y axis lie on the drawing."""
        return self.bottom - (value - self.y_low) / (self.y_high - self.y_low) * (self.bottom - self.top)


def data_range(arrays: Sequence[NDArray[np.float64]], pad: float) -> tuple[float, float]:
    """Return the range of all finite values, widened by the share `pad` to both sides; never empty."""
    finite = [a[np.isfinite(a)] for a in arrays]
    values = np.concatenate(finite) if finite else np.zeros(0)
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    if not high - low > 1e-9 * max(abs(low), abs(high), 1e-12):
        half = 0.5 if low == 0 else 0.1 * abs(low)
        return low - half, high + half
    return low - pad * (high - low), high + pad * (high - low)


def axes(
    frame: Frame, x_label: str, y_label: str, *, equal: bool = False, log_y: bool = False, whole_y: bool = False
) -> str:
    """Return lines, ticks and labels of both axes.

    `equal` gives both the same step and lines to both (a plane); with `log_y` the frame's y values are decimal logarithms;
    `whole_y` has no ticks between whole numbers.
    """
    parts = []
    x_step = scales.tick_step(frame.x_high - frame.x_low, 8)
    for v, label in _log_ticks(frame) if log_y else _y_ticks(frame, x_step if equal else 0.0, least=float(whole_y)):
        y = float(frame.y(np.float64(v)))  # type: ignore[arg-type]
        parts.append(f'<path class="grid" d="M{frame.left} {y:.1f}H{frame.right}"/>')
        parts.append(f'<text class="tick" x="{frame.left - 6}" y="{y + 4:.1f}" text-anchor="end">{label}</text>')
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


def _log_ticks(frame: Frame) -> list[tuple[float, str]]:
    """Return decades, and 2 and 5 times them where there are few."""
    parts = (0.0,) if frame.y_high - frame.y_low > 2.5 else (0.0, math.log10(2.0), math.log10(5.0))
    first, last = math.floor(frame.y_low), math.ceil(frame.y_high)
    values = [decade + part for decade in range(first, last + 1) for part in parts]
    return [(v, scales.number(float(f"{10**v:.1g}"))) for v in values if frame.y_low <= v <= frame.y_high]


def _y_ticks(frame: Frame, step: float, least: float) -> list[tuple[float, str]]:
    """Return round numbers, `step` apart or, with 0, as far as fits and at least `least`."""
    count = max(2, (frame.bottom - frame.top) // 30)
    every = step or max(least, scales.tick_step(frame.y_high - frame.y_low, count))
    return [(v, scales.number(v)) for v in scales.multiples(frame.y_low, frame.y_high, every)]


def legend(entries: Sequence[tuple[str, str]], width: int = 720) -> str:
    """Return the legend above a drawing, in as many rows as it needs: labels and the classes of their lines."""
    return "".join(
        f'<path class="line {kind}" d="M{x} {14 + ROW * row}h16"/>'
        f'<text class="label" x="{x + 21}" y="{18 + ROW * row}">{escape(label)}</text>'
        for (label, kind), (x, row) in zip(entries, _places(entries, width), strict=True)
    )


def legend_height(entries: Sequence[tuple[str, str]], width: int = 720) -> int:
    """Return the room that a legend needs, in units of the drawing."""
    return ROW * (1 + _places(entries, width)[-1][1]) if entries else 0


def _places(entries: Sequence[tuple[str, str]], width: int) -> list[tuple[int, int]]:
    places, x, row = [], LEFT, 0
    for label, _ in entries:
        needed = 40 + round(8.6 * len(label))
        if x + needed > width and x > LEFT:
            x, row = LEFT, row + 1
        places.append((x, row))
        x += needed
    return places


def path(frame: Frame, x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    """Return the ``d`` of a line through points (N,), with gaps where they are not finite."""
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


def drawing(title: str, width: int, height: int, parts: Sequence[str]) -> str:
    """Return the ``<svg>`` element around `parts`; `title` is its name for who cannot see it."""
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}"><title>{escape(title)}</title>'
        f"{''.join(parts)}</svg>"
    )
