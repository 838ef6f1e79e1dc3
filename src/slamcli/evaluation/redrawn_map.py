# SPDX-License-Identifier: MIT
"""A map drawn once more from the same rays for every trajectory, so that cells of one size are compared."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation import _redrawing_kernels as kernels
from slamcli.evaluation.seen_points import PlacedPoints

_MOST_CELLS = 1 << 25
_QUANTILES = (0.002, 0.998)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RedrawnMap:
    """How often rays ended in cells, and how often they went through."""

    hits: NDArray[np.int32]
    """int32 (H, W); row 0 is the lowest y."""
    passes: NDArray[np.int32]
    """int32 (H, W)."""
    cell_m: float
    origin_m: tuple[float, float]
    """x and y of the lower left corner of cell (0, 0)."""

    @property
    def entropy_bits(self) -> float:
        """Mean entropy of the known cells, bits: of the share h of rays that ended in a cell, h = (hits + 1/2) / (rays + 1).

        0 where every cell is surely free or surely a wall, 1 where half of the rays say each.
        """
        rays = (self.hits + self.passes).astype(np.float64)
        known = rays > 0
        return float(_entropy((self.hits[known] + 0.5) / (rays[known] + 1.0)).mean()) if known.any() else math.nan

    @property
    def known_m2(self) -> float:
        """Area of the cells that rays reached, square metres."""
        return float((self.hits + self.passes > 0).sum()) * self.cell_m**2


def redraw(placed: PlacedPoints, cell_m: float) -> RedrawnMap:
    """Return the map of the rays of points, x and y.

    Rays that lie outside of what holds all but 0.4 % of the points in each direction are left out, so that a few strays do
    not make the map large; of a map that is larger than 33 million cells even so (poses ran away) only the middle is drawn.
    """
    ends, origins = placed.points_m[:, :2], placed.origins_m[:, :2]
    both = np.concatenate([ends, origins])
    low, high = np.quantile(both, _QUANTILES, axis=0) + np.array([[-1.0], [1.0]])
    size = np.ceil((high - low) / cell_m).astype(np.int64)
    if size[0] * size[1] > _MOST_CELLS:
        middle, size = np.median(ends, axis=0), np.minimum(size, int(_MOST_CELLS**0.5))
        low = middle - size * cell_m / 2
    # Corners of cells are multiples of the cell, whatever the points are.
    low = np.floor(low / cell_m) * cell_m
    hits, passes = (
        np.zeros((size[1] + 1, size[0] + 1), dtype=np.int32),
        np.zeros((size[1] + 1, size[0] + 1), dtype=np.int32),
    )
    kernels.count(
        np.ascontiguousarray((origins - low) / cell_m), np.ascontiguousarray((ends - low) / cell_m), hits, passes
    )
    return RedrawnMap(hits=hits, passes=passes, cell_m=cell_m, origin_m=(float(low[0]), float(low[1])))


def _entropy(share: NDArray[np.float64]) -> NDArray[np.float64]:
    bits: NDArray[np.float64] = -(share * np.log2(share) + (1.0 - share) * np.log2(1.0 - share))
    return bits


def warm() -> None:
    """Compile the kernels of this module."""
    points = np.zeros((2, 3))
    placed = PlacedPoints(
        points_m=points, origins_m=points, stamps_ns=np.zeros(2, dtype=np.int64), planar=True, num_views=1
    )
    redraw(placed, 0.1)
