# SPDX-License-Identifier: MIT
"""The truncated signed distances of a 2D submap, Cartographer's second grid type (Daun et al., SSRR 2019).

A cell keeps its distance to the nearest surface, cut at the truncation distance, and how much observations that rests on.
Where a beam is not prolonged to free space (``update_free_space``, off in Cartographer), only a band around surfaces is
known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import _tsdf_kernels as _kernels
from slamcli.grids.growth import corner_around, growth_for, known_part
from slamcli.grids.probability_grid import ProbabilityGrid, value_of

_SURE = math.log(0.9 / 0.1)
"""Log odds of a cell that is surely occupied or free."""


@dataclass(frozen=True, slots=True, eq=False)
class TsdfGrid:
    """Signed distances to the nearest surface, positive in front of it; ``[row, column]`` as in `OccupancyGrid`."""

    tsd: NDArray[np.uint16]
    """uint16 (H, W): 0 unknown; 1 to 32767 a distance from -truncation to +truncation, linear."""
    weights: NDArray[np.uint16]
    """uint16 (H, W): 0 unknown; 1 to 32767 a weight from 0 to `max_weight`, linear."""
    resolution_m: float
    origin: tuple[float, float]
    """x, y of the lower left corner of cell (0, 0), metres, in the trajectory's local frame."""
    truncation_distance_m: float
    max_weight: float

    @classmethod
    def empty(
        cls,
        resolution_m: float,
        centre: tuple[float, float],
        truncation_distance_m: float,
        max_weight: float,
        size: int = 100,
    ) -> TsdfGrid:
        """Return an unknown grid of `size` by `size` cells around a point; its corner lies on a multiple of the resolution."""
        corner = corner_around(centre, size, resolution_m)
        cells = np.zeros((size, size), np.uint16)
        return cls(cells, cells.copy(), resolution_m, corner, truncation_distance_m, max_weight)

    @property
    def cells(self) -> NDArray[np.uint16]:
        """uint16 (H, W), what every grid of a submap has: 0 where nothing is known."""
        return self.tsd

    def distances(self) -> NDArray[np.float32]:
        """Return float32 (H, W), metres; NaN where unknown."""
        return np.where(self.tsd == 0, np.float32(np.nan), self.distance_table()[self.tsd])

    def distance_table(self) -> NDArray[np.float32]:
        """Return float32 (32768,), metres by stored value; unknown cells are as far in front of a surface as can be."""
        return _distance_table(self.truncation_distance_m)

    def with_room(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> TsdfGrid:
        """Return this grid, or a larger copy, that holds the box from `low` to `high` (2,), metres, with a margin.

        Raises
        ------
        DataError
            If it would have more than 67 million cells.
        """
        growth = growth_for(self.tsd.shape, self.origin, self.resolution_m, low, high)
        if growth is None:
            return self
        corner = growth.origin(self.origin, self.resolution_m)
        return self._part(growth.array(self.tsd), growth.array(self.weights), corner)

    def cropped(self) -> TsdfGrid:
        """Return the part that is known; a grid of one unknown cell where nothing is."""
        rows, columns, corner = known_part(self.tsd, self.origin, self.resolution_m)
        return self._part(self.tsd[rows, columns].copy(), self.weights[rows, columns].copy(), corner)

    def as_probabilities(self) -> ProbabilityGrid:
        """Return it as a grid of probabilities: occupied where the surface is nearer than half a cell, free in front of it.

        Cells behind the surface are unknown. The log odds fall with the distance up to a cell, so that the edge between
        occupied and free keeps its place when the grid is drawn turned.
        """
        distances = self.distances().astype(np.float64)
        half = 0.5 * self.resolution_m
        known = (self.weights > 1) & (distances >= -half)
        odds = _SURE * np.clip(1.0 - np.abs(distances[known]) / half, -1.0, 1.0)
        cells = np.zeros(self.tsd.shape, np.uint16)
        cells[known] = value_of(1.0 / (1.0 + np.exp(-odds)))
        return ProbabilityGrid(cells, self.resolution_m, self.origin)

    def _part(self, tsd: NDArray[np.uint16], weights: NDArray[np.uint16], origin: tuple[float, float]) -> TsdfGrid:
        return TsdfGrid(tsd, weights, self.resolution_m, origin, self.truncation_distance_m, self.max_weight)


@lru_cache(maxsize=8)
def _distance_table(truncation_m: float) -> NDArray[np.float32]:
    return np.concatenate([[truncation_m], np.linspace(-truncation_m, truncation_m, 32767)]).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class TsdfInserter:
    """Draws scans into grids of signed distances; the grid says where they are cut and what a cell weighs at most."""

    update_free_space: bool = False
    """Whether all cells of a beam are updated, or only those within the truncation distance of its end."""
    num_normal_samples: int = 4
    """Points around each one from which the surface's normal is estimated."""
    sample_radius_m: float = 0.5
    project_sdf_distance_to_scan_normal: bool = True
    """Whether distances are measured along the normal, or along the beam."""
    update_weight_range_exponent: int = 0
    """A beam weighs its range to minus this power."""
    angle_bandwidth_rad: float = 0.5
    """Of the Gaussian that weighs a beam by its angle with the normal; 0: all weigh the same."""
    distance_bandwidth_m: float = 0.5
    """Of the Gaussian that weighs a cell by its distance to the surface; 0: all weigh the same."""

    def insert(
        self,
        grid: TsdfGrid,
        pose: NDArray[np.float64],
        start: NDArray[np.float64],
        points: NDArray[np.float64],
        misses: NDArray[np.float64],  # noqa: ARG002 - as every inserter of scans
    ) -> TsdfGrid:
        """Draw one scan in place and return the grid, or the larger one that it needs.

        Points nearer than the truncation distance are left out, and misses say nothing of surfaces, as in Cartographer.

        Parameters
        ----------
        pose : float64 (3,), x, y, yaw of the tracking frame in the local frame.
        start : float64 (2,), where the beams start, tracking frame, metres.
        points : float64 (N, 2), where beams hit.
        misses : float64 (M, 2), beams without a return; not used.
        """
        truncation = grid.truncation_distance_m
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turn = np.array([[c, s], [-s, c]])
        begin, ends = start @ turn + pose[:2], points @ turn + pose[:2]
        beams = ends - begin
        order = np.argsort(np.arctan2(beams[:, 1], beams[:, 0]), kind="stable")
        ends, ranges = ends[order], np.hypot(beams[:, 0], beams[:, 1])
        box = np.concatenate([begin.reshape(1, 2), ends])
        grid = grid.with_room(box.min(axis=0) - truncation, box.max(axis=0) + truncation)
        inverse = 1.0 / grid.resolution_m
        lengths = (ranges if self.update_free_space else np.full(len(ends), truncation)) + truncation
        scratch = np.empty(int((np.ceil(lengths * inverse * 1.4143) + 4).sum()), np.int64)
        headings = _kernels.normals(ends, begin, self.num_normal_samples, self.sample_radius_m)
        _kernels.add_scan(
            grid.tsd, grid.weights, *grid.origin, inverse, begin, ends, headings, truncation, grid.max_weight,
            self.update_free_space, self.project_sdf_distance_to_scan_normal, self.update_weight_range_exponent,
            self.angle_bandwidth_rad, self.distance_bandwidth_m, scratch,
        )  # fmt: skip
        return grid


def warm() -> None:
    """Compile the kernels of this module with one beam."""
    grid = TsdfGrid.empty(0.05, (0.0, 0.0), 0.3, 10.0)
    TsdfInserter().insert(grid, np.zeros(3), np.zeros(2), np.array([[1.0, 0.5]]), np.empty((0, 2)))
