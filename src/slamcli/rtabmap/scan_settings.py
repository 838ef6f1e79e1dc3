# SPDX-License-Identifier: MIT
"""From RTAB-Map's `Icp` parameters to what alignments of scans are told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.registration.cloud_icp import CloudIcpSettings
from slamcli.registration.merged_scans import PlanarScan
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import NodeScan

_CELLS_M = (0.02, 0.2)
"""Sizes of cells at which planar scans can be aligned."""
_USUAL_CELL_M = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanSettings:
    """What aligning scans needs of the parameters."""

    icp: CloudIcpSettings
    """For clouds."""
    cell_m: float
    """For planar scans: cells of the maps they are merged into (`Icp/VoxelSize`, within 0.02 to 0.2 m)."""
    glide: bool
    """For planar scans: whether points glide along walls (`Icp/PointToPlane`) or rest on points."""
    max_translation_m: float
    max_rotation_rad: float
    correspondence_ratio: float
    min_complexity: float
    low_complexity: int
    """0: refuse, 1: correct along the sure axes, 2: accept."""
    range_min_m: float
    range_max_m: float

    @classmethod
    def of(cls, parameters: RtabmapParameters) -> ScanSettings:
        """Return the settings that parameters ask for."""
        p, reg = parameters.icp, parameters.reg
        return cls(
            icp=CloudIcpSettings(
                method="plane" if p.point_to_plane else "point", voxel_m=p.voxel_size, step=p.downsampling_step, filters=p.filters_enabled,
                max_distance_m=p.max_correspondence_distance, inlier_m=min(p.max_correspondence_distance, max(2.0 * p.voxel_size, _USUAL_CELL_M)), iterations=p.iterations, epsilon=p.epsilon,
                neighbours=p.point_to_plane_k, radius_m=p.point_to_plane_radius, trimmed=p.outlier_ratio if p.strategy == 1 else 1.0,
                reciprocal=p.reciprocal_correspondences and p.strategy == 0, level=p.force_4dof, planar=reg.force_3dof,
                min_complexity=p.point_to_plane_min_complexity,
                sure_axes_only=p.point_to_plane and p.point_to_plane_low_complexity_strategy == 1,
            ),
            cell_m=float(np.clip(p.voxel_size, *_CELLS_M)) if p.voxel_size > 0.0 else _USUAL_CELL_M, glide=p.point_to_plane,
            max_translation_m=p.max_translation, max_rotation_rad=p.max_rotation, correspondence_ratio=p.correspondence_ratio,
            min_complexity=p.point_to_plane_min_complexity if p.point_to_plane else 0.0,
            low_complexity=p.point_to_plane_low_complexity_strategy, range_min_m=p.range_min, range_max_m=p.range_max,
        )  # fmt: skip

    def planar(self, scan: NodeScan) -> PlanarScan:
        """Return a planar scan as alignments in the plane take it."""
        start = np.ascontiguousarray(scan.T_base_sensor[:2, 3], np.float64)
        points = np.ascontiguousarray(scan.points[:, :2], np.float64)[self.within(scan)]
        free = np.zeros((0, 2)) if scan.open_ends is None else scan.open_ends[:, :2].astype(np.float64)
        return PlanarScan(points=points[:: self.icp.step], start=start, free=free)

    def cloud(self, scan: NodeScan) -> NDArray[np.float64]:
        """Return the points float64 (N, 3) of a scan that are within range."""
        return scan.points[self.within(scan)].astype(np.float64)

    def within(self, scan: NodeScan) -> NDArray[np.bool_]:
        """Return bool (N,), which points of a scan lie within Icp/RangeMin and Icp/RangeMax of the sensor."""
        if self.range_min_m <= 0.0 and self.range_max_m <= 0.0:
            return np.ones(len(scan.points), np.bool_)
        distance = np.linalg.norm(scan.points - scan.T_base_sensor[:3, 3], axis=1)
        kept = distance >= self.range_min_m
        return kept & (distance <= self.range_max_m) if self.range_max_m > 0.0 else kept
