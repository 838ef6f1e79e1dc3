# SPDX-License-Identifier: MIT
"""Where a path on a live costmap begins and where it may end."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import INSCRIBED, LETHAL, NO_INFORMATION
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.footprint_check import outline
from slamcli.navigation.search_space import Cell, SearchGrid

_HAIR = 1e-9
"""Cells by which a point may miss a cell's lower edge through rounding and still lie in it."""
_SIDES = ((0, -1), (0, 1), (-1, 0), (1, 0))


@dataclass(frozen=True, slots=True, eq=False)
class LiveEndpoint:
    """A point that a path begins or ends at."""

    cell: Cell
    point_rc: NDArray[np.float64]
    """float64 (2,), row and column with centres at whole numbers, within the cell by a hair."""
    point_m: tuple[float, float]


def locate(window: CostWindow, point: Sequence[float], role: str) -> LiveEndpoint:
    """Return the endpoint at a point of the window's frame.

    Raises
    ------
    NoPathError
        If it lies outside the window.
    """
    column = (float(point[0]) - window.origin_m[0]) / window.resolution_m
    row = (float(point[1]) - window.origin_m[1]) / window.resolution_m
    if not (math.isfinite(row) and math.isfinite(column)):
        raise NoPathError(f"{role} {show(point)} is not finite", f"{role}_outside", None, math.inf)
    cell = (math.floor(row + _HAIR), math.floor(column + _HAIR))
    height, width = window.costs.shape
    if not (0 <= cell[0] < height and 0 <= cell[1] < width):
        x0, y0 = window.origin_m
        x1, y1 = x0 + width * window.resolution_m, y0 + height * window.resolution_m
        message = f"{role} {show(point)} is outside the costmap ({x0:g} to {x1:g}, {y0:g} to {y1:g} m)"
        raise NoPathError(message, f"{role}_outside", None, math.inf)
    inside = [min(max(v - k, _HAIR), 1.0 - _HAIR) + k - 0.5 for v, k in zip((row, column), cell, strict=True)]
    return LiveEndpoint(cell, np.array(inside), (float(point[0]), float(point[1])))


def free_start(grid: SearchGrid, window: CostWindow, start: Cell) -> list[tuple[Cell, int]] | None:
    """Make the start's cell free in `grid`, and the shortest way out where it stands too near to an obstacle.

    The way out leads over at most the inscribed radius of cells that are within the inscribed radius of an obstacle, never
    over the obstacle itself: noise, or a person who came close, must not pin the robot down; what the robot really can
    do is for the local planner to check. The original clears one cell only and fails where that does not suffice.

    Returns
    -------
    The cells that were changed, with their values before, to be put back; None if there is no way out.
    """
    levels = grid.levels
    changed = [(start, int(levels[start[0] + 1, start[1] + 1]))]
    was_blocked = bool(grid.blocked[changed[0][1]])
    levels[start[0] + 1, start[1] + 1] = 0
    if not was_blocked:
        return changed
    reach = window.inscribed_radius_m / window.resolution_m + 1.0
    came_from: dict[Cell, Cell] = {start: start}
    queue = deque([start])
    while queue:
        cell = queue.popleft()
        for dr, dc in _SIDES:
            following = (cell[0] + dr, cell[1] + dc)
            if following in came_from or math.dist(following, start) > reach:
                continue
            value = int(levels[following[0] + 1, following[1] + 1])
            if value == LETHAL or (value == NO_INFORMATION and grid.blocked[value]):
                continue
            came_from[following] = cell
            if not grid.blocked[value]:
                return changed + _opened(levels, came_from, cell, start)
            queue.append(following)
    levels[start[0] + 1, start[1] + 1] = changed[0][1]
    return None


def free_outline(grid: SearchGrid, window: CostWindow, start: Sequence[float], cell: Cell) -> list[tuple[Cell, int]]:
    """Make room in `grid` for the outline of a robot that stands at `start`; for planners that look at the outline.

    The robot is there, so what its padded outline touches does not block it. Cells around it within the inscribed radius of an
    obstacle may be crossed at the greatest cost, because the way out that a car can drive is not the shortest, and its
    outline is looked at on the way.

    Returns
    -------
    The cells that were changed, with their values before, to be put back last one first.
    """
    levels, resolution = grid.levels, window.resolution_m
    x, y, yaw = start[0], start[1], start[2] if len(start) > 2 else 0.0
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    points = (outline(window) @ turn + np.array([x, y]) - np.array(window.origin_m)) / resolution
    touched = [(math.floor(row), math.floor(column)) for column, row in points]
    opened = [(at, LETHAL) for at in dict.fromkeys(touched)]
    reach = math.ceil(window.inscribed_radius_m / resolution + 1.0)
    span = range(-reach, reach + 1)
    opened += [((cell[0] + dr, cell[1] + dc), INSCRIBED) for dr in span for dc in span if math.hypot(dr, dc) <= reach]
    height, width = window.costs.shape
    changed = []
    for (row, column), value in opened:
        if 0 <= row < height and 0 <= column < width and levels[row + 1, column + 1] == value:
            changed.append(((row, column), value))
            levels[row + 1, column + 1] = INSCRIBED - 1
    return changed


def _opened(levels: NDArray[np.uint8], came_from: dict[Cell, Cell], cell: Cell, start: Cell) -> list[tuple[Cell, int]]:
    """Give the cells of the way out the greatest cost that may be crossed, and return them with their values before."""
    changed = []
    while cell != start:
        changed.append((cell, int(levels[cell[0] + 1, cell[1] + 1])))
        levels[cell[0] + 1, cell[1] + 1] = INSCRIBED - 1
        cell = came_from[cell]
    return changed


def goal_candidates(
    grid: SearchGrid, window: CostWindow, goal: Sequence[float], tolerance_m: float
) -> Iterator[LiveEndpoint]:
    """Yield free points where a path may end, best first: the goal itself, then navfn's lattice around it."""
    yield from _usable(grid, window, goal)
    step = window.resolution_m
    if tolerance_m <= 0.0:
        return
    offsets = np.arange(-tolerance_m, tolerance_m + step * 1e-6, step)
    dy, dx = (lattice.ravel() for lattice in np.meshgrid(offsets, offsets, indexing="ij"))
    for k in np.argsort(dx * dx + dy * dy, kind="stable"):
        yield from _usable(grid, window, (goal[0] + dx[k], goal[1] + dy[k]))


def surrounding_candidates(
    grid: SearchGrid, window: CostWindow, goal: Sequence[float], tolerance_m: float
) -> Iterator[LiveEndpoint]:
    """Yield the free points that move_base's make_plan tries around a goal, in its order."""
    for dx, dy in surrounding_offsets(window.resolution_m, tolerance_m):
        yield from _usable(grid, window, (goal[0] + dx, goal[1] + dy))


def _usable(grid: SearchGrid, window: CostWindow, point: Sequence[float]) -> Iterator[LiveEndpoint]:
    try:
        candidate = locate(window, point, "goal")
    except NoPathError:
        return
    if not grid.blocked[grid.levels[candidate.cell[0] + 1, candidate.cell[1] + 1]]:
        yield candidate


def goal_failure(
    grid: SearchGrid, window: CostWindow, start: Sequence[float], goal: Sequence[float], why: str = ""
) -> NoPathError:
    """Return the error for a goal that no path leads to; `why` adds what the planner said."""
    try:
        target = locate(window, goal, "goal")
    except NoPathError as outside:
        return outside
    if grid.blocked[grid.levels[target.cell[0] + 1, target.cell[1] + 1]]:
        return _blocked("goal", window, goal, target.cell)
    message = f"goal {show(goal)} cannot be reached from the start {show(start)}{f': {why}' if why else ''}"
    return NoPathError(message, "unreachable", None, math.inf)


def surrounding_offsets(resolution_m: float, tolerance_m: float) -> Iterator[tuple[float, float]]:
    """Yield the offsets (x, y) in metres that move_base's make_plan tries around a goal, in its order."""
    step = min(3.0 * resolution_m, tolerance_m)
    rings = math.floor(tolerance_m / step + 1e-9)
    for ring in range(1, rings + 1):
        for j in range(ring + 1):
            for i in range(ring + 1):
                if max(i, j) < ring:
                    continue
                for y in (-j, j) if j else (0,):
                    for x in (-i, i) if i else (0,):
                        yield x * step, y * step


def start_blocked(window: CostWindow, start: Sequence[float], cell: Cell) -> NoPathError:
    """Return the error for a start without a way out."""
    return _blocked("start", window, start, cell)


def show(point: Sequence[float]) -> str:
    """Return a point as messages have it."""
    return f"{float(point[0]):.3f},{float(point[1]):.3f}"


def _blocked(role: str, window: CostWindow, point: Sequence[float], cell: Cell) -> NoPathError:
    value = int(window.costs[cell])
    if value == LETHAL:
        why = "is in an obstacle"
    elif value == NO_INFORMATION:
        why = "is in unknown space, and allow_unknown is off"
    else:
        why = f"is within the robot's inscribed radius ({window.inscribed_radius_m:.3f} m) of an obstacle"
    return NoPathError(f"{role} {show(point)} {why}", f"{role}_blocked", None, math.inf)
