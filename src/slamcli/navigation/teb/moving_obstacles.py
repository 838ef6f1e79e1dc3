# SPDX-License-Identifier: MIT
"""What moves in a local costmap: costmap_converter's ``CostmapToDynamicObstacles`` in short."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.teb import _obstacle_kernels as kernels

Array = NDArray[np.float64]

PLUGIN = "costmap_converter::CostmapToDynamicObstacles"
"""What ``costmap_converter_plugin`` calls it."""
_LARGEST_M, _LEAST_RADIUS_M = 0.8, 0.2
_GATE_M = 0.4
_POSITION_GAIN, _SPEED_GAIN = 0.6, 0.3
_SLOWEST_M_S, _FASTEST_M_S = 0.2, 3.0
_SURE_AFTER_S, _FORGET_AFTER_S = 0.4, 1.0
_WANDERED_M = 0.15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Track:
    """A small group of obstacle cells that was seen again and again."""

    position: Array
    velocity: Array
    radius_m: float
    seen_s: float
    first_s: float
    first: Array

    def at(self, time_s: float) -> Array:
        return self.position + (time_s - self.seen_s) * self.velocity

    @property
    def is_moving(self) -> bool:
        """Whether it has gone on long and far enough to be sure."""
        speed = float(np.hypot(*self.velocity))
        wandered = float(np.hypot(*(self.position - self.first)))
        lasted = self.seen_s - self.first_s
        return (
            _SLOWEST_M_S < speed < _FASTEST_M_S
            and lasted >= _SURE_AFTER_S
            and wandered > max(_WANDERED_M, 0.4 * speed * lasted)
        )


class MovingObstacles:
    """Follows small groups of obstacle cells from costmap to costmap and tells which move how.

    Groups of up to 0.8 m that do not touch the edge of the window are matched to the nearest one of before, and filtered
    by an alpha-beta filter. The original tells foreground cells by two running means, and tracks blobs by Kalman filters.
    Walls of which more and more comes into view may seem to move; so may what is close to them not be seen to.
    """

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._obstacles = np.zeros((0, 0), dtype=np.bool_)
        self._origin_m = (0.0, 0.0)

    def observe(self, costmap: CostWindow, time_s: float) -> Array:
        """Return what moves now, float64 (D, 5): x, y, radius, vx, vy, metres and m/s, in the costmap's frame."""
        obstacles = costmap.costs == kernels.LETHAL
        if costmap.origin_m != self._origin_m or not np.array_equal(obstacles, self._obstacles):
            self._obstacles, self._origin_m = obstacles, costmap.origin_m
            self._follow(_blobs(costmap, obstacles), time_s)
        moving = [track for track in self._tracks if track.is_moving]
        return np.array([[*track.at(time_s), track.radius_m, *track.velocity] for track in moving]).reshape(-1, 5)

    def _follow(self, blobs: Array, time_s: float) -> None:
        """Take new blobs, float64 (B, 3): x, y, radius."""
        left = list(range(len(blobs)))
        kept = []
        for track in self._tracks:
            there = track.at(time_s)
            nearest = min(left, key=lambda k: float(np.hypot(*(blobs[k, :2] - there))), default=None)
            if nearest is None or np.hypot(*(blobs[nearest, :2] - there)) > _GATE_M:
                if time_s - track.seen_s <= _FORGET_AFTER_S:
                    kept.append(track)
                continue
            left.remove(nearest)
            off = blobs[nearest, :2] - there
            period = max(time_s - track.seen_s, 0.02)
            kept.append(
                replace(
                    track,
                    position=there + _POSITION_GAIN * off,
                    velocity=track.velocity + _SPEED_GAIN / period * off,
                    radius_m=float(max(blobs[nearest, 2], 0.9 * track.radius_m)),
                    seen_s=time_s,
                )
            )
        for k in left:
            x, y, radius = blobs[k]
            here = np.array([x, y])
            kept.append(
                _Track(position=here, velocity=np.zeros(2), radius_m=radius, seen_s=time_s, first_s=time_s, first=here)
            )
        self._tracks = kept


def _blobs(costmap: CostWindow, obstacles: NDArray[np.bool_]) -> Array:
    """Return the middles and radii (B, 3) of small groups of obstacle cells away from the edge."""
    labels = np.empty(obstacles.shape, dtype=np.int64)
    costs = np.where(obstacles, kernels.LETHAL, 0).astype(np.uint8)
    groups = kernels.label(costs, labels, np.empty(obstacles.size, dtype=np.int64))
    rows, columns = np.nonzero(obstacles)
    height, width = obstacles.shape
    names = labels[rows, columns] - 1
    blobs = []
    for k in range(groups):
        r, c = rows[names == k], columns[names == k]
        extent = max(np.ptp(r), np.ptp(c)) + 1
        edge = min(r.min(), c.min(), height - 1 - r.max(), width - 1 - c.max())
        if edge == 0 or extent * costmap.resolution_m > _LARGEST_M:
            continue
        x = costmap.origin_m[0] + (0.5 * (c.min() + c.max()) + 0.5) * costmap.resolution_m
        y = costmap.origin_m[1] + (0.5 * (r.min() + r.max()) + 0.5) * costmap.resolution_m
        blobs.append([x, y, max(0.5 * extent * costmap.resolution_m, _LEAST_RADIUS_M)])
    return np.array(blobs).reshape(-1, 3)
