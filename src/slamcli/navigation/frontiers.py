# SPDX-License-Identifier: MIT
"""Frontiers between what is known and free and what is unknown (Yamauchi, CIRA 1997), with the costs of explore_lite."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.navigation import _frontier_kernels as kernels
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.explore_parameters import ExploreParameters

_LETHAL = 254
_OCCUPIED_FROM = 65
"""Least value of a map's cell that is an obstacle, as map_server has it."""
_NEAREST_M = 1.0
"""So far from the robot a cell is looked for where it could stand, if it stands in none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frontier:
    """Unknown cells that hold together and border on free ones; metres, in the frame of the costs."""

    cells: NDArray[np.int64]
    """int64 (N, 2), row and column."""
    points: NDArray[np.float64]
    """float64 (N, 2), their centres."""
    centroid: NDArray[np.float64]
    """float64 (2,), mean of the cells."""
    middle: NDArray[np.float64]
    """float64 (2,), the cell nearest to the robot in a straight line."""
    initial: NDArray[np.float64]
    """float64 (2,), the cell with the shortest way."""
    goal: NDArray[np.float64]
    """float64 (3,), where to drive: x, y, and the heading towards the frontier."""
    length_m: float
    """Number of cells times the size of a cell."""
    distance_m: float
    """From the robot to `middle`."""
    way_m: float
    """From the robot to the reached cell nearest to `initial`, over cells where it fits, in steps to eight sides."""
    gain_m: float
    """What is to be seen there, see `ExploreParameters.gain`."""
    cost: float


class FrontierSearch:
    """Finds the frontiers that can be reached; room for the search is kept from call to call.

    From the robot a wave runs over cells up to ``through_cost``. Frontier cells are unknown cells beside cells that it
    reached, or beside cells tied to those where only the robot does not fit (``look_in``). The cost is that of explore_lite,
    ``potential_scale * distance * resolution - gain_scale * cells * resolution``.
    """

    def __init__(self, parameters: ExploreParameters) -> None:
        self._parameters = parameters
        self._costs = np.full((0, 0), _LETHAL, np.uint8)
        self._resize((0, 0))

    def find(
        self,
        costs: NDArray[np.uint8],
        origin_m: tuple[float, float],
        resolution_m: float,
        pose: NDArray[np.float64],
    ) -> tuple[Frontier, ...]:
        """Return the frontiers, the cheapest first.

        Parameters
        ----------
        costs
            uint8 (H, W): 255 unknown, 254 obstacle, 253 where the robot does not fit, below what it may cross; see
            `costs_for_exploring` and `costs_of_map`.
        origin_m, resolution_m
            Lower left corner, x and y, and size of a cell, metres.
        pose
            float64 (3,), of the robot, in the frame of the costs.

        Returns
        -------
        Frontiers of at least ``min_frontier_size``; none where the robot is farther than a metre from any cell it fits in.
        """
        p = self._parameters
        start = _start_cell(costs, origin_m, resolution_m, pose, p.through_cost)
        if start is None:
            return ()
        if costs.shape != (self._costs.shape[0] - 2, self._costs.shape[1] - 2):
            self._resize(costs.shape)
        self._costs[1:-1, 1:-1] = costs
        flat, width = self._costs.ravel(), self._costs.shape[1]
        first, room = (start[0] + 1) * width + start[1] + 1, self._room
        span = kernels.wave(flat, width, first, p.through_cost, self._reach, room)
        if p.look_in:
            span = kernels.look_in(flat, width, *span, self._reach, room[0])
        cells, near, firsts = room[:3]
        count = kernels.groups(flat, width, *span, self._reach, cells, near, firsts)
        view = _View(self._costs, np.array(origin_m) - resolution_m, resolution_m, pose, p, self._reach, self._seen)
        found: list[Frontier] = []
        self._seen[:] = 0
        for first, end in zip(firsts[:count].tolist(), firsts[1 : count + 1].tolist(), strict=True):
            if (end - first) * resolution_m >= p.min_frontier_size:
                found.append(view.frontier(cells[first:end], near[first:end], len(found) + 1))
        return tuple(sorted(found, key=lambda frontier: frontier.cost))

    def _resize(self, shape: tuple[int, ...]) -> None:
        """Make room for costs of a shape, with an obstacle all around."""
        self._costs = np.full((shape[0] + 2, shape[1] + 2), _LETHAL, np.uint8)
        self._reach = np.empty(self._costs.size, np.int64)
        self._room = np.empty((8, self._costs.size), np.int64)
        self._seen = np.zeros(self._costs.size if self._parameters.gain == "visible" else 0, np.int64)


def costs_for_exploring(window: CostWindow, grid: OccupancyGrid) -> NDArray[np.uint8]:
    """Return the costs of a global costmap with all that is unknown on the map as unknown, uint8 (H, W).

    A costmap need not track what is unknown, and inflates walls into it: then it is known that the robot does not fit
    there, and not what is there. Obstacles that the costmap has and the map has not stay.

    Parameters
    ----------
    window
        Of the global costmap, in the frame of the map.
    grid
        The map so far; it may lie differently and have other cells. Outside of it nothing is known.
    """
    height, width = window.costs.shape
    x = window.origin_m[0] + (np.arange(width) + 0.5) * window.resolution_m
    y = window.origin_m[1] + (np.arange(height) + 0.5) * window.resolution_m
    if (
        abs(math.sin(grid.origin[2])) * (height + width) < 0.1 and math.cos(grid.origin[2]) > 0.0
    ):  # within a tenth of a cell
        rows = np.floor((y - grid.origin[1]) / grid.resolution_m).astype(np.int64)
        columns = np.floor((x - grid.origin[0]) / grid.resolution_m).astype(np.int64)
        row, column = np.meshgrid(rows, columns, indexing="ij", sparse=True)
    else:
        cells = grid.map_to_cell(np.column_stack([np.tile(x, height), np.repeat(y, width)]))
        row, column = cells[:, 0].reshape(height, width), cells[:, 1].reshape(height, width)
    inside = (row >= 0) & (row < grid.height) & (column >= 0) & (column < grid.width)
    known = inside & (grid.cells[row.clip(0, grid.height - 1), column.clip(0, grid.width - 1)] >= 0)
    return np.where(known | (window.costs == _LETHAL), window.costs, np.uint8(255))


def costs_of_map(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """Return the cells of a map as costs without inflation, uint8 (H, W): free, obstacle or unknown."""
    costs = np.zeros(grid.cells.shape, np.uint8)
    costs[grid.cells >= _OCCUPIED_FROM] = 254
    costs[grid.cells < 0] = 255
    return costs


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Costs with an obstacle all around, and what the wave left."""

    costs: NDArray[np.uint8]
    origin: NDArray[np.float64]
    resolution_m: float
    pose: NDArray[np.float64]
    parameters: ExploreParameters
    length: NDArray[np.int64]
    seen: NDArray[np.int64]

    def frontier(self, cells: NDArray[np.int64], near: NDArray[np.int64], number: int) -> Frontier:
        """Return the record of one group of cells (N,), with the nearest reached cell of each (N,)."""
        p, points = self.parameters, self._points(cells)
        apart = np.hypot(*(points - self.pose[:2]).T)
        closest, first = int(np.argmin(apart)), int(np.argmin(self.length[near]))
        named = {"centroid": points.mean(axis=0), "middle": points[closest], "initial": points[first]}
        goal = self._goal(named["centroid"], cells, near)
        distance_m = float(apart[closest])
        way_m = float(self.length[near[first]]) * self.resolution_m / kernels.STRAIGHT
        gain_m = len(cells) * self.resolution_m if p.gain == "size" else self._visible_m(goal, number)
        travel = way_m if p.distance == "way" else distance_m
        return Frontier(
            cells=np.column_stack(np.divmod(cells, self.costs.shape[1])) - 1, points=points, **named,
            goal=np.append(goal, self._heading(goal, named["centroid"])), length_m=len(cells) * self.resolution_m,
            distance_m=distance_m, way_m=way_m, gain_m=gain_m,
            cost=p.potential_scale * travel * self.resolution_m - p.gain_scale * gain_m,
        )  # fmt: skip

    def _goal(
        self, centroid: NDArray[np.float64], cells: NDArray[np.int64], near: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return where to drive, (2,): not to where the robot is already, if the frontier reaches farther."""
        p = self.parameters
        far = np.hypot(*(self._points(near) - self.pose[:2]).T) >= p.goal_distance
        if far.any():
            cells, near = cells[far], near[far]
        points = self._points(cells)
        goal = centroid
        if p.goal_point == "middle":
            goal = points[int(np.argmin(np.hypot(*(points - self.pose[:2]).T)))]
        elif p.goal_point == "initial":
            goal = points[int(np.argmin(self.length[near]))]
        return self._beside(goal, points, near) if p.snap_goal else goal

    def _beside(
        self, point: NDArray[np.float64], points: NDArray[np.float64], near: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the centre (2,) of a reached cell: that of the frontier cell nearest to a point, rather not beside a wall."""
        dearness = self.costs.ravel()[near] / 252.0
        far_m = np.hypot(*(points - point).T) + self.parameters.goal_clearance * dearness
        return self._points(near[[int(np.argmin(far_m))]])[0]

    def _points(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the centres (N, 2) of cells (N,)."""
        rows, columns = np.divmod(cells, self.costs.shape[1])
        return self.origin + (np.column_stack([columns, rows]) + 0.5) * self.resolution_m

    def _heading(self, goal: NDArray[np.float64], centroid: NDArray[np.float64]) -> float:
        """Return the direction from the goal to the frontier; where it lies around the goal, that in which the robot comes."""
        dx, dy = centroid - goal
        if math.hypot(dx, dy) < self.resolution_m:
            dx, dy = goal - self.pose[:2]
        return math.atan2(dy, dx)

    def _visible_m(self, goal: NDArray[np.float64], number: int) -> float:
        range_cells = self.parameters.gain_range / self.resolution_m
        column, row = ((goal - self.origin) / self.resolution_m).astype(np.int64).tolist()
        width, rays = self.costs.shape[1], math.ceil(2.0 * math.pi * range_cells)
        count = kernels.visible_unknown(
            self.costs.ravel(), width, row * width + column, range_cells, rays, self.seen, number
        )
        return float(count) / range_cells * self.resolution_m


def _start_cell(
    costs: NDArray[np.uint8],
    origin_m: tuple[float, float],
    resolution_m: float,
    pose: NDArray[np.float64],
    through: int,
) -> tuple[int, int] | None:
    """Return row and column of the cell nearest to the robot where it fits; None if there is none within a metre."""
    x, y = (np.asarray(pose[:2]) - np.array(origin_m)) / resolution_m
    reach = math.ceil(_NEAREST_M / resolution_m)
    top, left = max(math.floor(y) - reach, 0), max(math.floor(x) - reach, 0)
    part = costs[top : max(math.floor(y) + reach + 1, 0), left : max(math.floor(x) + reach + 1, 0)]
    rows, columns = np.nonzero(part <= through)
    if not len(rows):
        return None
    squares = (rows + top + 0.5 - y) ** 2 + (columns + left + 0.5 - x) ** 2
    k = int(np.argmin(squares))
    return int(rows[k]) + top, int(columns[k]) + left


def warm() -> None:
    """Compile the kernels."""
    costs = np.zeros((3, 16), np.uint8)
    costs[:, 8:] = 255
    FrontierSearch(ExploreParameters(gain="visible")).find(costs, (0.0, 0.0), 1.0, np.array([1.5, 1.5, 0.0]))
