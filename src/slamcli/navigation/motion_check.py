# SPDX-License-Identifier: MIT
"""Whether a motion of the robot's outline hits something on a costmap."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _dwa_kernels as kernels
from slamcli.navigation.cost_window import CostWindow


def is_round(costmap: CostWindow) -> bool:
    """Whether the robot's radii differ by at most a cell, so that turning in place sweeps nothing new."""
    return costmap.circumscribed_radius_m - costmap.inscribed_radius_m <= costmap.resolution_m


def arc(pose: NDArray[np.float64], twist: NDArray[np.float64], seconds: float, step_m: float) -> NDArray[np.float64]:
    """Return poses (N, 3), N >= 2, that a constant twist (3,) leads through, `step_m` or a tenth of a radian apart at most."""
    way = math.hypot(twist[0], twist[1]) * seconds
    count = max(math.ceil(max(way / step_m, abs(twist[2]) * seconds / 0.1)), 1)
    times = np.arange(count + 1) * (seconds / count)
    yaw = pose[2] + twist[2] * times
    if abs(twist[2]) < 1e-9:
        along, across = times * math.cos(pose[2]), times * math.sin(pose[2])
    else:
        along = (np.sin(yaw) - math.sin(pose[2])) / twist[2]
        across = (math.cos(pose[2]) - np.cos(yaw)) / twist[2]
    x = pose[0] + twist[0] * along - twist[1] * across
    y = pose[1] + twist[0] * across + twist[1] * along
    return np.column_stack([x, y, yaw])


def hits(costmap: CostWindow, poses: NDArray[np.float64], *, escape: bool = False, margin_m: float = 0.0) -> bool:
    """Whether the outline at any of poses (N, 3) touches an obstacle, an unknown cell or the costmap's border.

    With `escape` poses from the first on may touch an obstacle as long as none is nearer to it than the one before, and
    the last is free or a fifth of a cell farther away. The outline is taken `margin_m` farther out.
    """
    radius = costmap.circumscribed_radius_m
    points = np.empty((len(poses), 5))
    points[:, :3] = poses
    points[:, 3], points[:, 4] = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = costmap.origin_m
    everywhere = max(costmap.costs.shape)
    cost = kernels.obstacle_cost(
        points,
        len(points),
        costmap.costs,
        costmap.costs,
        everywhere,
        costmap.footprint,
        1.0 + margin_m / radius if radius > 0.0 else 1.0,
        x,
        y,
        costmap.resolution_m,
        False,
        escape,
        np.inf,
    )
    return bool(cost < 0.0)


def warm() -> None:
    """Compile the kernels of this module."""
    costmap = CostWindow(
        costs=np.zeros((9, 9), dtype=np.uint8),
        origin_m=(0.0, 0.0),
        resolution_m=0.1,
        frame="odom",
        footprint=np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1]]),
        inscribed_radius_m=0.0,
        circumscribed_radius_m=0.15,
    )
    hits(costmap, arc(np.array([0.4, 0.4, 0.0]), np.array([0.1, 0.0, 0.0]), 1.0, 0.05))
