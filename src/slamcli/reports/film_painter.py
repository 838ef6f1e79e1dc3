# SPDX-License-Identifier: MIT
"""Frames of an animation: the map, the robot and what it sees and plans, in the colours of one palette.

A frame is an array of palette indices, which a GIF stores as it is: nothing has to be looked up or dithered afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.reports import scales
from slamcli.reports.figures import raster
from slamcli.reports.figures.map import UNKNOWN_COLOUR, paint_cells
from slamcli.reports.figures.plane import View
from slamcli.reports.snapshot import CostPatch, Snapshot

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

GREYS = 16
"""Indices 0 to 15: white to black."""
UNKNOWN = 16
_COSTS = 20
_COST_STEPS = 12
"""Indices 20 to 31: how a costmap tints free cells; 32 is lethal."""
_LETHAL = 32
PEN = {
    "trail": 40, "plan": 41, "local plan": 42, "scan": 43, "particles": 44, "person": 45, "person's way": 46, "robot": 47,
    "rim": 48, "estimate": 49, "goal": 50, "nose": 51,
}  # fmt: skip
TRANSPARENT = 255
"""Index that no frame has; a film may use it for what the frame before showed."""
_HEADER_PX = 30
_TEXT_PX = 15
_FOOTER_PX = 24
_KEY_PX = 12
_KEY = (
    ("trail", "driven"), ("plan", "plan"), ("local plan", "local plan"), ("scan", "scan"), ("particles", "particles"),
    ("estimate", "estimate"), ("person", "people"), ("goal", "goal"),
)  # fmt: skip
_ARROW_M = 0.45


def palette() -> NDArray[np.uint8]:
    """Return the colours uint8 (256, 3) of indices."""
    table = np.zeros((256, 3), dtype=np.uint8)
    table[:GREYS] = np.linspace(255, 24, GREYS).round()[:, None]
    table[UNKNOWN] = UNKNOWN_COLOUR
    near, far = np.array([236, 178, 222.0]), np.array([250, 244, 250.0])
    share = np.linspace(0, 1, _COST_STEPS)[:, None]
    table[_COSTS : _COSTS + _COST_STEPS] = (far + (near - far) * share).round()
    table[_LETHAL] = (176, 84, 150)
    for name, colour in (
        ("trail", scales.GREEN), ("plan", scales.BLUE), ("local plan", scales.ORANGE), ("scan", scales.VERMILION),
        ("particles", (70, 150, 110)), ("person", scales.ORANGE), ("person's way", (120, 80, 0)), ("robot", (64, 72, 84)),
        ("rim", (20, 22, 26)), ("estimate", scales.SKY), ("goal", scales.VERMILION), ("nose", (255, 255, 255)),
    ):  # fmt: skip
        table[PEN[name]] = colour
    return table


class FilmPainter:
    """Draws snapshots of one run, all of the same size.

    Parameters
    ----------
    grids
        The maps, in the order in which they became known.
    view
        The part of the map that is shown.
    footprint
        float64 (N, 2), metres, base frame: the robot's outline.
    trail
        float64 (M, 3): time, x, y of the robot, for the way that it has come.
    """

    def __init__(self, grids: Sequence[OccupancyGrid], view: View, footprint: Array, trail: Array) -> None:
        self._grids, self._view = grids, view
        self._footprint = footprint
        self._trail_s, self._trail = trail[:, 0], self._pixels(trail[:, 1:])
        self._number: int | None = None
        self._ground: Pixels = np.zeros((0, 0), dtype=np.uint8)
        self._footer = _footer(self.size[0])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of frames in pixels."""
        return self._view.width_px, self._view.height_px + _HEADER_PX + _FOOTER_PX

    def paint(self, snapshot: Snapshot) -> Pixels:
        """Return a frame, uint8 (H, W), indices of `palette`."""
        from PIL import Image, ImageDraw

        below = self._below(snapshot.map_number)
        if snapshot.patch is not None:
            below = self._tinted(below, snapshot.patch)
        frame = np.zeros(self.size[::-1], dtype=np.uint8)
        frame[_HEADER_PX:-_FOOTER_PX] = below
        self._dot(frame, snapshot.particles_m, "particles", 1)
        self._dot(frame, snapshot.scan_m, "scan", 2)
        picture = Image.fromarray(frame)
        draw = ImageDraw.Draw(picture)
        self._line(draw, self._pixels(snapshot.plan_m), "plan", 2)
        self._line(draw, self._trail[: np.searchsorted(self._trail_s, snapshot.time_s, side="right")], "trail", 2)
        self._line(draw, self._pixels(snapshot.local_plan_m), "local plan", 3)
        self._people(draw, snapshot.people)
        self._goal(draw, snapshot.goal)
        self._robot(draw, snapshot)
        drawn = np.array(picture)
        self._header(drawn, snapshot)
        drawn[-_FOOTER_PX:] = self._footer
        return drawn

    def _below(self, number: int) -> Pixels:
        """Return the map as indices."""
        if number != self._number:
            view = self._view
            if 0 <= number < len(self._grids):
                self._ground = map_indices(paint_cells(self._grids[number], view))
            else:
                self._ground = np.full((view.height_px, view.width_px), UNKNOWN, dtype=np.uint8)
            self._number = number
        return self._ground

    def _tinted(self, ground: Pixels, patch: CostPatch) -> Pixels:
        """Return the ground with a costmap over what is free or unknown there."""
        rows, columns = patch.costs.shape
        size = np.array([columns, rows]) * patch.resolution_m
        corners = se2.transform_points(patch.T_map_corner, np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size)
        at = self._view.pixels(corners)
        limit = np.array([self._view.width_px, self._view.height_px])
        (x0, y0), (x1, y1) = (np.clip(edge, 0, limit).astype(np.int64) for edge in (at.min(axis=0), at.max(axis=0) + 1))
        if x0 >= x1 or y0 >= y1:
            return ground
        scale = self._view.metres_per_px
        x = self._view.left_m + (np.arange(x0, x1) + 0.5) * scale - patch.T_map_corner[0]
        y = self._view.bottom_m + (self._view.height_px - np.arange(y0, y1) - 0.5) * scale - patch.T_map_corner[1]
        c, s = math.cos(patch.T_map_corner[2]), math.sin(patch.T_map_corner[2])
        column = np.floor((c * x + s * y[:, None]) / patch.resolution_m).astype(np.int64)
        row = np.floor((c * y[:, None] - s * x) / patch.resolution_m).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        tint = _tints()[patch.costs[np.where(inside, row, 0), np.where(inside, column, 0)]]
        tinted = ground.copy()
        part = tinted[y0:y1, x0:x1]
        shown = inside & (tint > 0) & ((part < 3) | (part == UNKNOWN))
        part[shown] = tint[shown]
        return tinted

    def _dot(self, frame: Pixels, points_m: Array, pen: str, size: int) -> None:
        """Set the pixels of points, `size` by `size`."""
        at = self._pixels(points_m)
        at = np.round(at[np.isfinite(at).all(axis=1)] - (size - 1) / 2).astype(np.int64)
        for dx in range(size):
            for dy in range(size):
                x, y = at[:, 0] + dx, at[:, 1] + dy
                inside = (x >= 0) & (y >= _HEADER_PX) & (x < frame.shape[1]) & (y < frame.shape[0] - _FOOTER_PX)
                frame[y[inside], x[inside]] = PEN[pen]

    def _line(self, draw: Any, at: Array, pen: str, width: int) -> None:
        if len(at) > 1:
            draw.line([tuple(point) for point in at.tolist()], fill=PEN[pen], width=width)

    def _people(self, draw: Any, people: Array) -> None:
        for x, y, radius, vx, vy in people.tolist():
            centre = self._pixels(np.array([[x, y], [x + vx, y + vy]]))
            reach = max(radius / self._view.metres_per_px, 2.0)
            (cx, cy), _ = centre.tolist()
            draw.ellipse([cx - reach, cy - reach, cx + reach, cy + reach], fill=PEN["person"], outline=PEN["rim"])
            self._line(draw, centre, "person's way", 2)

    def _goal(self, draw: Any, goal: Array | None) -> None:
        if goal is not None:
            tip = goal[:2] + _ARROW_M * np.array([math.cos(goal[2]), math.sin(goal[2])])
            at = self._pixels(np.array([goal[:2], tip]))
            self._line(draw, at, "goal", 2)
            (x, y), _ = at.tolist()
            draw.ellipse([x - 5, y - 5, x + 5, y + 5], outline=PEN["goal"], width=2)

    def _robot(self, draw: Any, snapshot: Snapshot) -> None:
        if snapshot.estimate is not None:
            outline = self._pixels(se2.transform_points(snapshot.estimate, self._footprint))
            self._line(draw, np.concatenate([outline, outline[:1]]), "estimate", 2)
        body = self._pixels(se2.transform_points(snapshot.pose, self._footprint))
        draw.polygon([tuple(point) for point in body.tolist()], fill=PEN["robot"], outline=PEN["rim"])
        ahead = np.array([[0.0, 0.0], [float(self._footprint[:, 0].max()), 0.0]])
        self._line(draw, self._pixels(se2.transform_points(snapshot.pose, ahead)), "nose", 2)

    def _header(self, frame: Pixels, snapshot: Snapshot) -> None:
        """Write time, state and speed on white above the map."""
        frame[:_HEADER_PX] = 0
        frame[_HEADER_PX - 1] = 3
        words = f"{snapshot.time_s:.1f} s"
        write_words(frame, 8, words)
        write_words(frame, 80, snapshot.state)
        speed = f"{float(np.hypot(snapshot.speed[0], snapshot.speed[1])):.2f} m/s"
        write_words(frame, frame.shape[1] - 8 - raster.text_width(speed, _TEXT_PX), speed)

    def _pixels(self, points_m: Array) -> Array:
        """Return where points are for Pillow, whose whole numbers are the centres of pixels."""
        return self._view.pixels(points_m) + np.array([-0.5, _HEADER_PX - 0.5])


def map_indices(colours: Pixels) -> Pixels:
    """Return the indices uint8 (H, W) of a map's pixels uint8 (H, W, 3), as `paint_cells` paints them."""
    darkness = (255 - colours[..., 0].astype(np.int64)) * (GREYS - 1) / (255 - 24)
    indices = darkness.round().astype(np.uint8)
    indices[(colours == UNKNOWN_COLOUR).all(axis=2)] = UNKNOWN
    return indices


def _footer(width: int) -> Pixels:
    """Return a strip (_FOOTER_PX, width) that says what colours mean, as much of it as there is room for."""
    strip = np.zeros((_FOOTER_PX, width), dtype=np.uint8)
    strip[0] = 3
    left = 8
    for pen, words in _KEY:
        if left + 22 + raster.text_width(words, _KEY_PX) > width:
            break
        strip[_FOOTER_PX // 2 - 2 : _FOOTER_PX // 2 + 3, left : left + 14] = PEN[pen]
        write_words(strip, left + 18, words, _KEY_PX, _FOOTER_PX)
        left += 34 + raster.text_width(words, _KEY_PX)
    return strip


def write_words(frame: Pixels, left: int, words: str, size_px: int = _TEXT_PX, height_px: int = _HEADER_PX) -> None:
    """Write a line of text in shades of grey into the top `height_px` rows, as far as it goes."""
    mask = raster.text_mask(words, size_px)
    shades = np.round(mask * (GREYS - 1)).astype(np.uint8)
    left = max(left, 0)
    top = max((height_px - shades.shape[0]) // 2, 0)
    part = shades[: height_px - 1 - top, : max(frame.shape[1] - left, 0)]
    box = frame[top : top + part.shape[0], left : left + part.shape[1]]
    np.maximum(box, part, out=box)


@cache
def _tints() -> NDArray[np.uint8]:
    """Return indices (256,) of costs; 0 for what is not drawn: free and unknown."""
    cost = np.arange(256)
    table = _COSTS + (cost - 1) * (_COST_STEPS - 1) // 252
    table[0] = table[255] = 0
    table[254] = _LETHAL
    return table.astype(np.uint8)
