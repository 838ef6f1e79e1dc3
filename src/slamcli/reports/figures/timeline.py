# SPDX-License-Identifier: MIT
"""The picture of a recording's topics over time: where each has messages, and where it is silent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import scales
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.raster import Pixels

BINS = 800
"""Number of columns that the recording's time is divided into, one pixel each."""
_SIZE = 14
_ROW = 26
_MOST_ROWS = 60
_MOST_LABEL = 48
_FEWEST_FOR_RATE = 0.25
"""Messages per column below which single messages are drawn instead of their rate."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """One topic."""

    name: str
    counts: NDArray[np.int64]
    """int64 (BINS,), messages in each column."""
    fact: str
    """Shown on the right."""


def timeline_image(rows: Sequence[Row], duration_s: float, title: str = "") -> Pixels:
    """Return the picture uint8 (H, W, 3): one row per topic, dark where it has its usual rate, white where it is silent.

    Topics with much fewer messages than the picture has columns are drawn as single strokes on a pale band that stops
    where the pause is much longer than usual.
    """
    shown = list(rows[:_MOST_ROWS])
    names = [_short(row.name) for row in shown]
    left = 2 * _SIZE + max([raster.text_width(n, _SIZE) for n in names] or [0])
    right = 2 * _SIZE + max([raster.text_width(r.fact, _SIZE) for r in shown] or [0])
    top = round(2.4 * _SIZE) if title else _SIZE
    rest = len(rows) - len(shown)
    height = top + len(shown) * _ROW + 3 * _SIZE + (_ROW if rest else 0)
    page = np.full((height, left + BINS + right, 3), 255, dtype=np.uint8)
    raster.text(page, (_SIZE, 0.5 * _SIZE), title, 16, plane.INK)
    bottom = top + len(shown) * _ROW
    _draw_axis(page, left, top, bottom, duration_s)
    for i, (row, name) in enumerate(zip(shown, names, strict=True)):
        y = top + i * _ROW
        raster.text(page, (left - 0.6 * _SIZE, y + _ROW / 2), name, _SIZE, plane.INK, "rm")
        page[y + 5 : y + _ROW - 5, left : left + BINS] = _shades(row.counts)
        raster.text(page, (left + BINS + 0.8 * _SIZE, y + _ROW / 2), row.fact, _SIZE, plane.INK, "lm")
    if rest:
        raster.text(page, (left, bottom + 2.5 * _SIZE), f"and {rest} more topics", _SIZE, plane.FAINT)
    return page


def stacked(above: Pixels, below: Pixels) -> Pixels:
    """Return two pictures one above the other on white."""
    width = max(above.shape[1], below.shape[1])
    page = np.full((above.shape[0] + below.shape[0], width, 3), 255, dtype=np.uint8)
    page[: above.shape[0], : above.shape[1]] = above
    page[above.shape[0] :, : below.shape[1]] = below
    return page


def find_silence(counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return for each column (BINS,) whether it lies in a pause much longer than the topic's usual ones."""
    filled = np.flatnonzero(counts)
    silent = np.ones(len(counts), dtype=bool)
    if not len(filled):
        return silent
    silent[filled] = False
    if len(filled) < 4:
        return silent
    pauses = np.diff(filled)
    usual = 2.5 * float(np.median(pauses)) + 1
    for first, pause in zip(filled[:-1], pauses, strict=True):
        if pause <= usual:
            silent[first : first + pause] = False
    return silent


def _shades(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the colours (BINS, 3) of a topic's columns."""
    pale, full = np.array([222.0, 232.0, 241.0]), np.array(scales.BLUE, dtype=np.float64)
    colours = np.full((len(counts), 3), 255.0)
    silent = find_silence(counts)
    colours[~silent] = pale
    filled = counts > 0
    if not filled.any():
        return colours
    usual = float(counts[~silent].mean())
    if usual < _FEWEST_FOR_RATE:
        colours[filled] = full
        return colours
    # A few messages per column come and go with rounding: average over as many columns as hold about twenty.
    window = min(2 * math.ceil(10 / usual) + 1, 81)
    kernel = np.ones(window)
    rate = np.convolve(counts, kernel, "same") / np.maximum(np.convolve(~silent, kernel, "same"), 1)
    share = np.clip(0.3 + 0.7 * rate[~silent] / usual, 0.0, 1.0)[:, None]
    colours[~silent] = pale + (full - pale) * share
    return colours


def _draw_axis(page: Pixels, left: int, top: int, bottom: int, duration_s: float) -> None:
    span = duration_s if duration_s > 0 else 1.0
    unit, label = (3600.0, "h") if span > 4 * 3600 else (60.0, "min") if span > 600 else (1.0, "s")
    steps = scales.ticks(0.0, span / unit, 8)
    for i, v in enumerate(steps):
        x = left + min(v * unit / span * BINS, BINS - 1)
        raster.fill(page, (x, top, x + 1, bottom + 4), (226, 229, 233))
        words = scales.number(v) + (f" {label}" if i == len(steps) - 1 else "")
        raster.text(page, (x, bottom + 6), words, _SIZE, plane.INK, "ma")


def _short(name: str) -> str:
    return name if len(name) <= _MOST_LABEL else f"{name[:12]}…{name[-(_MOST_LABEL - 13) :]}"
