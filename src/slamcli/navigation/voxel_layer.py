# SPDX-License-Identifier: MIT
"""The voxel layer of costmap_2d: an obstacle layer that knows at which height something was seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _voxel_layer_kernels as kernels
from slamcli.navigation.cell_bounds import Extent, shifted
from slamcli.navigation.costmap import FREE
from slamcli.navigation.layered_parameters import LayerParameters
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_layer import Box, ObstacleLayer
from slamcli.navigation.obstacle_parameters import ObservationSource

_NOTHING_KNOWN = 0xFFFF
_BITS = 16


class VoxelLayer(ObstacleLayer):
    """Up to 16 voxels on each other over every cell; a beam clears only those that it crosses.

    A cell is an obstacle when more than `mark_threshold` of its voxels are marked. When a beam crosses one and no more than that are
    left, it is free, or unknown while more than `unknown_threshold` of its voxels are.
    """

    def __init__(self, layer: LayerParameters, extent: Extent, default: int) -> None:
        super().__init__(layer, extent, default)
        self.voxels: NDArray[np.uint32] = np.full(extent.shape, _NOTHING_KNOWN, dtype=np.uint32)
        # costmap_2d counts the bits above the highest voxel as unknown, too.
        self._unknown_threshold = self.parameters.unknown_threshold + _BITS - self.parameters.z_voxels

    def place(self, extent: Extent) -> None:
        """Move to another extent; what lies on both is kept where the resolution is the same."""
        offset = extent.offset_from(self.extent)
        if offset is None:
            self.voxels = np.full(extent.shape, _NOTHING_KNOWN, dtype=np.uint32)
        else:
            self.voxels = shifted(self.voxels, *offset, extent.shape, _NOTHING_KNOWN)
        super().place(extent)

    def forget(self, cells: NDArray[np.bool_]) -> None:
        """Forget what is known of the cells that are true in `cells`, bool (H, W), at every height."""
        super().forget(cells)
        self.voxels[cells] = _NOTHING_KNOWN

    def _clear(self, observation: Observation, ranges: tuple[float, float], touched: Box) -> None:
        least, most = ranges
        for ends in (observation.points, observation.clear_points):
            kernels.clear_voxel_beams(
                self.voxels, self.costs, observation.origin, ends, self._corner(), self._sizes(), self.parameters.z_voxels,
                most, least, self.parameters.max_obstacle_height, self._unknown_threshold, self.parameters.mark_threshold,
                touched,
            )  # fmt: skip

    def _mark(self, observation: Observation, ranges: tuple[float, float], touched: Box) -> None:
        least, most = ranges
        kernels.mark_voxels(
            self.voxels, self.costs, observation.origin, observation.points, self._corner(), self._sizes(),
            self.parameters.z_voxels, most, least, self.parameters.min_obstacle_height, self.parameters.max_obstacle_height,
            self.parameters.mark_threshold, touched,
        )  # fmt: skip

    def _corner(self) -> NDArray[np.float64]:
        return np.append(self.extent.corner, self.parameters.origin_z)

    def _sizes(self) -> NDArray[np.float64]:
        return np.array([self.extent.resolution_m, self.parameters.z_resolution])


def warm() -> None:
    """Compile the kernels of this module."""
    source = ObservationSource(clearing=True)
    layer = VoxelLayer(
        LayerParameters(name="voxels", kind="voxel", sources=(source,)), Extent(np.zeros(2), 0.1, 4, 4), FREE
    )
    points = np.array([[0.3, 0.3, 0.5]])
    layer.observe(
        Observation(source=source.name, time_s=0.0, origin=np.full(3, 0.1), points=points, clear_points=points)
    )
    layer.update(np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]), np.array([0.3, 0.3, 0.0]), layer.extent.nothing())
