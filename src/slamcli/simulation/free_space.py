# SPDX-License-Identifier: MIT
"""Where a robot or a person can be in a world, and ways through it, on a coarse grid."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from slamcli.errors import ConfigError, PlanningError
from slamcli.grids import OccupancyGrid
from slamcli.simulation.world import World

Array = NDArray[np.float64]

_BORDER_M = 1.0
_MAX_CELLS = 40_000_000
_MAX_PLANNING_CELLS = 400_000
_FINEST_PLANNING_M = 0.1


def rasterise(world: World, resolution_m: float) -> OccupancyGrid:
    """Return which cells a wall touches (100) or not (0), with a border of 1 m around everything there is.

    Raises
    ------
    ConfigError
        If the world needs more than 40 million cells.
    """
    x0, y0, x1, y1 = world.bounds
    x0, y0 = (math.floor((v - _BORDER_M) / resolution_m) * resolution_m for v in (x0, y0))
    width, height = (math.ceil((v + _BORDER_M) / resolution_m) for v in (x1 - x0, y1 - y0))
    if width * height > _MAX_CELLS:
        raise ConfigError(
            f"world {world.name}: {width} x {height} cells of {resolution_m:g} m are too many; choose larger cells"
        )
    grid = OccupancyGrid(np.zeros((height, width), np.int8), resolution_m, (x0, y0, 0.0))
    touched = [_touched(world, grid)]
    if world.grid is not None:
        rows, columns = np.nonzero(world.occupied_cells)
        sub = np.linspace(-0.5, 0.5, 2 * math.ceil(world.grid.resolution_m / resolution_m) + 1) * (1 - 1e-6)
        for dr in sub:
            touched.extend(world.grid.cell_to_map(np.column_stack([rows + dr, columns + dc])) for dc in sub)
    for points in touched:
        cells = grid.map_to_cell(points)
        cells = cells[grid.contains(cells)]
        grid.cells[cells[:, 0], cells[:, 1]] = OccupancyGrid.OCCUPIED
    return grid


def _touched(world: World, grid: OccupancyGrid) -> Array:
    """Return points (N, 2) in every cell that a segment or circle passes through, a tenth of a cell apart."""
    step = grid.resolution_m / 10
    points = [np.zeros((0, 2))]
    for x0, y0, x1, y1 in world.segments:
        t = np.linspace(0.0, 1.0, int(np.hypot(x1 - x0, y1 - y0) / step) + 2)
        points.append(np.column_stack([x0 + t * (x1 - x0), y0 + t * (y1 - y0)]))
    for x, y, radius in world.circles:
        angle = np.linspace(0.0, 2 * np.pi, int(2 * np.pi * radius / step) + 8)
        points.append(np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)]))
    return np.concatenate(points)


def true_map(world: World, start: Array, resolution_m: float) -> OccupancyGrid:
    """Return the map that a perfect survey from `start` (x, y) would give: walls, free cells that can be reached, unknown.

    Raises
    ------
    ConfigError
        If `start` lies in a wall.
    """
    if world.grid is not None and not len(world.segments) and not len(world.circles):
        return world.grid
    grid = rasterise(world, resolution_m)
    free = grid.cells == OccupancyGrid.FREE
    if world.grid is not None:
        rows, columns = np.indices(grid.cells.shape)
        source = world.grid.map_to_cell(grid.cell_to_map(np.column_stack([rows.ravel(), columns.ravel()])))
        inside = world.grid.contains(source)
        known = np.zeros(len(source), np.bool_)
        known[inside] = world.grid.cells[source[inside, 0], source[inside, 1]] >= 0
        free &= known.reshape(free.shape)
    areas, _ = ndimage.label(free)
    row, column = grid.map_to_cell(start)[0]
    here = areas[row, column] if grid.contains(np.array([[row, column]]))[0] else 0
    if here == 0:
        raise ConfigError(f"world {world.name}: the start {start[0]:g}, {start[1]:g} lies in a wall or outside")
    reachable = areas == here
    seen = ndimage.binary_dilation(reachable, iterations=2, structure=np.ones((3, 3)))
    cells = np.where(reachable, OccupancyGrid.FREE, OccupancyGrid.UNKNOWN)
    cells[seen & (grid.cells == OccupancyGrid.OCCUPIED)] = OccupancyGrid.OCCUPIED
    return OccupancyGrid(cells.astype(np.int8), resolution_m, grid.origin)


class FreeSpace:
    """Distance to the nearest wall on a grid, and shortest ways that keep away from walls where they can.

    Planning is on the 8-connected grid (cost: length, up to three times it close to walls), followed by taking out the
    corners that a straight line with the same clearance can skip.
    """

    def __init__(self, world: World, clearance_m: float) -> None:
        x0, y0, x1, y1 = world.bounds
        area = (x1 - x0 + 2 * _BORDER_M) * (y1 - y0 + 2 * _BORDER_M)
        resolution = max(_FINEST_PLANNING_M, math.sqrt(area / _MAX_PLANNING_CELLS))
        self.world_name, self.clearance_m = world.name, clearance_m
        self.grid = rasterise(world, resolution / 2)
        blocked = self.grid.cells == OccupancyGrid.OCCUPIED
        if world.grid is not None:
            blocked |= ~_known(world.grid, self.grid)
        blocked[0, :] = blocked[-1, :] = blocked[:, 0] = blocked[:, -1] = True
        self.distance_m: Array = ndimage.distance_transform_edt(~blocked) * self.grid.resolution_m
        self._coarse = OccupancyGrid(
            np.zeros((blocked.shape[0] // 2, blocked.shape[1] // 2), np.int8), resolution, self.grid.origin
        )
        h, w = self._coarse.cells.shape
        self._room = self.distance_m[: 2 * h, : 2 * w].reshape(h, 2, w, 2).min(axis=(1, 3))
        self._areas, _ = ndimage.label(self._room >= clearance_m, structure=np.ones((3, 3)))

    @cached_property
    def _graph(self) -> sparse.csr_matrix:
        return _graph(self._room, self.clearance_m)

    @property
    def cells(self) -> tuple[Array, NDArray[np.int32], tuple[float, float, float]]:
        """Room (H, W) in metres and connected area (H, W; 0: too narrow) of coarse cells, and x, y and size of the grid."""
        return self._room, self._areas, (*self._coarse.origin[:2], self._coarse.resolution_m)

    def room(self, points: Array) -> Array:
        """Return the distance (N,) of points (N, 2) to the nearest wall, metres (0 outside), to about a cell."""
        cells = self.grid.map_to_cell(points)
        inside = self.grid.contains(cells)
        distances = np.zeros(len(cells))
        distances[inside] = self.distance_m[cells[inside, 0], cells[inside, 1]]
        return distances

    def places(self, start: Array) -> Array:
        """Return the centres (N, 2) of all coarse cells that can be reached from `start` (2,)."""
        row, column = self.nearest(start, "the start")
        return self._coarse.cell_to_map(np.argwhere(self._areas == self._areas[row, column]))

    def roomiest(self) -> Array:
        """Return the point (2,) with the most room around it in the largest connected area."""
        sizes = np.bincount(self._areas.ravel())
        sizes[0] = 0
        if sizes.max() == 0:
            raise PlanningError(
                f"world {self.world_name}: nowhere is room for a robot that needs {self.clearance_m:g} m around it"
            )
        room = np.where(self._areas == np.argmax(sizes), self._room, 0.0)
        return self._coarse.cell_to_map(np.argwhere(room == room.max())[:1])[0]

    def is_clear(self, a: Array, b: Array, clearance_m: float | None = None) -> bool:
        """Whether the straight line from a to b keeps `clearance_m` (default: this space's) from walls."""
        steps = int(np.hypot(*(b - a)) / (self.grid.resolution_m / 2)) + 2
        line = a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a)
        return bool((self.room(line) >= (self.clearance_m if clearance_m is None else clearance_m)).all())

    def way(self, start: Array, goal: Array) -> Array:
        """Return a way (N, 2) from `start` to `goal`, both included.

        Raises
        ------
        PlanningError
            If there is none, or `start` or `goal` is in a wall; the message says where.
        """
        here, there = self.nearest(start, "the start"), self.nearest(goal, "the goal")
        width = self._coarse.width
        origin, target = here[0] * width + here[1], there[0] * width + there[1]
        if self._areas[here] != self._areas[there]:
            raise PlanningError(self._no_way(start, goal))
        before = self._predecessors(origin, target, float(np.hypot(here[0] - there[0], here[1] - there[1])))
        indices = [target]
        while indices[-1] != origin:
            indices.append(before[indices[-1]])
        cells = np.array(indices[::-1])
        inner = self._coarse.cell_to_map(np.column_stack([cells // width, cells % width]))
        return self._shortened(np.concatenate([start[None], inner, goal[None]]))

    def _predecessors(self, origin: int, target: int, straight_cells: float) -> NDArray[np.int32]:
        """Return the cell before each one on its best way from `origin`, for all cells not much farther than `target`."""
        limit = 1.2 * straight_cells + 20.0  # most ways are little longer: there is no need to search the whole world
        while True:
            _, before = csgraph.dijkstra(self._graph, indices=origin, return_predecessors=True, limit=limit)
            if target == origin or before[target] >= 0:
                return before
            limit *= 2.0

    def _shortened(self, way: Array) -> Array:
        kept, i = [0], 0
        while i < len(way) - 1:
            step = next((j for j in _ahead(i, len(way)) if self.is_clear(way[i], way[j])), i + 1)
            kept.append(step)
            i = step
        return way[kept]

    def nearest(self, point: Array, what: str) -> tuple[int, int]:
        """Return the drivable coarse cell within 0.5 m of `point` that is nearest to it."""
        row, column = self._coarse.map_to_cell(point)[0]
        reach = math.ceil(0.5 / self._coarse.resolution_m)
        low_r, low_c = max(row - reach, 0), max(column - reach, 0)
        candidates = np.argwhere(self._areas[low_r : max(row + reach + 1, 0), low_c : max(column + reach + 1, 0)] > 0)
        if not len(candidates):
            raise PlanningError(
                f"world {self.world_name}: {what} {point[0]:.2f}, {point[1]:.2f} is not within 0.5 m of a place "
                f"that keeps {self.clearance_m:.2f} m from walls (robot.radius + robot.margin)"
            )
        candidates += np.array([low_r, low_c])
        far = np.linalg.norm(self._coarse.cell_to_map(candidates) - point, axis=1)
        best = candidates[np.argmin(far)]
        return int(best[0]), int(best[1])

    def _no_way(self, start: Array, goal: Array) -> str:
        return (
            f"world {self.world_name}: no way from {start[0]:.2f}, {start[1]:.2f} to {goal[0]:.2f}, {goal[1]:.2f} "
            f"that keeps {self.clearance_m:.2f} m from walls (robot.radius + robot.margin): is a door missing or too narrow, or one of them outside?"
        )


def _ahead(i: int, count: int) -> range:
    """Return the indices to try to skip to from i, farthest first, at most 60 cells ahead."""
    return range(min(i + 60, count - 1), i + 1, -1)


def _known(source: OccupancyGrid, target: OccupancyGrid) -> NDArray[np.bool_]:
    """Return which cells of `target` have a known centre in `source`, (H, W)."""
    rows, columns = np.indices(target.cells.shape)
    cells = source.map_to_cell(target.cell_to_map(np.column_stack([rows.ravel(), columns.ravel()])))
    inside = source.contains(cells)
    known = np.zeros(len(cells), np.bool_)
    known[inside] = source.cells[cells[inside, 0], cells[inside, 1]] >= 0
    return known.reshape(target.cells.shape)


def _graph(room: Array, clearance_m: float) -> sparse.csr_matrix:
    """Return the 8-connected graph over cells with enough room; edges cost their length, more where it is narrow."""
    height, width = room.shape
    index = np.arange(height * width).reshape(height, width)
    price = 1.0 + 2.0 * np.exp(-(np.maximum(room - clearance_m, 0.0)) / 0.3)
    free = room >= clearance_m
    rows, columns, costs = [], [], []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = np.s_[: height - dr, max(-dc, 0) : width - max(dc, 0)]
        b = np.s_[dr:, max(dc, 0) : width - max(-dc, 0)]
        both = free[a] & free[b]
        rows.append(index[a][both])
        columns.append(index[b][both])
        costs.append(math.hypot(dr, dc) * (price[a][both] + price[b][both]) / 2)
    count = height * width
    one_way = sparse.csr_matrix(
        (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count)
    )
    return (one_way + one_way.T).tocsr()
