# SPDX-License-Identifier: MIT
"""An occupancy grid that grows as one view after another is put into it, by log odds.

A. Elfes, "Using occupancy grids for mobile robot perception and navigation", Computer 22(6), 1989, doi:10.1109/2.30720; limits of
the odds as K. M. Wurm et al. have them, "OctoMap", 2010 (Yguel et al. 2007), so that a place that changed is believed again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.grids.occupancy import OccupancyGrid

_MARGIN = 10
"""Unknown cells around what is known."""
_ROOM = 128
"""Cells by which the arrays grow beyond what is needed."""
_MOST_CELLS = 1 << 28


@dataclass(frozen=True, slots=True, kw_only=True)
class OddsSettings:
    """How sure one view is, and what counts as occupied in the end."""

    hit: float = 0.7
    """Probability that a cell that was hit is occupied, as the next."""
    miss: float = 0.4
    """... that was seen through."""
    least: float = 0.1192
    most: float = 0.971
    threshold: float = 0.5
    """From which on a cell is occupied; 0: as the last view has it."""

    @property
    def log_odds(self) -> tuple[float, float, float, float]:
        """Hit, miss, least and most as log odds."""
        hit, miss, least, most = (math.log(p / (1.0 - p)) for p in (self.hit, self.miss, self.least, self.most))
        return hit, miss, least, most


class OddsPlane:
    """The grid; cell (i, j) covers x from i to i + 1 times `cell_m` in the map, and y likewise."""

    def __init__(self, cell_m: float, settings: OddsSettings) -> None:
        self._cell, self._settings = cell_m, settings
        self._corner = np.zeros(2, dtype=np.int64)
        self._odds = np.zeros((0, 0), dtype=np.float32)
        self._last = np.zeros((0, 0), dtype=np.int8)
        self._low, self._high = np.full(2, np.iinfo(np.int64).max), np.full(2, np.iinfo(np.int64).min)

    def include(self, points: NDArray[np.float64]) -> None:
        """Make the map reach points (N, 2), metres."""
        if len(points):
            self._reserve(np.floor(points / self._cell).astype(np.int64))

    def add(self, free: NDArray[np.float64], occupied: NDArray[np.float64]) -> None:
        """Take one view: points (N, 2) that are free and points (M, 2) that are occupied, map frame, metres.

        However many points lie in a cell, it is missed once and hit once; in one that is both, the hit outweighs.
        """
        hit, miss, least, most = (np.float32(value) for value in self._settings.log_odds)
        cells = [np.floor(points / self._cell).astype(np.int64) for points in (free, occupied)]
        both = np.concatenate(cells)
        if len(both) == 0:
            return
        self._reserve(both)
        low, high = both.min(axis=0) - self._corner, both.max(axis=0) - self._corner + 1
        window = np.s_[low[1] : high[1], low[0] : high[0]]
        odds, last = self._odds[window], self._last[window]
        for group, change, value in zip(cells, (miss, hit), (OccupancyGrid.FREE, OccupancyGrid.OCCUPIED), strict=True):
            seen = np.zeros(odds.shape, dtype=np.bool_)
            at = group - self._corner - low
            seen[at[:, 1], at[:, 0]] = True
            odds[seen] = np.clip(odds[seen] + change, least, most)
            last[seen] = value

    def clear(self, centre: NDArray[np.float64], half_m: float) -> None:
        """Make the square of that half edge about a point (2,) free, as the last word."""
        low, high = (np.floor((centre + way * half_m) / self._cell + 1e-9).astype(np.int64) for way in (-1, 1))
        self._reserve(np.stack([low, high]))
        (left, below), (right, above) = low - self._corner, high - self._corner
        self._odds[below:above, left:right] = self._settings.log_odds[2]
        self._last[below:above, left:right] = OccupancyGrid.FREE

    def grid(self, frame_id: str, *, eroded: bool = False) -> OccupancyGrid | None:
        """Return what is known now, with a margin; None where nothing is.

        Parameters
        ----------
        eroded
            Whether an occupied cell becomes free of whose four neighbours three are free and none is unknown.
        """
        if not (self._last != OccupancyGrid.UNKNOWN).any():
            return None
        low, high = self._low - _MARGIN, self._high + _MARGIN + 1
        self._reserve_box(low, high)
        window = np.s_[
            low[1] - self._corner[1] : high[1] - self._corner[1], low[0] - self._corner[0] : high[0] - self._corner[0]
        ]
        cells = self._last[window].copy()
        threshold = self._settings.threshold
        if threshold > 0.0:
            limit = math.log(threshold / (1.0 - threshold)) if threshold < 1.0 else math.inf
            occupied = self._odds[window] >= limit
            cells = np.where(
                cells == OccupancyGrid.UNKNOWN, cells, np.where(occupied, OccupancyGrid.OCCUPIED, 0)
            ).astype(np.int8)
        if eroded:
            cells = _eroded(cells)
        x, y = (float(value) for value in low * self._cell)
        return OccupancyGrid(cells, self._cell, (x, y, 0.0), frame_id)

    def _reserve(self, cells: NDArray[np.int64]) -> None:
        low, high = cells.min(axis=0), cells.max(axis=0)
        self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        self._reserve_box(low, high + 1)

    def _reserve_box(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> None:
        """Make the arrays hold cells from `low` up to before `high` (2,)."""
        size = np.array(self._odds.shape[::-1])
        if size.min() == 0:
            self._corner = low.copy()
        before = np.where(low < self._corner, self._corner - low + _ROOM, 0)
        after = np.where(high > self._corner + size, high - self._corner - size + _ROOM, 0)
        if not (before.any() or after.any()):
            return
        wide = size + before + after
        if int(wide[0]) * int(wide[1]) > _MOST_CELLS:
            raise DataError(
                f"the map would cover {wide[0] * self._cell:.0f} x {wide[1] * self._cell:.0f} m in cells of {self._cell:g} m:"
                " poses or ranges are broken, or the cells are too small"
            )
        room = ((before[1], after[1]), (before[0], after[0]))
        self._odds = np.pad(self._odds, room)
        self._last = np.pad(self._last, room, constant_values=OccupancyGrid.UNKNOWN)
        self._corner = self._corner - before


def _eroded(cells: NDArray[np.int8]) -> NDArray[np.int8]:
    around = np.pad(cells, 1, constant_values=OccupancyGrid.UNKNOWN)
    sides = np.stack([around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]])
    alone = ((sides == OccupancyGrid.FREE).sum(axis=0) >= 3) & (sides != OccupancyGrid.UNKNOWN).all(axis=0)
    return np.where((cells == OccupancyGrid.OCCUPIED) & alone, OccupancyGrid.FREE, cells).astype(np.int8)
