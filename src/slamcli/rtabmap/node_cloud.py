# SPDX-License-Identifier: MIT
"""One cloud of what all nodes saw, thinned while it grows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.voxel_means import VoxelMeans
from slamcli.measurements import PointCloud
from slamcli.rtabmap.local_grid import BOTH, DEPTH, SCAN, LocalGridSettings
from slamcli.rtabmap.node_points import colours_at, depth_points, moved, within_range
from slamcli.rtabmap.signature import NodeImages, NodeScan

_GREY = 128
"""What no camera saw, in a cloud that has colours."""


class NodeCloud:
    """Points of depth images, and of scans that are not planar, in the colours of the images; memory grows with the place alone."""

    def __init__(self, settings: LocalGridSettings) -> None:
        self._settings = settings
        self._coloured, self._plain = VoxelMeans(settings.cell_size_m), VoxelMeans(settings.cell_size_m)

    def add(self, images: NodeImages | None, scan: NodeScan | None, T_map_base: NDArray[np.float64]) -> None:
        """Add what a node at `T_map_base` (4, 4) saw, as far as its sensor is asked for."""
        settings = self._settings
        if settings.sensor in (DEPTH, BOTH) and images is not None and images.depth is not None:
            seen = depth_points(images, settings.depth, settings.range_min_m, settings.range_max_m)
            if seen is not None:
                self._coloured.add(moved(seen.points, T_map_base), seen.colours)
        if settings.sensor in (SCAN, BOTH) and scan is not None and not scan.planar:
            view = scan.T_base_sensor[:3, 3]
            points = scan.points[:: max(settings.scan_decimation, 1)].astype(np.float64)
            points = within_range(points, view, settings.range_min_m, settings.range_max_m)
            colours, known = np.zeros((len(points), 3), dtype=np.uint8), np.zeros(len(points), dtype=np.bool_)
            if images is not None:
                colours, known = colours_at(points, images)
            placed = moved(points, T_map_base)
            self._coloured.add(placed[known], colours[known])
            self._plain.add(placed[~known], colours[~known])

    def cloud(self, frame_id: str, stamp_ns: int) -> PointCloud | None:
        """Return the mean of each cell; without colours where no camera saw anything, None where there are no points."""
        points, colours = self._coloured.means()
        others, _ = self._plain.means()
        if len(points) + len(others) == 0:
            return None
        if len(points) == 0:
            return PointCloud(stamp_ns=stamp_ns, frame_id=frame_id, points_m=others)
        others = others[~_in_cells_of(others, points, self._settings.cell_size_m)]
        colours = np.concatenate([colours, np.full((len(others), 3), _GREY, dtype=np.uint8)])
        return PointCloud(
            stamp_ns=stamp_ns, frame_id=frame_id, points_m=np.concatenate([points, others]), colours=colours
        )


def _in_cells_of(points: NDArray[np.float32], others: NDArray[np.float32], size_m: float) -> NDArray[np.bool_]:
    """Return which points (N, 3) lie in cells that hold one of others (M, 3)."""
    cells = np.floor(np.concatenate([points, others]).astype(np.float64) / size_m).astype(np.int64)
    _, numbers = np.unique(cells, axis=0, return_inverse=True)
    found: NDArray[np.bool_] = np.isin(numbers.ravel()[: len(points)], numbers.ravel()[len(points) :])
    return found
