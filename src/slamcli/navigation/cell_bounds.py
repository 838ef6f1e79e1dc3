# SPDX-License-Identifier: MIT
"""Where a costmap lies, and boxes of its cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Cell = TypeVar("Cell", bound=np.generic)


class CellBounds(NamedTuple):
    """A box of cells; the ends are excluded. Empty if it has no row."""

    first_row: int
    last_row: int
    first_column: int
    last_column: int

    @property
    def empty(self) -> bool:
        """Whether it holds no cell."""
        return self.first_row >= self.last_row

    @property
    def rows(self) -> slice:
        """The rows as an index."""
        return slice(self.first_row, max(self.first_row, self.last_row))

    @property
    def columns(self) -> slice:
        """The columns as an index."""
        return slice(self.first_column, max(self.first_column, self.last_column))


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """A grid without rotation: rows grow with y, columns with x."""

    corner: NDArray[np.float64]
    """float64 (2,): x, y of the lower left corner of cell (0, 0), metres."""
    resolution_m: float
    height: int
    width: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    def nothing(self) -> NDArray[np.int64]:
        """Return int64 (4,), a box that kernels grow: no cell yet."""
        return np.array([self.height, 0, self.width, 0], dtype=np.int64)

    def everything(self) -> NDArray[np.int64]:
        """Return int64 (4,), the box of all cells."""
        return np.array([0, self.height, 0, self.width], dtype=np.int64)

    def moved(self, rows: int, columns: int) -> Extent:
        """Return the extent moved by whole cells."""
        step = np.array([columns, rows], dtype=np.float64)
        return Extent(self.corner + step * self.resolution_m, self.resolution_m, self.height, self.width)

    def steps_to_centre(self, x: float, y: float) -> tuple[int, int]:
        """Return by how many whole rows and columns to move for a point to be in the middle, as costmap_2d does.

        It takes the window for half a cell shorter than it is, and cuts towards zero.
        """
        step_x = (x - (self.width - 0.5) * self.resolution_m / 2.0 - self.corner[0]) / self.resolution_m
        step_y = (y - (self.height - 0.5) * self.resolution_m / 2.0 - self.corner[1]) / self.resolution_m
        return math.trunc(step_y), math.trunc(step_x)

    def offset_from(self, other: Extent) -> tuple[int, int] | None:
        """Return the row and column of this extent's first cell in `other`, to the nearest cell; None for other resolutions."""
        if not math.isclose(self.resolution_m, other.resolution_m, rel_tol=1e-6):
            return None
        columns, rows = np.rint((self.corner - other.corner) / self.resolution_m).astype(np.int64)
        return int(rows), int(columns)


def shifted(cells: NDArray[Cell], rows: int, columns: int, shape: tuple[int, int], default: int) -> NDArray[Cell]:
    """Return an array of `shape`, whose cell (0, 0) is cell (`rows`, `columns`) of `cells`; `default` where that has none."""
    moved = np.full(shape, default, dtype=cells.dtype)
    height, width = cells.shape
    r0, r1 = max(0, rows), min(height, rows + shape[0])
    c0, c1 = max(0, columns), min(width, columns + shape[1])
    if r0 < r1 and c0 < c1:
        moved[r0 - rows : r1 - rows, c0 - columns : c1 - columns] = cells[r0:r1, c0:c1]
    return moved
