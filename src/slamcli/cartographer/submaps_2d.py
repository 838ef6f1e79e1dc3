# SPDX-License-Identifier: MIT
"""The submaps that local SLAM in the plane builds: two at a time, each from consecutive scans."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import Submaps2d
from slamcli.cartographer.range_data import RangeData
from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid


@dataclass(slots=True, eq=False)
class Submap2d:
    """A submap in the making; its pose in the local frame is where its first scan was taken, without rotation."""

    number: int
    local_pose: NDArray[np.float64]
    """float64 (3,)."""
    grid: ProbabilityGrid
    num_range_data: int = 0
    finished: bool = False
    nodes: list[int] = field(default_factory=list)
    """Numbers of the nodes that it holds."""


class ActiveSubmaps2d:
    """Two submaps that overlap by half: scans are matched with the older one and drawn into both."""

    def __init__(self, parameters: Submaps2d) -> None:
        self._parameters = parameters
        odds = parameters.range_data_inserter.probability_grid_range_data_inserter
        self._inserter = OddsInserter(
            hit_probability=odds.hit_probability,
            miss_probability=odds.miss_probability,
            insert_free_space=odds.insert_free_space,
        )
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
        resolution = self._parameters.grid_options_2d.resolution
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x = float(pose[0] + c * data.start[0] - s * data.start[1])
        y = float(pose[1] + s * data.start[0] + c * data.start[1])
        submap = Submap2d(len(self.all), np.array([x, y, 0.0]), ProbabilityGrid.empty(resolution, (x, y)))
        self.all.append(submap)
        self.active.append(submap)
