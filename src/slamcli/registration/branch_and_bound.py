# SPDX-License-Identifier: MIT
"""The best pose of a scan in a large window on the grid of a submap (Hess et al., ICRA 2016, V-B)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.submap_grid import SubmapGrid
from slamcli.registration import _branch_kernels as _kernels
from slamcli.registration.grid_matching import angular_step, score_table

_LOW, _SPAN = 1.0 - ProbabilityGrid.MAX_COST, ProbabilityGrid.MAX_COST - ProbabilityGrid.MIN_COST


class PrecomputedGrids:
    """Maxima of a grid over windows of 1, 2, 4 ... 2^(depth - 1) cells: upper bounds of scores.

    Takes `depth` bytes a cell; make it when a submap is searched, and drop it afterwards.
    """

    def __init__(self, grid: SubmapGrid, depth: int) -> None:
        pad = (1 << (depth - 1)) - 1
        self._levels = np.empty((depth, grid.cells.shape[0] + pad, grid.cells.shape[1] + pad), np.uint8)
        self._grid = grid
        _kernels.precompute(grid.cells, byte_table(grid), self._levels)

    def search(
        self,
        points: NDArray[np.float64],
        prior: NDArray[np.float64],
        *,
        linear_m: float,
        angular_rad: float,
        min_score: float,
    ) -> tuple[NDArray[np.float64], float] | None:
        """Return the best pose (3,) within the window around the prior, and its score; None where none is over `min_score`.

        Parameters
        ----------
        points : float64 (N, 2), in the frame whose pose is sought, metres; N >= 1.
        prior : float64 (3,), x, y, yaw in the grid's frame.
        min_score : mean score (`mean_probability`), 0.1 to 0.9.
        """
        resolution = self._grid.resolution_m
        step = angular_step(resolution, float(np.hypot(points[:, 0], points[:, 1]).max()))
        half = math.ceil(linear_m / resolution)
        enough = 1
        while (1 << enough) < 2 * half + 1:
            enough += 1
        least = math.floor((min_score - _LOW) / _SPAN * 255.0 * len(points))
        score, x, y, yaw = _kernels.search(
            self._levels, min(enough, len(self._levels)), points, *self._grid.origin, 1.0 / resolution, prior, half,
            math.ceil(angular_rad / step), step, max(least, 0),
        )  # fmt: skip
        return None if score < 0.0 else (np.array([x, y, yaw]), _LOW + _SPAN * score)

    def search_everywhere(
        self, points: NDArray[np.float64], *, min_score: float
    ) -> tuple[NDArray[np.float64], float] | None:
        """Return the best pose on the whole grid at any heading, and its score; None where none is over `min_score`."""
        rows, columns = self._grid.cells.shape
        resolution = self._grid.resolution_m
        reach = float(np.hypot(points[:, 0], points[:, 1]).max())
        middle = np.array(
            [self._grid.origin[0] + 0.5 * columns * resolution, self._grid.origin[1] + 0.5 * rows * resolution, 0.0]
        )
        half = 0.5 * max(rows, columns) * resolution + reach
        return self.search(points, middle, linear_m=half, angular_rad=math.pi, min_score=min_score)


def byte_table(grid: SubmapGrid) -> NDArray[np.uint8]:
    """Return uint8 (32768,): scores 0.1 to 0.9 as 0 to 255, by stored value."""
    return np.round((score_table(grid) - _LOW) / _SPAN * 255.0).clip(0, 255).astype(np.uint8)


def warm() -> None:
    """Compile the kernels of this module with one point."""
    grid = ProbabilityGrid.empty(0.05, (0.0, 0.0), 8)
    PrecomputedGrids(grid, 2).search(np.zeros((1, 2)), np.zeros(3), linear_m=0.05, angular_rad=0.0, min_score=0.5)
