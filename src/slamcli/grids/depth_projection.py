# SPDX-License-Identifier: MIT
"""An occupancy grid of what depth cameras saw: what stands in a band of heights is in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import _depth_kernels as kernels
from slamcli.grids.occupancy import OccupancyGrid

_DIRECTIONS = 360


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthGridSettings:
    """What of the points counts."""

    resolution_m: float = 0.05
    low_m: float = 0.1
    """Height above the floor from which something is in the way."""
    high_m: float = 1.5
    """Height above the floor up to which it is."""
    reach_m: float = 5.0
    """Range up to which obstacles are believed."""
    least_share: float = 0.25
    """Of the views of a cell that must show an obstacle in it."""
    least_hits: int = 3
    """Points that must lie in a cell."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthView:
    """Points that were seen from one place."""

    points: NDArray[np.float64]
    """float64 (N, 3), metres, z up, map frame."""
    camera: NDArray[np.float64]
    """float64 (3,), where the camera was."""


def depth_grid(
    views: Sequence[DepthView], floor_m: float, settings: DepthGridSettings, frame_id: str = "map"
) -> OccupancyGrid | None:
    """Return the grid of all views; None where they show nothing.

    A cell is occupied where enough points between two heights above the floor lie in it, as against the views that look through
    it; free where views look through it to the floor or to an obstacle behind it, none being nearer in that direction; else unknown.

    Parameters
    ----------
    floor_m
        z of the floor.
    """
    if not any(len(view.points) for view in views):
        return None
    lower, upper = _extent(views, settings)
    size = np.maximum(np.ceil((upper - lower) / settings.resolution_m).astype(np.int64), 1)
    hits, misses = np.zeros((size[1], size[0]), dtype=np.int64), np.zeros((size[1], size[0]), dtype=np.int64)
    nearest, clear = np.empty(_DIRECTIONS), np.empty(_DIRECTIONS)
    seen_hits = np.zeros_like(hits)
    for view in views:
        before = hits.copy()
        kernels.draw_view(
            np.ascontiguousarray(view.points, dtype=np.float64), float(view.camera[0]), float(view.camera[1]),
            floor_m + settings.low_m, floor_m + settings.high_m, settings.reach_m, settings.resolution_m,
            float(lower[0]), float(lower[1]), hits, misses, nearest, clear,
        )  # fmt: skip
        seen_hits += hits > before
    occupied = (hits >= settings.least_hits) & (seen_hits >= settings.least_share * (seen_hits + misses))
    cells = np.full(hits.shape, OccupancyGrid.UNKNOWN, dtype=np.int8)
    cells[misses > 0] = OccupancyGrid.FREE
    cells[occupied] = OccupancyGrid.OCCUPIED
    return OccupancyGrid(cells, settings.resolution_m, (float(lower[0]), float(lower[1]), 0.0), frame_id)


def _extent(views: Sequence[DepthView], settings: DepthGridSettings) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of what the views reach, on whole cells."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for view in views:
        apart = view.points[:, :2] - view.camera[:2]
        near = view.points[(apart**2).sum(axis=1) <= settings.reach_m**2, :2]
        around = np.concatenate([near, view.camera[None, :2]])
        low, high = np.minimum(low, around.min(axis=0)), np.maximum(high, around.max(axis=0))
    margin = 2.0 * settings.resolution_m
    step = settings.resolution_m
    return np.floor((low - margin) / step) * step, np.ceil((high + margin) / step) * step


def warm() -> None:
    """Compile the kernels of this module and of `slamcli.grids.floor` on tiny input."""
    points = np.zeros((1, 3))
    cells = np.zeros((1, 1), dtype=np.int64)
    kernels.draw_view(points, 0.0, 0.0, 0.0, 1.0, 1.0, 0.1, 0.0, 0.0, cells, cells.copy(), np.empty(4), np.empty(4))
    kernels.count_near(points, points, np.zeros(1), 0.1)
