# SPDX-License-Identifier: MIT
"""Obstacles of a timed elastic band: points for its clearance, one point of each group for its homotopy class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.teb import _obstacle_kernels as kernels
from slamcli.navigation.teb.robot_outline import polygon

Array = NDArray[np.float64]
_MAX_GROUPS = 60
_ROOM_REACH_M = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObstacleField:
    """What is in the way at one moment, in the costmap's frame."""

    costmap: CostWindow
    points: Array
    """float64 (M, 2): centres of obstacle cells that border on other cells."""
    group_points: Array
    """float64 (G, 2): of each group of cells that the robot cannot pass between, a point in the middle of it."""
    group_of: NDArray[np.int64]
    """int64 (M,): the group of each point, its place in `group_points`; -1: of none of them."""
    discs: Array
    """float64 (D, 5): x, y, radius, vx, vy of what moves."""

    def collision(self, poses: Array, step_rad: float) -> int:
        """Return the first of poses (N, 3) at or after which the footprint meets an obstacle; -1 if there is none.

        Between poses the footprint is checked where these are more than the inscribed radius or `step_rad` apart.
        """
        window = self.costmap
        return kernels.first_collision(
            window.costs,
            *window.origin_m,
            window.resolution_m,
            window.footprint,
            np.ascontiguousarray(poses),
            max(window.inscribed_radius_m, window.resolution_m),
            step_rad,
        )

    def room_m(self, path: Array, *, to_goal: bool = False) -> float:
        """Return how far the robot stays from both sides, at least, if it follows a path in the middle; inf in the open.

        With `to_goal` no more than what it has from any side at the path's last pose, float64 (N, 3), where it must go.
        """
        room = kernels.least_room(
            np.ascontiguousarray(path), self.points, self.costmap.inscribed_radius_m, _ROOM_REACH_M
        )
        return float(min(room, self.clearance_m(path[-1:])[0]) if to_goal else room)

    def clearance_m(self, poses: Array) -> Array:
        """Return the distance of the costmap's footprint, at poses (N, 3), to the nearest obstacle point, negative inside."""
        values = np.empty(len(poses))
        outline = polygon(self.costmap.footprint)
        kernels.clearances(outline.segments, True, np.ascontiguousarray(poses), self.points, values)
        return values

    def is_blocked(self, path: Array) -> bool:
        """Whether the robot's centre cannot go along a path, float64 (N, 2 or 3); more is forgiven near its ends."""
        window = self.costmap
        lenient = window.circumscribed_radius_m + 2.0 * window.resolution_m
        return bool(
            kernels.way_is_blocked(
                window.costs, *window.origin_m, window.resolution_m, np.ascontiguousarray(path), lenient
            )
        )

    def is_visible(self, a: Array, b: Array) -> bool:
        """Whether the robot's centre can go straight from a to b, float64 (2,) each."""
        window = self.costmap
        return kernels.line_is_free(
            window.costs, *window.origin_m, window.resolution_m, a[0], a[1], b[0], b[1], kernels.INSCRIBED
        )


def obstacle_field(
    costmap: CostWindow,
    robot: Array,
    *,
    behind_m: float,
    use_cells: bool = True,
    discs: Array | None = None,
) -> ObstacleField:
    """Return the obstacles of a costmap.

    Parameters
    ----------
    robot
        float64 (3,), pose; cells farther than `behind_m` behind it do not count.
    use_cells
        Whether cells count at all.
    discs
        float64 (D, 5): what is known to move; cells under it are taken to be it and do not count.
    """
    moving = np.zeros((0, 5)) if discs is None else np.ascontiguousarray(discs, dtype=np.float64)
    points, labels = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    if use_cells:
        points, labels = _cells(costmap)
        ahead = (points - robot[:2]) @ np.array([np.cos(robot[2]), np.sin(robot[2])])
        keep = (ahead >= 0.0) | (((points - robot[:2]) ** 2).sum(axis=1) <= behind_m * behind_m)
        for x, y, radius, *_ in moving:
            keep &= np.hypot(points[:, 0] - x, points[:, 1] - y) > radius + 2.0 * costmap.resolution_m
        points, labels = points[keep], labels[keep]
    middle, group_of = _groups(points, labels)
    return ObstacleField(costmap=costmap, points=points, group_points=middle, group_of=group_of, discs=moving)


def _cells(costmap: CostWindow) -> tuple[Array, NDArray[np.int64]]:
    """Return the centres of obstacle cells at the edge of what is occupied, and which group each belongs to."""
    costs = costmap.costs
    cells = np.empty(costs.size, dtype=np.int64)
    cells = cells[: kernels.surface_cells(costs, cells)]
    labels = np.empty(costs.shape, dtype=np.int64)
    kernels.label(costs, labels, np.empty(costs.size, dtype=np.int64))
    rows, columns = np.divmod(cells, costs.shape[1])
    x = costmap.origin_m[0] + (columns + 0.5) * costmap.resolution_m
    y = costmap.origin_m[1] + (rows + 0.5) * costmap.resolution_m
    return np.column_stack([x, y]), labels.reshape(-1)[cells]


def _groups(points: Array, labels: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Return of the largest groups the point nearest to the middle of each, and to which of them points belong."""
    if not len(points):
        return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    names, group_of, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    middles = np.column_stack([np.bincount(group_of, weights=points[:, k]) for k in range(2)]) / sizes[:, None]
    squared = ((points - middles[group_of]) ** 2).sum(axis=1)
    order = np.lexsort((squared, group_of))
    nearest = order[np.searchsorted(group_of[order], np.arange(len(names)))]
    largest = np.sort(np.argsort(-sizes, kind="stable")[:_MAX_GROUPS])
    place = np.full(len(names), -1, dtype=np.int64)
    place[largest] = np.arange(len(largest))
    return np.ascontiguousarray(points[nearest[largest]]), place[group_of]


def sample_costmap() -> CostWindow:
    """Return a small window with one obstacle cell, to compile kernels on."""
    costs = np.zeros((8, 8), dtype=np.uint8)
    costs[4, 5] = kernels.LETHAL
    corners = 0.1 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    return CostWindow(
        costs=costs,
        origin_m=(0.0, 0.0),
        resolution_m=0.1,
        frame="odom",
        footprint=corners,
        inscribed_radius_m=0.1,
        circumscribed_radius_m=0.15,
    )


def warm() -> None:
    """Compile the kernels of this module."""
    field = obstacle_field(sample_costmap(), np.zeros(3), behind_m=1.0)
    field.collision(np.zeros((2, 3)), 1.0)
    field.room_m(np.zeros((2, 3)))
    field.clearance_m(np.zeros((1, 3)))
    field.is_blocked(np.zeros((2, 3)))
    field.is_blocked(np.zeros((2, 2)))
    field.is_visible(np.zeros(2), np.ones(2))
