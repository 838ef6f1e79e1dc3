# SPDX-License-Identifier: MIT
"""The part of the global plan that a timed elastic band is laid along."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.plan_window import LocalPlan
from slamcli.navigation.teb.parameters import TrajectoryParameters

Array = NDArray[np.float64]
_WINDOW_SHARE = 0.85
"""How far to the edge of the costmap a band goes, so that obstacles beyond its end are seen; the original's figure."""
_HEADING_M = 0.3
_BEYOND_M = 1.0
_INSCRIBED, _UNKNOWN = 253, 255


def trimmed(plan: LocalPlan, robot: Array, costmap: CostWindow, rules: TrajectoryParameters) -> tuple[Array, bool]:
    """Return the plan from the robot's pose to as far as it is looked at, float64 (N, 3), N >= 2, and whether that is the goal.

    The last pose is headed as the plan goes on from there, unless it is the goal.
    """
    nearest = int(((plan.poses[:, :2] - robot[:2]) ** 2).sum(axis=1).argmin())
    ahead = plan.poses[nearest:]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ahead[:, :2], axis=0).T))])
    reach = 0.5 * _WINDOW_SHARE * max(costmap.costs.shape) * costmap.resolution_m
    beyond = np.hypot(ahead[:, 0] - robot[0], ahead[:, 1] - robot[1]) > reach
    if rules.max_global_plan_lookahead_dist > 0.0:
        beyond |= along > rules.max_global_plan_lookahead_dist
    end = max(1, int(np.argmax(beyond)) if beyond.any() else len(ahead))
    end = _free_end(ahead, end, costmap)
    reaches_goal = plan.reaches_goal and end == len(ahead)
    path = np.vstack([robot, ahead[1:end]]) if end > 1 else np.vstack([robot, ahead[:1]])
    if not reaches_goal and rules.global_plan_overwrite_orientation:
        ahead_of_end = min(int(np.searchsorted(along, along[end - 1] + _HEADING_M)), len(ahead) - 1)
        step = ahead[ahead_of_end, :2] - ahead[end - 1, :2]
        if np.hypot(*step) > 0.0:
            path[-1, 2] = np.arctan2(step[1], step[0])
    if reaches_goal:
        path[-1] = plan.goal
    path[:, 2] = se2.wrap_angle(path[:, 2])
    return path, reaches_goal


def _free_end(ahead: Array, end: int, costmap: CostWindow) -> int:
    """Return where to end instead if an obstacle is there: beyond it if it is small, otherwise before it."""
    columns = np.floor((ahead[:, 0] - costmap.origin_m[0]) / costmap.resolution_m).astype(np.int64)
    rows = np.floor((ahead[:, 1] - costmap.origin_m[1]) / costmap.resolution_m).astype(np.int64)
    height, width = costmap.costs.shape
    inside = (rows >= 0) & (columns >= 0) & (rows < height) & (columns < width)
    costs = costmap.costs[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    free = inside & ((costs < _INSCRIBED) | (costs == _UNKNOWN))
    if free[end - 1]:
        return end
    beyond = np.flatnonzero(free[end:])
    along = np.hypot(*np.diff(ahead[end - 1 :, :2], axis=0).T).cumsum()
    if len(beyond) and along[beyond[0]] <= _BEYOND_M:
        return end + int(beyond[0]) + 1
    before = np.flatnonzero(free[:end])
    return int(before[-1]) + 1 if len(before) and before[-1] > 0 else end


def spaced(path: Array, separation_m: float) -> Array:
    """Return points (V, 2) of a path, each at least so far from the one before; none for a negative distance."""
    if separation_m <= 0.0:
        return np.zeros((0, 2))
    points, last = [], path[0, :2]
    for point in path[1:, :2]:
        if np.hypot(*(point - last)) >= separation_m:
            points.append(point)
            last = point
    return np.array(points).reshape(-1, 2)
