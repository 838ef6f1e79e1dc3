# SPDX-License-Identifier: MIT
"""Room for new scans in the arrays of a submap, and the part of them that is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError

Origin = tuple[float, float]
Cells = TypeVar("Cells", bound=np.generic)

_MAX_CELLS = 1 << 26
"""A submap of 410 x 410 m at 5 cm: a larger one comes from broken ranges or odometry."""
_MARGIN_CELLS = 64


@dataclass(frozen=True, slots=True)
class Growth:
    """How many cells a grid grows by on each side."""

    left: int
    right: int
    below: int
    above: int

    def array(self, cells: NDArray[Cells]) -> NDArray[Cells]:
        """Return a larger copy of an array (H, W), zero where it is new."""
        return np.pad(cells, ((self.below, self.above), (self.left, self.right)))

    def origin(self, origin: Origin, resolution_m: float) -> Origin:
        """Return the corner of the larger grid."""
        return origin[0] - self.left * resolution_m, origin[1] - self.below * resolution_m


def growth_for(
    shape: tuple[int, ...], origin: Origin, resolution_m: float, low: NDArray[np.float64], high: NDArray[np.float64]
) -> Growth | None:
    """Return by how much a grid must grow to hold the box from `low` to `high` (2,), metres, with a cell around; None for not at all.

    It grows by more than is needed, so that it rarely does.

    Raises
    ------
    DataError
        If it would have more than 67 million cells.
    """
    rows, columns = shape
    a = np.floor((low - origin) / resolution_m).astype(np.int64) - 1
    b = np.ceil((high - origin) / resolution_m).astype(np.int64) + 1
    if a.min() >= 0 and b[0] < columns and b[1] < rows:
        return None
    left, below = (_MARGIN_CELLS - int(v) if v < 0 else 0 for v in a)
    right = int(b[0]) + _MARGIN_CELLS - columns if b[0] >= columns else 0
    above = int(b[1]) + _MARGIN_CELLS - rows if b[1] >= rows else 0
    height, width = rows + below + above, columns + left + right
    if height * width > _MAX_CELLS:
        raise DataError(
            f"a submap would grow to {width * resolution_m:.0f} x {height * resolution_m:.0f} m: the ranges are broken, or "
            f"TRAJECTORY_BUILDER_2D.submaps.grid_options_2d.resolution={resolution_m:g} is too small"
        )
    return Growth(left, right, below, above)


def corner_around(centre: Origin, size: int, resolution_m: float) -> Origin:
    """Return the corner, on a multiple of the resolution, of a grid of `size` by `size` cells around a point."""
    x, y = ((round(value / resolution_m) - size // 2) * resolution_m for value in centre)
    return x, y


def known_part(cells: NDArray[np.uint16], origin: Origin, resolution_m: float) -> tuple[slice, slice, Origin]:
    """Return the rows and columns that hold every cell that is not 0, and the corner of that part; one cell if all are 0."""
    rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    if len(rows) == 0:
        return slice(0, 1), slice(0, 1), origin
    corner = (float(origin[0] + columns[0] * resolution_m), float(origin[1] + rows[0] * resolution_m))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1), corner
