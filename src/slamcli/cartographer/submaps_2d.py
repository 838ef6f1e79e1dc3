# SPDX-License-Identifier: MIT
"""The submaps that local SLAM in the plane builds: two at a time, each from consecutive scans."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import Submaps2d
from slamcli.cartographer.range_data import RangeData
from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid
from slamcli.grids.submap_grid import SubmapGrid
from slamcli.grids.tsdf_grid import TsdfGrid, TsdfInserter


@dataclass(slots=True, eq=False)
class Submap2d:
    """A submap in the making; its pose in the local frame is where its first scan was taken, without rotation."""

    number: int
    local_pose: NDArray[np.float64]
    """float64 (3,)."""
    grid: SubmapGrid
    num_range_data: int = 0
    finished: bool = False
    nodes: list[int] = field(default_factory=list)
    """Numbers of the nodes that it holds."""


class ActiveSubmaps2d:
    """Two submaps that overlap by half: scans are matched with the older one and drawn into both."""

    def __init__(self, parameters: Submaps2d) -> None:
        self._parameters = parameters
        self._inserter: Any = _inserter(parameters)  # draws into the grids that `_empty_grid` makes
        self.all: list[Submap2d] = []
        self.active: list[Submap2d] = []

    @property
    def matching(self) -> Submap2d | None:
        """The submap that scans are matched with; None before the first scan."""
        return self.active[0] if self.active else None

    def insert(self, node: int, pose: NDArray[np.float64], data: RangeData) -> list[Submap2d]:
        """Draw a scan into the active submaps and return them; a new one begins when the newer is half full."""
        limit = self._parameters.num_range_data
        if not self.active or self.active[-1].num_range_data == limit:
            self._begin(pose, data)
        for submap in self.active:
            submap.grid = self._inserter.insert(submap.grid, pose, data.start, data.returns, data.misses)
            submap.num_range_data += 1
            submap.nodes.append(node)
        inserted = list(self.active)
        if self.active[0].num_range_data == 2 * limit:
            self.finish(self.active[0])
        return inserted

    def finish(self, submap: Submap2d) -> None:
        """Crop the grid to what is known; nothing is drawn into it any more."""
        submap.grid, submap.finished = submap.grid.cropped(), True

    def _begin(self, pose: NDArray[np.float64], data: RangeData) -> None:
        if len(self.active) > 1:
            self.active.pop(0)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x = float(pose[0] + c * data.start[0] - s * data.start[1])
        y = float(pose[1] + s * data.start[0] + c * data.start[1])
        submap = Submap2d(len(self.all), np.array([x, y, 0.0]), _empty_grid(self._parameters, (x, y)))
        self.all.append(submap)
        self.active.append(submap)


def note_of(parameters: Submaps2d) -> str:
    """Return what to know of a map from such submaps; empty for nothing."""
    options = parameters.range_data_inserter.tsdf_range_data_inserter
    if parameters.grid_options_2d.grid_type != "TSDF" or options.update_free_space:
        return ""
    return (
        f"grid_type TSDF: free space is known within {options.truncation_distance:g} m of surfaces only; for whole beams --set "
        "TRAJECTORY_BUILDER_2D.submaps.range_data_inserter.tsdf_range_data_inserter.update_free_space=true"
    )


def _empty_grid(parameters: Submaps2d, centre: tuple[float, float]) -> SubmapGrid:
    options = parameters.grid_options_2d
    if options.grid_type == "PROBABILITY_GRID":
        return ProbabilityGrid.empty(options.resolution, centre)
    distances = parameters.range_data_inserter.tsdf_range_data_inserter
    return TsdfGrid.empty(options.resolution, centre, distances.truncation_distance, distances.maximum_weight)


def _inserter(parameters: Submaps2d) -> OddsInserter | TsdfInserter:
    if parameters.grid_options_2d.grid_type == "PROBABILITY_GRID":
        odds = parameters.range_data_inserter.probability_grid_range_data_inserter
        return OddsInserter(
            hit_probability=odds.hit_probability,
            miss_probability=odds.miss_probability,
            insert_free_space=odds.insert_free_space,
        )
    distances = parameters.range_data_inserter.tsdf_range_data_inserter
    return TsdfInserter(
        update_free_space=distances.update_free_space,
        num_normal_samples=distances.normal_estimation_options.num_normal_samples,
        sample_radius_m=distances.normal_estimation_options.sample_radius,
        project_sdf_distance_to_scan_normal=distances.project_sdf_distance_to_scan_normal,
        update_weight_range_exponent=distances.update_weight_range_exponent,
        angle_bandwidth_rad=distances.update_weight_angle_scan_normal_to_ray_kernel_bandwidth,
        distance_bandwidth_m=distances.update_weight_distance_cell_to_hit_kernel_bandwidth,
    )
