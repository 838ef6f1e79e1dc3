# SPDX-License-Identifier: MIT
"""Whether the robot's outline touches an obstacle of a live costmap: costmap_2d's ``footprintCost`` for many poses at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow

Array = NDArray[np.float64]
_LETHAL = 254
_STEP_CELLS = 0.5


def outline(window: CostWindow) -> Array:
    """Return points (M, 2), metres, base frame, along the robot's outline, half a cell apart or less."""
    corners = window.footprint
    ends = np.roll(corners, -1, axis=0)
    step = _STEP_CELLS * window.resolution_m
    pieces = [
        a + np.arange(count)[:, None] / count * (b - a)
        for a, b in zip(corners, ends, strict=True)
        for count in [max(int(np.ceil(np.hypot(*(b - a)) / step)), 1)]
    ]
    return np.concatenate(pieces)


def is_blocked(window: CostWindow, poses: Array) -> NDArray[np.bool_]:
    """Return bool (N,): whether the outline at poses (N, 3), in the window's frame, touches a lethal cell or leaves the window.

    Unknown cells (255) do not block.
    """
    points = outline(window)
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x = poses[:, :1] + c * points[:, 0] - s * points[:, 1]
    y = poses[:, 1:2] + s * points[:, 0] + c * points[:, 1]
    columns = np.floor((x - window.origin_m[0]) / window.resolution_m).astype(np.int64)
    rows = np.floor((y - window.origin_m[1]) / window.resolution_m).astype(np.int64)
    height, width = window.costs.shape
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    costs = window.costs[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    blocked: NDArray[np.bool_] = (~inside | (costs == _LETHAL)).any(axis=1)
    return blocked
