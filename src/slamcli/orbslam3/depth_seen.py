# SPDX-License-Identifier: MIT
"""What the depth images of a run show: points for the floor, and the occupancy grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.grids import OccupancyGrid
from slamcli.grids.depth_projection import DepthView, depth_grid
from slamcli.grids.upright import Upright
from slamcli.orbslam3.frame_making import FrameMaker
from slamcli.orbslam3.frame_track import TrackedFrame

_SAMPLE_VIEWS, _SAMPLE_POINTS = 20, 20000
_LEAST_SPACING_NS = 200_000_000
"""Views closer in time show the same."""


class DepthSeen:
    """The depths that tracked frames kept.

    Parameters
    ----------
    tracked
        Frames, with their poses in `T_camera_start` (N, 4, 4).
    """

    def __init__(self, maker: FrameMaker, tracked: Sequence[TrackedFrame], T_camera_start: NDArray[np.float64]) -> None:
        self._camera, self._pixels = maker.camera, maker.depth_pixels
        self.settings = maker.grid_settings
        self._views: list[tuple[NDArray[np.float16], NDArray[np.float64]]] = []
        last_ns = None
        for frame, T_camera in zip(tracked, T_camera_start, strict=True):
            if frame.depth is not None and (last_ns is None or frame.stamp_ns - last_ns >= _LEAST_SPACING_NS):
                self._views.append((frame.depth, se3.inverse(T_camera)))
                last_ns = frame.stamp_ns

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self._views)

    def sample(self) -> NDArray[np.float64]:
        """Return some points (N, 3) of some views, metres, in the frame of the first camera."""
        step = max(1, len(self._views) // _SAMPLE_VIEWS)
        points = np.concatenate([self._points(*view)[0] for view in self._views[::step]])
        return points[:: max(1, len(points) // _SAMPLE_POINTS)]

    def grid(self, placed: Upright, map_frame: str) -> OccupancyGrid | None:
        """Return the occupancy grid; None without depth.

        Without a floor, heights are those above the lowest hundredth of what was seen.
        """
        views = []
        for view in self._views:
            points, camera = self._points(*view)
            T = placed.T_map_start
            views.append(DepthView(points=points @ T[:3, :3].T + T[:3, 3], camera=T[:3, :3] @ camera + T[:3, 3]))
        if not views:
            return None
        floor_m = placed.floor_m
        if floor_m is None:
            heights = np.concatenate([view.points[::7, 2] for view in views])
            floor_m = float(np.quantile(heights, 0.01)) if len(heights) else 0.0
        return depth_grid(views, floor_m, self.settings, map_frame)

    def _points(
        self, depth: NDArray[np.float16], T_start_camera: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the points of a view and its camera, in the frame of the first camera."""
        metres = depth.astype(np.float64)
        with np.errstate(invalid="ignore"):
            rows = np.flatnonzero((metres > 0) & (metres < 1e3) & np.isfinite(self._pixels[:, 0]))
        points = self._camera.back_project(self._pixels[rows], metres[rows])
        return points @ T_start_camera[:3, :3].T + T_start_camera[:3, 3], T_start_camera[:3, 3]
