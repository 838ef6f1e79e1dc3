# SPDX-License-Identifier: MIT
"""The walls of a world as arrays that kernels run through quickly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.distance import squared_distance
from slamcli.simulation.world import World

Array = NDArray[np.float64]

_FARTHEST_JUMP = 254
_FEW = 24  # shapes that are tried one after the other
_FINEST_CELL_M = 0.5
_MOST_CELLS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Everything that stands still."""

    field: NDArray[np.uint8]
    """uint8 (H, W): 0 in wall cells, else 1 + whole cells around (any point of) the cell within which there is no wall."""
    frame: Array
    """float64 (5,): x, y, cos and sin of the grid's lower left corner, and metres per cell."""
    segments: Array
    """float64 (S, 4)."""
    circles: Array
    """float64 (C, 3)."""
    shapes: Array
    """float64 (S + C, 7): both as rounded boxes x, y, cos, sin, half length, half width, radius."""
    starts: NDArray[np.int64]
    """int64 (R * C + 1,): cell k of a coarse grid holds the shapes members[starts[k] : starts[k + 1]]."""
    members: NDArray[np.int64]
    """int64 (M,): indices into `shapes`; empty where there are too few shapes to sort them."""
    layout: Array
    """float64 (5,): x, y of that grid's corner, its cell size, columns and rows."""


def build_walls(world: World, *, unknown_is_wall: bool = False) -> Walls:
    """Return the walls of `world`; cells that nobody knows count as walls if `unknown_is_wall`."""
    segments, circles = np.ascontiguousarray(world.segments), np.ascontiguousarray(world.circles)
    field, frame = np.zeros((0, 0), np.uint8), np.array([0.0, 0.0, 1.0, 0.0, 1.0])
    if world.grid is not None:
        occupied = world.occupied_cells.astype(np.bool_)
        if unknown_is_wall:
            occupied = occupied | (world.grid.cells < 0)
        field = free_field(occupied)
        x, y, yaw = world.grid.origin
        frame = np.array([x, y, math.cos(yaw), math.sin(yaw), world.grid.resolution_m])
    shapes = np.concatenate([_boxes(segments), _discs(circles)])
    return Walls(field, frame, segments, circles, shapes, *_sorted(shapes))


def free_field(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return uint8 (H, W): 0 where occupied, else 1 + cells (at most 254) around any point of the cell that are free.

    Two points of two cells are up to 1.415 cells nearer to each other than their centres.
    """
    squared = squared_distance(occupied)
    far = np.sqrt(np.where(squared < 0, np.inf, squared))
    field = 1 + np.clip(np.floor(far - 1.5), 0, _FARTHEST_JUMP)
    field[occupied] = 0
    return field.astype(np.uint8)


def _sorted(shapes: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Return starts, members and layout of a coarse grid that knows which shapes (N, 7) may stand in which cell."""
    if len(shapes) < _FEW:
        return np.zeros(1, np.int64), np.zeros(0, np.int64), np.zeros(5)
    half = np.column_stack([np.abs(shapes[:, 2]), np.abs(shapes[:, 3])]) * shapes[:, 4:5] + shapes[:, 6:7]
    low, high = (shapes[:, :2] - half).min(axis=0) - 0.1, (shapes[:, :2] + half).max(axis=0) + 0.1
    size = max(_FINEST_CELL_M, math.sqrt(float(np.prod(high - low)) / _MOST_CELLS))
    columns, rows = (math.ceil(v) for v in (high - low) / size)
    slack = size * math.sqrt(0.5) + 1e-6  # a cell's corner is so far from its centre
    cells, owners = [], []
    for i, (x, y, c, s, length, _, radius) in enumerate(shapes):
        first = np.maximum(((shapes[i, :2] - half[i] - low - 1e-6) // size).astype(np.int64), 0)
        last = np.minimum(((shapes[i, :2] + half[i] - low + 1e-6) // size).astype(np.int64), [columns - 1, rows - 1])
        column, row = np.meshgrid(np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1))
        dx, dy = low[0] + (column + 0.5) * size - x, low[1] + (row + 0.5) * size - y
        ahead = np.maximum(np.abs(c * dx + s * dy) - length, 0.0)
        near = np.hypot(ahead, c * dy - s * dx) <= radius + slack
        cells.append((row * columns + column)[near])
        owners.append(np.full(len(cells[-1]), i))
    cell, owner = np.concatenate(cells), np.concatenate(owners)
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], np.arange(rows * columns + 1)).astype(np.int64)
    return starts, owner[order].astype(np.int64), np.array([*low, size, columns, rows])


def _boxes(segments: Array) -> Array:
    way = segments[:, 2:] - segments[:, :2]
    length = np.hypot(way[:, 0], way[:, 1])
    ahead = np.where(length[:, None] > 0, way / np.maximum(length, 1e-300)[:, None], [1.0, 0.0])
    boxes = np.zeros((len(segments), 7))
    boxes[:, :2] = (segments[:, :2] + segments[:, 2:]) / 2
    boxes[:, 2:4], boxes[:, 4] = ahead, length / 2
    return boxes


def _discs(circles: Array) -> Array:
    boxes = np.zeros((len(circles), 7))
    boxes[:, :2], boxes[:, 2], boxes[:, 6] = circles[:, :2], 1.0, circles[:, 2]
    return boxes
