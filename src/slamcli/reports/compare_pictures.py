# SPDX-License-Identifier: MIT
"""Pictures of several results in one frame: maps side by side, walls over each other, trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.reports import scales
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.map import map_outline, paint_cells
from slamcli.reports.figures.plane import Colour, View
from slamcli.reports.figures.raster import Pixels
from slamcli.reports.figures.track import choose_axes
from slamcli.trajectory import Trajectory

PALETTE: tuple[Colour, ...] = (scales.BLUE, scales.VERMILION, scales.GREEN, scales.PURPLE, scales.ORANGE, scales.SKY)
"""As the colours c0 to c5 of a page."""
_PANEL_PX, _WIDE_PX = 800, 1400
_COLUMNS = 2
_OCCUPIED = 65
_GAP = 16
_RING_PX = 22.0
_FAINT = 0.4
"""Opacity of the truth's band."""
_WIDER = 1.4
"""By so many widths of a line each trajectory is wider than the one above it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """A result, laid into the frame that all share."""

    name: str
    trajectory: Trajectory
    grid: OccupancyGrid | None
    colour: int
    """Index into `PALETTE`."""
    marks: tuple[tuple[float, float], ...] = ()
    """Places to ring, metres, shared frame."""


def map_pictures(shown: Sequence[Shown], truth: Trajectory | None) -> bytes:
    """Return a PNG of the maps beside each other, all of the same part of the plane at one scale; empty without maps."""
    grids = [one for one in shown if one.grid is not None]
    if not grids:
        return b""
    view = _view([one.grid for one in grids if one.grid is not None], [one.trajectory for one in grids], _PANEL_PX)
    panels = []
    for one in grids:
        if one.grid is None:
            continue
        picture = paint_cells(one.grid, view)
        thin = plane.line_width(picture)
        if truth is not None:
            raster.stroke(picture, view.pixels(truth.positions_m[:, :2]), scales.GREEN, 3.5 * thin, opacity=_FAINT)
        raster.stroke(picture, view.pixels(one.trajectory.positions_m[:, :2]), PALETTE[one.colour], thin)
        for mark in view.pixels(np.array(one.marks).reshape(-1, 2)):
            raster.circle(picture, mark, _RING_PX, scales.VERMILION, 2.0 * thin)
        legend: list[tuple[str, Colour | None]] = [(one.name, PALETTE[one.colour])]
        legend += [("double walls", scales.VERMILION)] if one.marks else []
        legend += [("truth", _faint(scales.GREEN))] if truth is not None else []
        panels.append(plane.framed(picture, view, one.name, legend))
    return raster.png(_tiled(panels))


def overlay_picture(shown: Sequence[Shown]) -> bytes:
    """Return a PNG of the walls of all maps over each other, one colour each; where they agree they darken. Empty below two maps."""
    grids = [(one, one.grid) for one in shown if one.grid is not None]
    if len(grids) < 2:
        return b""
    view = _view([grid for _, grid in grids], [], _WIDE_PX)
    picture = np.full((view.height_px, view.width_px, 3), 255, dtype=np.uint8)
    for one, grid in grids:
        covered = np.zeros(picture.shape[:2], dtype=np.bool_)
        # Every pixel of a cell, also where a cell is larger than one.
        split = max(1, int(np.ceil(grid.resolution_m / view.metres_per_px * 1.5)))
        steps = (np.arange(split) + 0.5) / split - 0.5
        cells = np.argwhere(grid.cells >= _OCCUPIED).astype(np.float64)
        for row in steps.tolist():
            for column in steps.tolist():
                _mark(covered, view.pixels(grid.cell_to_map(cells + np.array([row, column]))))
        shade = np.array(PALETTE[one.colour], dtype=np.float64) / 255.0
        picture[covered] = np.round(picture[covered] * shade).astype(np.uint8)
    legend: list[tuple[str, Colour | None]] = [(one.name, PALETTE[one.colour]) for one, _ in grids]
    return raster.png(plane.framed(picture, view, "walls over each other", legend))


def trajectory_picture(shown: Sequence[Shown], truth: Trajectory | None) -> bytes:
    """Return a PNG of the trajectories, one colour each, lower ones wider so that all are seen where they agree; the true one as a band below."""
    paths = [one.trajectory for one in shown] + ([truth] if truth is not None else [])
    axes = choose_axes(paths)
    lines = [path.positions_m[:, list(axes)] for path in paths]
    view = plane.fit_view(np.concatenate(lines), _WIDE_PX)
    picture = np.full((view.height_px, view.width_px, 3), 255, dtype=np.uint8)
    thin = plane.line_width(picture)
    legend: list[tuple[str, Colour | None]] = []
    if truth is not None:
        wide = (_WIDER * len(shown) + 3.5) * thin
        raster.stroke(picture, view.pixels(lines[-1]), scales.GREEN, wide, opacity=_FAINT)
        legend.append(("truth", _faint(scales.GREEN)))
    for above, one, line in zip(range(len(shown) - 1, -1, -1), shown, lines, strict=False):
        raster.stroke(picture, view.pixels(line), PALETTE[one.colour], (1.0 + _WIDER * above) * thin)
        legend.append((one.name, PALETTE[one.colour]))
    names = tuple("xyz"[axis] for axis in axes)
    return raster.png(plane.framed(picture, view, "trajectories", legend, (names[0], names[1]), grid=True))


def _faint(colour: Colour) -> Colour:
    """Return what a colour becomes as a band on white."""
    red, green, blue = (round(255 - _FAINT * (255 - part)) for part in colour)
    return red, green, blue


def _view(grids: Sequence[OccupancyGrid], paths: Sequence[Trajectory], longest_px: int) -> View:
    """Return the part of the plane that holds every known cell and every path; cells are whole pixels where they are large."""
    hold = [map_outline(grid) for grid in grids] + [path.positions_m[:, :2] for path in paths]
    view = plane.fit_view(np.concatenate(hold), longest_px)
    return replace(view, width_px=max(view.width_px, 1), height_px=max(view.height_px, 1))


def _mark(covered: NDArray[np.bool_], pixels: NDArray[np.float64]) -> None:
    at = np.floor(pixels).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < covered.shape[1]) & (at[:, 1] < covered.shape[0])
    covered[at[inside, 1], at[inside, 0]] = True


def _tiled(panels: Sequence[Pixels]) -> Pixels:
    """Return panels in rows of at most two, on white."""
    columns = min(len(panels), _COLUMNS)
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    heights = [max(panel.shape[0] for panel in row) for row in rows]
    width = max(sum(panel.shape[1] + _GAP for panel in row) for row in rows)
    page = np.full((sum(heights) + _GAP * len(rows), width, 3), 255, dtype=np.uint8)
    top = 0
    for row, height in zip(rows, heights, strict=True):
        left = 0
        for panel in row:
            page[top : top + panel.shape[0], left : left + panel.shape[1]] = panel
            left += panel.shape[1] + _GAP
        top += height + _GAP
    return page
