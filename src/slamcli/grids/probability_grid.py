# SPDX-License-Identifier: MIT
"""The occupancy probabilities of a 2D submap, updated by odds (Hess et al., ICRA 2016, IV-B)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.grids import _probability_kernels as _kernels

_MAX_CELLS = 1 << 26
"""A submap of 410 x 410 m at 5 cm: a larger one comes from broken ranges or odometry."""
_MARGIN_CELLS = 64


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
        corner = [(round(value / resolution_m) - size // 2) * resolution_m for value in centre]
        return cls(np.zeros((size, size), np.uint16), resolution_m, (corner[0], corner[1]))

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
        rows, columns = self.cells.shape
        a = np.floor((low - self.origin) / self.resolution_m).astype(np.int64) - 1
        b = np.ceil((high - self.origin) / self.resolution_m).astype(np.int64) + 1
        if a.min() >= 0 and b[0] < columns and b[1] < rows:
            return self
        left, below = (-min(int(v) - _MARGIN_CELLS, 0) if v < 0 else 0 for v in a)
        right = max(int(b[0]) + _MARGIN_CELLS - columns, 0) if b[0] >= columns else 0
        above = max(int(b[1]) + _MARGIN_CELLS - rows, 0) if b[1] >= rows else 0
        height, width = rows + below + above, columns + left + right
        if height * width > _MAX_CELLS:
            raise DataError(
                f"a submap would grow to {width * self.resolution_m:.0f} x {height * self.resolution_m:.0f} m: the ranges are broken, or "
                f"TRAJECTORY_BUILDER_2D.submaps.grid_options_2d.resolution={self.resolution_m:g} is too small"
            )
        cells = np.zeros((height, width), np.uint16)
        cells[below : below + rows, left : left + columns] = self.cells
        corner = (self.origin[0] - left * self.resolution_m, self.origin[1] - below * self.resolution_m)
        return ProbabilityGrid(cells, self.resolution_m, corner)

    def cropped(self) -> ProbabilityGrid:
        """Return the part that is known; a grid of one unknown cell where nothing is."""
        rows, columns = np.flatnonzero(self.cells.any(axis=1)), np.flatnonzero(self.cells.any(axis=0))
        if len(rows) == 0:
            return ProbabilityGrid(np.zeros((1, 1), np.uint16), self.resolution_m, self.origin)
        part = self.cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].copy()
        corner = (self.origin[0] + columns[0] * self.resolution_m, self.origin[1] + rows[0] * self.resolution_m)
        return ProbabilityGrid(part, self.resolution_m, (float(corner[0]), float(corner[1])))


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
