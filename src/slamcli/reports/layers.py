# SPDX-License-Identifier: MIT
"""Drawings in layers over a map, which the reader switches on and off."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.reports import page
from slamcli.reports.chart_frame import Frame, axes
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.map import map_layer
from slamcli.reports.figures.plane import View

WIDTH = 960
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 8, 8, 36
_MAX_PIXELS = 1200
_FADE = 0.4


@dataclass(frozen=True, slots=True)
class Layer:
    """What one switch shows and hides."""

    label: str
    markup: str
    shown: bool = True
    key: str = ""
    """Class of the swatch beside the switch; empty for none."""


class Place:
    """Metres to units of the drawing."""

    def __init__(self, view: View) -> None:
        span = view.span_m
        plot = WIDTH - _LEFT - _RIGHT
        self.height = _TOP + round(plot * span[1] / span[0]) + _BOTTOM
        self.frame = Frame(
            view.left_m, view.left_m + span[0], view.bottom_m, view.bottom_m + span[1],
            _LEFT, _TOP, WIDTH - _RIGHT, self.height - _BOTTOM,
        )  # fmt: skip

    def __call__(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the places (N, 2) of points (N, 2)."""
        return np.column_stack([self.frame.x(points_m[:, 0]), self.frame.y(points_m[:, 1])])


def ground(grid: OccupancyGrid | None, points_m: NDArray[np.float64]) -> tuple[Place, Layer | None]:
    """Return where things are drawn so that map and points (N, 2) fit, and the map as a layer if there is one."""
    if grid is None:
        return Place(plane.fit_view(points_m, _MAX_PIXELS)), None
    picture, view = map_layer(grid, points_m, _MAX_PIXELS)
    place = Place(view)
    return place, Layer("map", _background(picture, place)) if picture.size else None


def _background(picture: NDArray[np.uint8], place: Place) -> str:
    faded = np.round(255 - (255 - picture.astype(np.float64)) * _FADE).astype(np.uint8)
    data = base64.b64encode(raster.png(faded)).decode("ascii")
    f = place.frame
    box = f'x="{f.left}" y="{f.top}" width="{f.right - f.left}" height="{f.bottom - f.top}"'
    return f'<image {box} preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'


def thinned(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points that differ from the one before them on the drawing."""
    at = np.round(at, 1)
    keep = np.ones(len(at), dtype=bool)
    keep[1:] = np.abs(np.diff(at, axis=0)).max(axis=1, initial=0.0) >= 0.5
    return at[keep]


def polyline(at: NDArray[np.float64]) -> str:
    """Return the ``d`` of a line through points (N, 2)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in at) if len(at) else ""


def dots(at: NDArray[np.float64]) -> str:
    """Return the ``d`` of dots at points (N, 2)."""
    return "".join(f"M{x:.1f} {y:.1f}h0" for x, y in at)


def layered_drawing(layers: Sequence[Layer], place: Place, title: str) -> str:
    """Return the drawing of layers, the last on top, with their switches; `title` is its name for who cannot see it."""
    switches = [
        (
            layer.label,
            layer.shown,
            f'<svg class="key" viewBox="0 0 22 10"><path class="{layer.key}" d="M2 5h18"/></svg>' if layer.key else "",
        )
        for layer in layers
    ]
    groups = "".join(f'<g class="l{i}">{layer.markup}</g>' for i, layer in enumerate(layers))
    drawn = (
        f'<svg class="graph" viewBox="0 0 {WIDTH} {place.height}" role="img" aria-label="{title}">'
        f"{axes(place.frame, 'x in m', 'y in m', equal=True)}{groups}</svg>"
    )
    return page.layered(switches, page.zoomable(drawn))
