# SPDX-License-Identifier: MIT
"""A robot on its map as text for a terminal: two square dots to a character, in 256 colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid

Array = NDArray[np.float64]
Dots = NDArray[np.uint8]

UNKNOWN, FLOOR, WALL, BEAM, PERSON, ROBOT, NOSE = range(7)
"""What a dot shows."""
COLOURS = (16, 237, 252, 203, 213, 40, 226)
"""Colour of each in the palette of 256 that terminals have."""

_COARSEST_M = 0.2
"""Where the map is too large for dots of this size, the picture shows the part around the robot."""
_SIZES_M = (0.02, 0.05, 0.1, _COARSEST_M)
_OCCUPIED_FROM, _FREE_TO = 65, 25
_MOST_SAMPLES = 5
_NOSE_M = 0.25
_RESET = "\x1b[0m"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TerminalScene:
    """What there is to draw; everything in the map frame, metres and radians."""

    grid: OccupancyGrid | None
    """The map; None: nothing is known yet."""
    pose: Array
    """float64 (3,): x, y, yaw of the robot."""
    radius_m: float
    """Of its body."""
    beam_ends: Array
    """float64 (N, 2)."""
    discs: Array
    """float64 (D, 3 or more): x, y, radius of whoever walks about."""
    above: Sequence[str] = ()
    """Lines of text above the picture."""
    below: Sequence[str] = ()
    """Lines below it."""


@dataclass(frozen=True, slots=True)
class _Window:
    """The part of the map that is seen."""

    left_m: float
    top_m: float
    dot_m: float
    columns: int
    rows: int
    """Rows of dots."""

    def dots(self, points: Array) -> NDArray[np.int64]:
        """Return row and column (N, 2) of points (N, 2) that are seen."""
        column = np.floor((points[:, 0] - self.left_m) / self.dot_m)
        row = np.floor((self.top_m - points[:, 1]) / self.dot_m)
        seen = (row >= 0) & (column >= 0) & (row < self.rows) & (column < self.columns)
        return np.column_stack([row[seen], column[seen]]).astype(np.int64)


def draw_terminal(scene: TerminalScene, columns: int, lines: int) -> str:
    """Return `lines` lines of `columns` characters each, parted by newlines, with ANSI colours.

    The map is north up. It is shown whole where dots of 0.2 m are small enough for that, otherwise the part around the robot.
    Lines of text that do not fit are cut; the picture gets what they leave, one line at least.
    """
    above = list(scene.above)[: max(lines - 1, 0)]
    below = list(scene.below)[: max(lines - 1 - len(above), 0)]
    height = max(lines - len(above) - len(below), 1)
    window = _window(scene, columns, 2 * height)
    return "\n".join(
        [
            *(_text_line(text, columns) for text in above),
            *picture_lines(_dots(scene, window)),
            *(_text_line(text, columns) for text in below),
        ]
    )


def picture_lines(dots: Dots) -> list[str]:
    """Return dots (2 H, W) as H lines of W characters."""
    return [_line(upper, lower) for upper, lower in zip(dots[::2].tolist(), dots[1::2].tolist(), strict=True)]


def _line(upper: Sequence[int], lower: Sequence[int]) -> str:
    parts, before = [], None
    for pair in zip(upper, lower, strict=True):
        if pair != before:
            above, below = COLOURS[pair[0]], COLOURS[pair[1]]
            parts.append(f"\x1b[38;5;{above};48;5;{below}m")
            before = pair
        parts.append("▀" if pair[0] != pair[1] else " ")
    return "".join(parts) + _RESET


def _text_line(text: str, columns: int) -> str:
    return text[:columns].ljust(columns)


def _window(scene: TerminalScene, columns: int, rows: int) -> _Window:
    """Return what is seen: corners fall on whole dots, so that the picture does not shimmer while it moves."""
    x, y, _ = scene.pose.tolist()
    x0, y0, x1, y1 = (x, y, x, y) if scene.grid is None else _bounds(scene.grid)
    fitting = max((x1 - x0) / max(columns - 2, 1), (y1 - y0) / max(rows - 2, 1))
    dot = next((size for size in _SIZES_M if size >= fitting), _COARSEST_M)
    middle_x, middle_y = _middle(x, x0, x1, columns * dot), _middle(y, y0, y1, rows * dot)
    left, top = round(middle_x / dot - columns / 2), round(middle_y / dot + rows / 2)
    return _Window(left * dot, top * dot, dot, columns, rows)


def _middle(robot: float, low: float, high: float, seen: float) -> float:
    """Return the middle of what is seen: that of the map if all of it is, else the robot, but no more beyond the map than needed."""
    if high - low <= seen:
        return (low + high) / 2.0
    return min(max(robot, low + seen / 2.0), high - seen / 2.0)


def _bounds(grid: OccupancyGrid) -> tuple[float, float, float, float]:
    h, w = grid.height, grid.width
    corners = grid.cell_to_map(np.array([[0, 0], [0, w], [h, 0], [h, w]]) - 0.5)
    (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    return x0, y0, x1, y1


def _dots(scene: TerminalScene, window: _Window) -> Dots:
    dots = np.full((window.rows, window.columns), UNKNOWN, np.uint8)
    if scene.grid is not None:
        dots = _ground(scene.grid, window)
    _set(dots, window, scene.beam_ends, BEAM)
    for x, y, radius in scene.discs[:, :3].tolist():
        _set(dots, window, _disc(x, y, radius, window.dot_m), PERSON)
    x, y, yaw = scene.pose.tolist()
    _set(dots, window, _disc(x, y, scene.radius_m, window.dot_m), ROBOT)
    reach = scene.radius_m + max(_NOSE_M, 1.5 * window.dot_m)
    along = np.arange(scene.radius_m / 2.0, reach, window.dot_m / 2.0)
    _set(dots, window, se2.transform_points([x, y, yaw], np.column_stack([along, np.zeros(len(along))])), NOSE)
    return dots


def _ground(grid: OccupancyGrid, window: _Window) -> Dots:
    """Return dots (rows, columns): a wall where any sample of a dot is one, floor where any is free."""
    samples = min(max(math.ceil(window.dot_m / grid.resolution_m), 1), _MOST_SAMPLES)
    step = window.dot_m / samples
    x: Array = window.left_m + (np.arange(window.columns * samples, dtype=np.float64) + 0.5) * step
    y: Array = window.top_m - (np.arange(window.rows * samples, dtype=np.float64) + 0.5) * step
    cells = _cells_at(grid, x, y)
    shape = (window.rows, samples, window.columns, samples)
    wall = (cells >= _OCCUPIED_FROM).reshape(shape).any(axis=(1, 3))
    free = ((cells >= 0) & (cells <= _FREE_TO)).reshape(shape).any(axis=(1, 3))
    return np.where(wall, WALL, np.where(free, FLOOR, UNKNOWN)).astype(np.uint8)


def _cells_at(grid: OccupancyGrid, x: Array, y: Array) -> NDArray[np.int8]:
    """Return occupancy (len(y), len(x)) at the crossings of lines; unknown off the grid."""
    found = np.full((len(y), len(x)), OccupancyGrid.UNKNOWN, np.int8)
    if grid.origin[2] == 0.0:
        columns = np.floor((x - grid.origin[0]) / grid.resolution_m).astype(np.int64)
        rows = np.floor((y - grid.origin[1]) / grid.resolution_m).astype(np.int64)
        on_x, on_y = (columns >= 0) & (columns < grid.width), (rows >= 0) & (rows < grid.height)
        found[np.ix_(on_y, on_x)] = grid.cells[np.ix_(rows[on_y], columns[on_x])]
        return found
    cells = grid.map_to_cell(np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))]))
    inside = grid.contains(cells)
    found.ravel()[inside] = grid.cells[cells[inside, 0], cells[inside, 1]]
    return found


def _disc(x: float, y: float, radius: float, dot_m: float) -> Array:
    """Return points (N, 2) half a dot apart that fill a disc."""
    steps = np.arange(-radius, radius + 1e-9, dot_m / 2.0)
    dx, dy = (v.ravel() for v in np.meshgrid(steps, steps))
    inside = np.hypot(dx, dy) <= radius
    return np.column_stack([np.append(x + dx[inside], x), np.append(y + dy[inside], y)])


def _set(dots: Dots, window: _Window, points: Array, what: int) -> None:
    cells = window.dots(points)
    dots[cells[:, 0], cells[:, 1]] = what
