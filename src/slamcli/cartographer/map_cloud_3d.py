# SPDX-License-Identifier: MIT
"""The mapped points: one per voxel, kept in the frame of the submap in which they were seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import PointCloud
from slamcli.posegraph import Id
from slamcli.registration.voxel_filter import voxel_filter

PENDING = 8
"""Scans are thinned together with what is there in batches of so many."""
SPACING_M = 0.3
"""Scans from closer together see the same surfaces: only every so often one is taken."""


class MapCloud:
    """Collects the points of nodes by submap; memory is that of the surfaces seen, not of the scans."""

    def __init__(self, voxel_m: float) -> None:
        self._voxel_m = voxel_m
        self._kept: dict[Id, NDArray[np.float32]] = {}
        self._pending: dict[Id, list[NDArray[np.float32]]] = {}
        self._last: tuple[Id, NDArray[np.float64]] | None = None

    def add(
        self,
        submap: Id,
        T_submap_node: NDArray[np.float64],
        points_m: NDArray[np.float64],
        intensities: NDArray[np.float32],
    ) -> None:
        """Add a node's points (N, 3), base frame, and their intensities (N,), unless the last ones are from close by."""
        place = T_submap_node[:3, 3]
        if self._last is not None and self._last[0] == submap and np.linalg.norm(place - self._last[1]) < SPACING_M:
            return
        self._last = submap, place
        moved = points_m @ T_submap_node[:3, :3].T + T_submap_node[:3, 3]
        rows = np.column_stack([moved.astype(np.float32), intensities])
        pending = self._pending.setdefault(submap, [])
        pending.append(rows[voxel_filter(rows[:, :3], self._voxel_m)])
        if len(pending) >= PENDING:
            self._thin(submap)
        for older in [other for other in self._pending if other < submap]:
            self._thin(older)
            del self._pending[older]

    def _thin(self, submap: Id) -> None:
        pending = self._pending[submap]
        kept = self._kept.get(submap)
        rows = np.concatenate(pending if kept is None else [kept, *pending])
        self._kept[submap] = rows[voxel_filter(rows[:, :3], self._voxel_m)]
        pending.clear()

    def finish(self, T_map_submap: Mapping[Id, NDArray[np.float64]], stamp_ns: int, frame_id: str) -> PointCloud:
        """Return all points in the map frame at the submaps' poses, one per voxel."""
        for submap in list(self._pending):
            if self._pending[submap]:
                self._thin(submap)
        parts = [np.zeros((0, 4), dtype=np.float32)]
        for submap in sorted(self._kept):
            rows, T = self._kept[submap], T_map_submap[submap]
            moved = rows[:, :3].astype(np.float64) @ T[:3, :3].T + T[:3, 3]
            parts.append(np.column_stack([moved.astype(np.float32), rows[:, 3]]))
        points = np.concatenate(parts)
        points = points[voxel_filter(points[:, :3], self._voxel_m)]
        return PointCloud(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            points_m=np.ascontiguousarray(points[:, :3]),
            intensities=np.ascontiguousarray(points[:, 3]),
        )
