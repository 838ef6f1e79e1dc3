# SPDX-License-Identifier: MIT
"""A plane seen from above: which part is drawn, lines on it, and the axes, legend and scale around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.reports import scales
from slamcli.reports.figures import raster
from slamcli.reports.figures.raster import Pixels
from slamcli.trajectory import Trajectory

INK = (51, 56, 64)
FAINT = (140, 147, 156)
PAGE = (255, 255, 255)
COMFORTABLE_PX = 1400
"""Length of the longer side that small content is enlarged to."""
MOST_PX_PER_CELL = 48

Colour = tuple[int, int, int]
Legend = Sequence[tuple[str, Colour | None]]
"""What lines mean: label and colour, None for the colours of time."""


@dataclass(frozen=True, slots=True)
class View:
    """The part of the plane that is drawn."""

    left_m: float
    bottom_m: float
    metres_per_px: float
    width_px: int
    height_px: int

    def pixels(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Return pixel coordinates (N, 2) of points (N, 2) in metres."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        x = (points[:, 0] - self.left_m) / self.metres_per_px
        return np.column_stack([x, self.height_px - (points[:, 1] - self.bottom_m) / self.metres_per_px])

    @property
    def span_m(self) -> tuple[float, float]:
        """Width and height in metres."""
        return self.width_px * self.metres_per_px, self.height_px * self.metres_per_px


def fit_view(points_m: NDArray[np.float64], max_pixels: int) -> View:
    """Return the view that holds all finite points (N, 2) with a small margin."""
    finite = points_m[np.isfinite(points_m).all(axis=1)]
    low, high = (finite.min(axis=0), finite.max(axis=0)) if len(finite) else (np.zeros(2), np.ones(2))
    longest = max(float((high - low).max()), 1e-3)
    # Neither a straight line nor a single point shall become a sliver.
    margin = np.maximum(0.04 * longest, (0.3 * longest - (high - low)) / 2)
    low, high = low - margin, high + margin
    scale = float((high - low).max()) / min(COMFORTABLE_PX, max_pixels)
    size = np.maximum(np.ceil((high - low) / scale), 1).astype(np.int64)
    return View(float(low[0]), float(low[1]), scale, int(size[0]), int(size[1]))


def line_width(picture: Pixels) -> float:
    """Return the width in pixels of a line that is neither lost nor loud on a picture of this size."""
    return max(1.5, max(picture.shape[:2]) / 700)


def draw_trajectory(
    picture: Pixels, points_px: NDArray[np.float64], stamps_ns: NDArray[np.int64], width: float
) -> None:
    """Draw poses coloured by time, with a disc at the first and a square at the last of them."""
    if len(points_px) == 0:
        return
    raster.stroke(picture, points_px, scales.time_colours(_progress(stamps_ns)), width)
    mark = max(4.0, 2.6 * width)
    first, last = scales.time_colours([0.0, 1.0])
    for radius, shade in ((mark + 1.5, np.array(PAGE)), (mark, first)):
        raster.disc(picture, points_px[0], radius, shade)
    x, y = points_px[-1]
    for radius, shade in ((mark + 1.5, np.array(PAGE)), (mark, last)):
        raster.fill(picture, (x - radius, y - radius, x + radius, y + radius), shade)


def time_legend(label: str, trajectory: Trajectory) -> tuple[str, None]:
    """Return the legend entry of a trajectory that is coloured by time."""
    if not trajectory.timed or len(trajectory) == 0:
        return f"{label}, {len(trajectory):,} poses", None
    span = float(trajectory.stamps_ns[-1] - trajectory.stamps_ns[0]) / 1e9
    return f"{label}, {scales.duration(max(span, 0.0))}", None


def framed(
    picture: Pixels, view: View, title: str, legend: Legend, axes: tuple[str, str] = ("x", "y"), *, grid: bool = False
) -> Pixels:
    """Return the picture with axes in metres around it, the title above, scale bar and legend below.

    `axes` names the two axes where they are not x and y; `grid` draws faint lines below what is not white.
    """
    size = int(np.clip(max(picture.shape[:2]) / 75, 12, 24))
    span = view.span_m
    step = scales.tick_step(max(span), 8)
    x_ticks = scales.multiples(view.left_m, view.left_m + span[0], step)
    y_ticks = scales.multiples(view.bottom_m, view.bottom_m + span[1], step)
    x_px = [(v - view.left_m) / view.metres_per_px for v in x_ticks]
    y_px = [view.height_px - (v - view.bottom_m) / view.metres_per_px for v in y_ticks]
    if grid:
        _draw_grid(picture, x_px, y_px)
    room = max([raster.text_width(scales.number(v), size) for v in y_ticks] or [0])
    left, top = room + 2 * size, round(2.2 * size) if title or axes != ("x", "y") else size
    gap = round(2.2 * size)
    width = max(left + view.width_px + size, 24 * size)
    lines = _legend_rows(view, left, width, size, legend)
    page = np.full((top + view.height_px + 2 * gap + size // 2 + (len(lines) - 1) * 2 * size, width, 3), 255, np.uint8)
    page[top : top + view.height_px, left : left + view.width_px] = picture
    bottom = top + view.height_px
    for i, (v, x) in enumerate(zip(x_ticks, x_px, strict=True)):
        raster.fill(page, (left + x, bottom, left + x + 1, bottom + size / 3), FAINT)
        label = scales.number(v) + (" m" if i == len(x_ticks) - 1 else "")
        raster.text(page, (left + x, bottom + 0.5 * size), label, size, INK, "ma")
    for v, y in zip(y_ticks, y_px, strict=True):
        raster.fill(page, (left - size / 3, top + y, left, top + y + 1), FAINT)
        raster.text(page, (left - 0.6 * size, top + y), scales.number(v), size, INK, "rm")
    if axes != ("x", "y"):
        title = f"{title}   {axes[0]} to the right, {axes[1]} up".strip()
    raster.text(page, (left, 0.45 * size), title, round(1.15 * size), INK)
    _draw_footer(page, view, left, bottom + round(1.6 * gap), size, lines)
    return page


def _progress(stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the share (N,) of the time that has gone at each stamp; by index where the stamps do not advance."""
    elapsed = (stamps_ns - stamps_ns[0]).astype(np.float64)
    if elapsed[-1] <= 0:
        return np.linspace(0.0, 1.0, len(elapsed))
    return np.clip(elapsed / elapsed[-1], 0.0, 1.0)


def _draw_grid(picture: Pixels, x_px: Sequence[float], y_px: Sequence[float]) -> None:
    lines = np.zeros(picture.shape[:2], dtype=bool)
    lines[:, [min(math.floor(x), picture.shape[1] - 1) for x in x_px]] = True
    lines[[min(math.floor(y), picture.shape[0] - 1) for y in y_px]] = True
    picture[lines & (picture == 255).all(axis=2)] = (232, 235, 239)


def _scale_bar(view: View, size: int) -> tuple[float, str, float]:
    """Return length in pixels and label of the scale bar, and the room that both need."""
    length = scales.tick_step(view.span_m[0], 5)
    while length > view.span_m[0]:
        length /= 2
    label = f"{scales.number(length)} m"
    bar = length / view.metres_per_px
    return bar, label, bar + raster.text_width(label, size) + 2.5 * size


def _legend_rows(
    view: View, left: int, width: int, size: int, legend: Legend
) -> list[list[tuple[float, str, Colour | None]]]:
    """Return the legend's entries with their places, in as many rows as they need; the first row begins at the scale bar."""
    rows: list[list[tuple[float, str, Colour | None]]] = [[]]
    at = left + _scale_bar(view, size)[2]
    for words, colour in legend:
        needed = 3.0 * size + raster.text_width(words, size)
        if at + needed > width and at > left:
            rows.append([])
            at = float(left)
        rows[-1].append((at, words, colour))
        at += needed + 1.5 * size
    return rows


def _draw_footer(
    page: Pixels, view: View, left: int, y: int, size: int, rows: list[list[tuple[float, str, Colour | None]]]
) -> None:
    """Draw the scale bar on the left and the legend beside and below it."""
    bar, label, _ = _scale_bar(view, size)
    raster.fill(page, (left, y - 1, left + bar, y + 1), INK)
    for x in (left, left + bar - 1):
        raster.fill(page, (x, y - size / 3, x + 1, y + size / 3), INK)
    raster.text(page, (left + bar + 0.5 * size, y), label, size, INK, "lm")
    for i, row in enumerate(rows):
        line_y = y + 2 * size * i
        for at, words, colour in row:
            shades = scales.time_colours(np.linspace(0, 1, 16)) if colour is None else colour
            line = np.column_stack([np.linspace(at, at + 2.5 * size, 16), np.full(16, line_y + 0.5)])
            raster.stroke(page, line, shades, max(2.0, size / 5))
            raster.text(page, (at + 3.0 * size, line_y), words, size, INK, "lm")
