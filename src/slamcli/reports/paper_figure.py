# SPDX-License-Identifier: MIT
"""Figures for papers: trajectories as vectors over a map, as PDF, SVG or PNG of a given width."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.reports import scales
from slamcli.reports.figures import plane
from slamcli.reports.figures.map import UNKNOWN_COLOUR, map_layer
from slamcli.reports.figures.track import choose_axes
from slamcli.trajectory import Trajectory

FORMATS = (".pdf", ".svg")
MOST_LINES = 6
_LINES = (scales.BLUE, scales.VERMILION, scales.PURPLE, scales.ORANGE, scales.SKY, (90, 90, 90))
_CM = 1 / 2.54
_LEFT_CM, _RIGHT_CM, _BOTTOM_CM, _TOP_CM, _ROW_CM = 1.05, 0.15, 0.95, 0.15, 0.42
_MOST_HEIGHT_CM = 23.0
_DPI = 300
_UNKNOWN = (238, 240, 243)
"""Lighter than on a screen: ink is dear."""
_WIDTHS = (1.7, 1.2, 0.9, 0.7, 0.6, 0.5)
"""Of lines, points: those that lie on top are thinner, so that all are seen where they agree."""
# TrueType in PDF, so that publishers' checks of fonts pass; outlines in SVG, which then looks the same everywhere.
_STYLE: Any = {
    "font.family": "DejaVu Sans", "font.size": 7, "axes.linewidth": 0.5, "pdf.fonttype": 42, "svg.fonttype": "path",
    "svg.hashsalt": "slamcli", "xtick.major.width": 0.5, "ytick.major.width": 0.5, "xtick.major.size": 2.5,
    "ytick.major.size": 2.5, "axes.unicode_minus": True,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperOptions:
    """How a figure is laid out."""

    width_cm: float = 8.8
    """The column of most two-column papers; 18 is the page."""
    title: str = ""


def paper_figure(
    suffix: str,
    lines: Sequence[tuple[str, Trajectory]],
    *,
    grid: OccupancyGrid | None = None,
    truth: tuple[str, Trajectory] | None = None,
    options: PaperOptions | None = None,
) -> bytes:
    """Return a figure as a PDF, SVG or PNG (300 dots an inch) file; the same input gives the same bytes.

    The map lies below as an image, a pixel for a cell or more of them; trajectories are paths, in colours that every common
    colour blindness tells apart, with a disc at their start and a square at their end; ground truth is green and dashed. Without a
    map, the two axes that trajectories use most are drawn.

    Parameters
    ----------
    suffix
        ``.pdf``, ``.svg`` or ``.png``.
    lines
        Label and trajectory, up to six.
    grid
        The map below.
    truth
        Label and ground truth.
    """
    options = options or PaperOptions()
    beside = [truth] if truth is not None else []
    axes = (0, 1) if grid is not None else choose_axes([t for _, t in (*lines, *beside)])
    points = [t.positions_m[:, list(axes)] for _, t in (*lines, *beside)]
    everything = np.concatenate([*points, np.zeros((0, 2))])
    picture = None
    if grid is not None:
        picture, view = map_layer(grid, everything, _map_pixels(options))
        picture[(picture == UNKNOWN_COLOUR).all(axis=2)] = _UNKNOWN
    else:
        view = plane.fit_view(everything, 1000)
    with rc_context(_STYLE):
        figure, ax = _page(view, options, rows=_legend_rows(len(points), options.width_cm))
        if picture is not None:
            span = view.span_m
            extent = (view.left_m, view.left_m + span[0], view.bottom_m, view.bottom_m + span[1])
            ax.imshow(picture, extent=extent, origin="upper", interpolation="none", aspect="auto", zorder=0)
        else:
            ax.grid(linewidth=0.3, color="0.85")
        widths = _WIDTHS if len(lines) > 1 else _WIDTHS[2:]
        for (label, _), at, colour, width in zip(lines, points, _LINES, widths, strict=False):
            _draw(ax, at, label, colour, "-", width)
        if truth is not None:
            _draw(ax, points[-1], truth[0], scales.GREEN, (0, (4, 1.5)), 0.9)
        names = "xyz"
        ax.set_xlabel(f"{names[axes[0]]} in m", labelpad=1.5)
        ax.set_ylabel(f"{names[axes[1]]} in m", labelpad=1.5)
        if len(points) > 1:
            columns = max(1, int(options.width_cm // 3.2))
            figure.legend(
                loc="upper center", ncols=min(columns, len(points)), frameon=False, handlelength=1.6, columnspacing=1.2,
                borderaxespad=0.2, bbox_to_anchor=(0.5, 1.0 - (_ROW_CM * bool(options.title)) / _height(figure)),
            )  # fmt: skip
        if options.title:
            figure.suptitle(options.title, y=1.0 - 0.08 / _height(figure), va="top", fontsize=8)
        return _encoded(figure, suffix)


def _map_pixels(options: PaperOptions) -> int:
    """Return how many pixels of a map are worth printing: 600 an inch."""
    return max(200, round(options.width_cm * _CM * 600))


def _legend_rows(entries: int, width_cm: float) -> int:
    return 0 if entries < 2 else -(-entries // max(1, int(width_cm // 3.2)))


def _page(view: plane.View, options: PaperOptions, *, rows: int) -> tuple[Figure, Axes]:
    """Return a page that fits around the view at one scale in both directions, and the axes on it."""
    top = _TOP_CM + _ROW_CM * (rows + bool(options.title))
    span = view.span_m
    plot_w = options.width_cm - _LEFT_CM - _RIGHT_CM
    plot_h = plot_w * span[1] / span[0]
    most = _MOST_HEIGHT_CM - top - _BOTTOM_CM
    if plot_h > most:
        plot_w, plot_h = most * span[0] / span[1], most
    width, height = plot_w + _LEFT_CM + _RIGHT_CM, plot_h + top + _BOTTOM_CM
    figure = Figure(figsize=(width * _CM, height * _CM))
    box = (_LEFT_CM / width, _BOTTOM_CM / height, plot_w / width, plot_h / height)
    ax = figure.add_axes(box)
    ax.set_xlim(view.left_m, view.left_m + span[0])
    ax.set_ylim(view.bottom_m, view.bottom_m + span[1])
    for axis, length in ((ax.xaxis, plot_w), (ax.yaxis, plot_h)):
        axis.set_major_locator(MaxNLocator(nbins=max(2, int(length // 1.2)), steps=[1, 2, 5, 10]))
    return figure, ax


def _height(figure: Figure) -> float:
    """Return the height of a page, centimetres."""
    return float(figure.get_size_inches()[1] / _CM)


def _draw(
    ax: Axes, at: NDArray[np.float64], label: str, rgb: tuple[int, int, int], style: str | tuple[int, tuple[float, ...]],
    width_pt: float,
) -> None:  # fmt: skip
    """Draw a trajectory (N, 2), a disc at its start and a square at its end."""
    colour = tuple(c / 255 for c in rgb)
    if not len(at):
        return
    ax.plot(at[:, 0], at[:, 1], color=colour, linewidth=width_pt, linestyle=style, label=label, solid_capstyle="round")
    for place, marker in ((at[0], "o"), (at[-1], "s")):
        ax.plot(*place, marker, color=colour, markersize=3.4, markeredgecolor="white", markeredgewidth=0.5)


def _encoded(figure: Figure, suffix: str) -> bytes:
    stream = io.BytesIO()
    if suffix == ".pdf":
        nothing = dict.fromkeys(("Creator", "Producer", "CreationDate"))
        FigureCanvasPdf(figure)
        figure.savefig(stream, format="pdf", metadata=nothing)
    elif suffix == ".svg":
        FigureCanvasSVG(figure)
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    else:
        FigureCanvasAgg(figure)
        figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    return stream.getvalue()
