# SPDX-License-Identifier: MIT
"""The picture of a map: walls, where the robot drove, and a scale."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.grids import OccupancyGrid
from slamcli.reports import scales
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.plane import Colour, View
from slamcli.reports.figures.raster import Pixels
from slamcli.trajectory import Trajectory

_FREE = np.array([255.0, 255.0, 255.0])
_WALL = np.array([24.0, 26.0, 32.0])
UNKNOWN_COLOUR = (208, 214, 222)  # bluish, so that no occupancy between free and wall looks like it


def map_image(
    grid: OccupancyGrid,
    *,
    trajectory: Trajectory | None = None,
    truth: Trajectory | None = None,
    truth_label: str = "ground truth",
    path: NDArray[np.float64] | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    title: str = "",
    footprint_radius_m: float | None = None,
    max_pixels: int = 2000,
) -> Pixels:
    """Return the pixels of a picture of the map, north (y) up, cropped to what is known and to what is drawn on it.

    Cells are drawn as whole pixels or, where they are more than `max_pixels`, each pixel shows the most occupied of its
    cells, so that walls stay. A grid whose origin has a yaw is turned into the map frame. The picture has no date in
    it: the same input gives the same bytes.

    Parameters
    ----------
    grid
        The map; unknown cells are bluish grey, free ones white, walls black.
    trajectory
        Where the robot was, coloured by time from dark blue to orange; a disc at its start, a square at its end.
    truth
        Where it really was: a green band below the trajectory.
    truth_label
        What `truth` is called in the legend.
    path
        float64 (N, 2), metres, map frame: a planned path.
    start, goal
        x, y and perhaps yaw of the path's ends.
    title
        One line above the map.
    footprint_radius_m
        Radius of the robot: shades what it sweeps along `path`.
    max_pixels
        Most pixels of the map's longer side (margins come on top).
    """
    lines = _overlays(trajectory, truth, path, start, goal)
    view = _choose_view(grid, lines, max(16, max_pixels))
    picture = paint_cells(grid, view)
    thin = plane.line_width(picture)
    if truth is not None:
        raster.stroke(picture, view.pixels(truth.positions_m[:, :2]), scales.GREEN, thin * 2.2, opacity=0.55)
    if trajectory is not None:
        plane.draw_trajectory(picture, view.pixels(trajectory.positions_m[:, :2]), trajectory.stamps_ns, thin)
    if path is not None:
        _draw_path(picture, view, np.asarray(path, dtype=np.float64), thin, footprint_radius_m)
    for place, colour in ((start, scales.GREEN), (goal, scales.VERMILION)):
        if place is not None:
            _draw_place(picture, view, place, colour, thin, footprint_radius_m)
    return plane.framed(
        picture, view, title, _legend(trajectory, truth_label if truth is not None else "", path, start, goal)
    )


def map_png(grid: OccupancyGrid, **drawn: Any) -> bytes:
    """Return a PNG of the map; what is drawn on it as in `map_image`."""
    return raster.png(map_image(grid, **drawn))


def map_layer(grid: OccupancyGrid, points_m: NDArray[np.float64], max_pixels: int) -> tuple[Pixels, View]:
    """Return the cells alone as pixels uint8 (H, W, 3), and where they lie, to draw over.

    `points_m`, float64 (N, 2), metres, map frame, is what the view has to hold besides the known cells.
    """
    view = _choose_view(grid, points_m[np.isfinite(points_m).all(axis=1)], max_pixels)
    return paint_cells(grid, view), view


def _overlays(
    trajectory: Trajectory | None,
    truth: Trajectory | None,
    path: NDArray[np.float64] | None,
    start: ArrayLike | None,
    goal: ArrayLike | None,
) -> NDArray[np.float64]:
    """Return all finite points (N, 2), metres, map frame, that the picture has to hold."""
    parts = [t.positions_m[:, :2] for t in (trajectory, truth) if t is not None]
    parts += [np.asarray(path, dtype=np.float64).reshape(-1, 2)] if path is not None else []
    parts += [np.asarray(p, dtype=np.float64)[None, :2] for p in (start, goal) if p is not None]
    points = np.concatenate(parts) if parts else np.zeros((0, 2))
    return points[np.isfinite(points).all(axis=1)]


def _choose_view(grid: OccupancyGrid, points: NDArray[np.float64], max_pixels: int) -> View:
    """Return the view on the known cells and the points, on cell edges where the grid is not turned."""
    hold = np.concatenate([map_outline(grid), points])
    cell = grid.resolution_m
    low = np.floor((hold.min(axis=0) - grid.origin[:2]) / cell + 1e-6)
    high = np.ceil((hold.max(axis=0) - grid.origin[:2]) / cell - 1e-6)
    margin = max(1, math.ceil(0.015 * float((high - low).max())))
    low, high = low - margin, high + margin
    longest = float((high - low).max())
    if longest > max_pixels:
        cells_per_px = float(math.ceil(longest / max_pixels))
    else:
        cells_per_px = 1 / max(1, min(int(min(plane.COMFORTABLE_PX, max_pixels) // longest), plane.MOST_PX_PER_CELL))
    low = np.floor(low / cells_per_px) * cells_per_px  # pooled blocks begin where the grid's do
    size = np.maximum(np.ceil((high - low) / cells_per_px), 1).astype(np.int64)
    left, bottom = np.asarray(grid.origin[:2]) + low * cell
    return View(float(left), float(bottom), cells_per_px * cell, int(size[0]), int(size[1]))


def map_outline(grid: OccupancyGrid) -> NDArray[np.float64]:
    """Return points (N, 2), metres, map frame, whose bounding box holds every known cell (all cells if none is)."""
    known = grid.cells != OccupancyGrid.UNKNOWN
    rows = np.flatnonzero(known.any(axis=1))
    if not len(rows):
        rows, first, last = np.array([0, max(grid.height, 1) - 1]), np.zeros(2), np.full(2, max(grid.width, 1) - 1)
    else:
        first = known[rows].argmax(axis=1)
        last = grid.width - 1 - known[rows, ::-1].argmax(axis=1)
    corners = [(rows + dr, side + dc) for side, dc in ((first, -0.5), (last, 0.5)) for dr in (-0.5, 0.5)]
    return grid.cell_to_map(np.concatenate([np.column_stack(corner) for corner in corners]))


def paint_cells(grid: OccupancyGrid, view: View) -> NDArray[np.uint8]:
    """Return the map's pixels uint8 (H, W, 3): shades of grey from free to occupied, bluish where unknown."""
    pool = max(1, round(view.metres_per_px / grid.resolution_m))
    cells = _max_pool(grid.cells, pool)
    block = pool * grid.resolution_m
    x = view.left_m + (np.arange(view.width_px) + 0.5) * view.metres_per_px - grid.origin[0]
    y = view.bottom_m + (np.arange(view.height_px)[::-1] + 0.5) * view.metres_per_px - grid.origin[1]
    padded = np.full((cells.shape[0] + 1, cells.shape[1] + 1), OccupancyGrid.UNKNOWN, dtype=np.int8)
    padded[:-1, :-1] = cells  # the last row and column stand for everything outside
    if grid.origin[2] == 0.0:
        row = _index(np.floor(y / block), cells.shape[0])
        column = _index(np.floor(x / block), cells.shape[1])
        shown = padded[row][:, column]
    else:
        c, s = np.cos(grid.origin[2]), np.sin(grid.origin[2])
        row = _index(np.floor((-s * x[None, :] + c * y[:, None]) / block), cells.shape[0])
        column = _index(np.floor((c * x[None, :] + s * y[:, None]) / block), cells.shape[1])
        shown = padded[np.where(column == cells.shape[1], cells.shape[0], row), column]
        if view.metres_per_px >= grid.resolution_m:
            _keep_walls(shown, grid, view)
    return _shades()[shown.view(np.uint8)]


def _keep_walls(shown: NDArray[np.int8], grid: OccupancyGrid, view: View) -> None:
    """Put the walls back that taking the nearest cell of a turned grid would miss."""
    walls = np.argwhere(grid.cells >= 65)
    at = np.floor(view.pixels(grid.cell_to_map(walls))).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < shown.shape[1]) & (at[:, 1] < shown.shape[0])
    shown[at[inside, 1], at[inside, 0]] = grid.cells[walls[inside, 0], walls[inside, 1]]


def _index(floored: NDArray[np.float64], size: int) -> NDArray[np.int64]:
    """Return indices, `size` for what lies outside."""
    return np.where((floored >= 0) & (floored < size), floored, size).astype(np.int64)


def _max_pool(cells: NDArray[np.int8], k: int) -> NDArray[np.int8]:
    """Return the largest value of each k x k block; blocks at the far edges may be smaller."""
    if k == 1:
        return cells
    for axis in (0, 1):
        starts = np.arange(0, cells.shape[axis], k)
        if len(starts):
            cells = np.maximum.reduceat(cells, starts, axis=axis)
    return cells


def _shades() -> NDArray[np.uint8]:
    """Return the colour (256, 3) of each cell value seen as uint8."""
    value = np.arange(256).astype(np.uint8).view(np.int8).astype(np.float64)
    share = np.clip(value / OccupancyGrid.OCCUPIED, 0.0, 1.0)[:, None]
    table = np.round(_FREE + (_WALL - _FREE) * share).astype(np.uint8)
    table[value < 0] = UNKNOWN_COLOUR
    return table


def _draw_path(
    picture: NDArray[np.uint8], view: View, path: NDArray[np.float64], width: float, radius_m: float | None
) -> None:
    points = view.pixels(path)
    if radius_m:
        raster.stroke(picture, points, scales.SKY, 2 * radius_m / view.metres_per_px, opacity=0.3)
    raster.stroke(picture, points, scales.BLUE, 1.3 * width)


def _draw_place(
    picture: NDArray[np.uint8],
    view: View,
    place: ArrayLike,
    colour: Colour,
    width: float,
    radius_m: float | None,
) -> None:
    """Draw a start or goal: a disc, the robot's outline, and where it looks if that was given."""
    pose = np.asarray(place, dtype=np.float64).reshape(-1)
    centre = view.pixels(pose[:2])[0]
    mark = max(4.0, 2.6 * width)
    reach = max(2.4 * mark, (radius_m or 0.0) / view.metres_per_px)
    if radius_m:
        raster.circle(picture, centre, radius_m / view.metres_per_px, colour, max(1.0, width / 1.5))
    if len(pose) > 2 and np.isfinite(pose[2]):
        tip = centre + reach * np.array([np.cos(pose[2]), -np.sin(pose[2])])
        raster.stroke(picture, [centre, tip], colour, width)
    raster.disc(picture, centre, mark + 1.5, plane.PAGE)
    raster.disc(picture, centre, mark, colour)


def _legend(
    trajectory: Trajectory | None,
    truth_label: str,
    path: NDArray[np.float64] | None,
    start: ArrayLike | None,
    goal: ArrayLike | None,
) -> list[tuple[str, Colour | None]]:
    """Return what the lines mean: label and colour, None for the colours of time."""
    entries: list[tuple[str, Colour | None]] = []
    if trajectory is not None and len(trajectory):
        entries.append(plane.time_legend("trajectory", trajectory))
    if truth_label:
        entries.append((truth_label, scales.GREEN))
    if path is not None:
        entries.append(("path", scales.BLUE))
    entries += [
        (name, c)
        for name, at, c in (("start", start, scales.GREEN), ("goal", goal, scales.VERMILION))
        if at is not None
    ]
    return entries
