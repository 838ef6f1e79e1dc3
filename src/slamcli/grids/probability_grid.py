# SPDX-License-Identifier: MIT
"""The occupancy probabilities of a 2D submap, updated by odds (Hess et al., ICRA 2016, IV-B)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import _probability_kernels as _kernels
from slamcli.grids.growth import corner_around, growth_for, known_part


@dataclass(frozen=True, slots=True, eq=False)
class ProbabilityGrid:
    """Correspondence costs (1 - probability) of square cells; ``cells[row, column]`` as in `OccupancyGrid`."""

    cells: NDArray[np.uint16]
    """uint16 (H, W): 0 unknown; 1 to 32767 a cost from 0.1 to 0.9, linear (as Cartographer stores it)."""
    resolution_m: float
    origin: tuple[float, float]
    """x, y of the lower left corner of cell (0, 0), metres, in the trajectory's local frame."""

    MIN_COST: ClassVar[float] = 0.1
    MAX_COST: ClassVar[float] = 0.9

    @classmethod
    def empty(cls, resolution_m: float, centre: tuple[float, float], size: int = 100) -> ProbabilityGrid:
        """Return an unknown grid of `size` by `size` cells around a point; its corner lies on a multiple of the resolution."""
        return cls(np.zeros((size, size), np.uint16), resolution_m, corner_around(centre, size, resolution_m))

    def probabilities(self) -> NDArray[np.float32]:
        """Return float32 (H, W), the probability that a cell is occupied; NaN where unknown."""
        return np.where(self.cells == 0, np.float32(np.nan), np.float32(1.0) - cost_of(self.cells))

    def with_room(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> ProbabilityGrid:
        """Return this grid, or a larger copy, that holds the box from `low` to `high` (2,), metres, with a margin.

        Raises
        ------
        DataError
            If it would have more than 67 million cells.
        """
        growth = growth_for(self.cells.shape, self.origin, self.resolution_m, low, high)
        if growth is None:
            return self
        corner = growth.origin(self.origin, self.resolution_m)
        return ProbabilityGrid(growth.array(self.cells), self.resolution_m, corner)

    def cropped(self) -> ProbabilityGrid:
        """Return the part that is known; a grid of one unknown cell where nothing is."""
        rows, columns, corner = known_part(self.cells, self.origin, self.resolution_m)
        return ProbabilityGrid(self.cells[rows, columns].copy(), self.resolution_m, corner)


@dataclass(frozen=True, slots=True, kw_only=True)
class OddsInserter:
    """Draws scans into probability grids, with the update of equation 3 of the paper."""

    hit_probability: float = 0.55
    miss_probability: float = 0.49
    insert_free_space: bool = True

    def insert(
        self,
        grid: ProbabilityGrid,
        pose: NDArray[np.float64],
        start: NDArray[np.float64],
        points: NDArray[np.float64],
        misses: NDArray[np.float64],
    ) -> ProbabilityGrid:
        """Draw one scan in place and return the grid, or the larger one that it needs.

        Parameters
        ----------
        pose : float64 (3,), x, y, yaw of the tracking frame in the local frame.
        start : float64 (2,), where the beams start, tracking frame, metres.
        points : float64 (N, 2), where beams hit.
        misses : float64 (M, 2), how far beams without a return are known to be free.
        """
        c, s = np.cos(pose[2]), np.sin(pose[2])
        everything = np.concatenate([start.reshape(1, 2), points, misses]) @ np.array([[c, s], [-s, c]]) + pose[:2]
        grid = grid.with_room(everything.min(axis=0), everything.max(axis=0))
        inverse = 1.0 / grid.resolution_m
        scratch = np.empty(_kernels.scratch_size(start, points, misses, inverse), np.int64)
        _kernels.add_scan(
            grid.cells, *grid.origin, inverse, start, points, misses, pose,
            odds_table(self.hit_probability), odds_table(self.miss_probability), self.insert_free_space, scratch,
        )  # fmt: skip
        return grid


def cost_of(values: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return the correspondence costs float32 of stored values; meaningless where they are 0."""
    scale = (ProbabilityGrid.MAX_COST - ProbabilityGrid.MIN_COST) / 32766.0
    return (values.astype(np.float32) - np.float32(1.0)) * np.float32(scale) + np.float32(ProbabilityGrid.MIN_COST)


def value_of(probability: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return the stored values uint16 of probabilities, clamped to 0.1 ... 0.9."""
    low, high = ProbabilityGrid.MIN_COST, ProbabilityGrid.MAX_COST
    cost = np.clip(1.0 - probability, low, high)
    return (np.round((cost - low) * (32766.0 / (high - low))) + 1.0).astype(np.uint16)


@lru_cache(maxsize=16)
def odds_table(probability: float) -> NDArray[np.uint16]:
    """Return uint16 (32768,): the stored value after an observation of that probability, by the stored value before."""
    values = np.arange(32768, dtype=np.uint16)
    before = 1.0 - cost_of(values).astype(np.float64)
    odds = before / (1.0 - before) * (probability / (1.0 - probability))
    odds[0] = probability / (1.0 - probability)  # unknown: the observation alone
    table = value_of(odds / (1.0 + odds))
    table.flags.writeable = False
    return table


def warm() -> None:
    """Compile the kernels of this module with one beam."""
    grid = ProbabilityGrid.empty(0.05, (0.0, 0.0))
    OddsInserter().insert(grid, np.zeros(3), np.zeros(2), np.array([[1.0, 0.5]]), np.array([[0.5, 1.0]]))
