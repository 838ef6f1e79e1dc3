# SPDX-License-Identifier: MIT
"""The map of submaps that grow, come and move: drawn again only where something changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se2
from slamcli.grids import _submap_kernels as kernels
from slamcli.grids.occupancy import OccupancyGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.submap_drawing import draw_submaps, known_corners, log_odds_table, trinary_by_odds, window_of
from slamcli.grids.submap_grid import SubmapGrid

_MARGIN_CELLS = 20
_CHUNK_CELLS = 128
"""By how much more than is needed the canvas grows, so that it does so seldom, and its origin stays."""
_SAME_CELLS, _SAME_RAD = 0.2, 0.001
"""A submap that moved by less since it was drawn stays as it is."""
_MAX_CELLS = 400_000_000

Box = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Least and greatest x, y, metres, map frame."""


@dataclass(slots=True, eq=False)
class _Drawn:
    grid: ProbabilityGrid
    pose: NDArray[np.float64]
    box: Box | None


class SubmapCanvas:
    """Draws what `draw_submaps` draws, keeping the sums under finished submaps between calls.

    Submaps that are still drawn into are added to a copy of the part that they touch. Of submaps that moved the old
    contribution is taken away, unless most moved: then everything is drawn again. Submaps of signed distances are always
    drawn as a whole.
    """

    def __init__(self, frame_id: str = "map") -> None:
        self._frame_id = frame_id
        self._resolution_m = 0.0
        self._first = np.zeros(2, np.int64)  # column, row of the lower left cell, counted from the map's origin
        self._sums, self._weights = (np.zeros((0, 0), np.float32) for _ in range(2))
        self._cells: NDArray[np.int8] = np.zeros((0, 0), np.int8)
        self._settled: list[_Drawn] = []
        self._open: list[Box] = []

    def draw(self, grids: Sequence[SubmapGrid], T_map_local: NDArray[np.float64], num_finished: int) -> OccupancyGrid:
        """Return the map of all submaps so far.

        Parameters
        ----------
        grids
            Of all submaps in their order; the first `num_finished` are finished and will not change, nor get fewer.
        T_map_local
            float64 (S, 3), see `draw_submaps`.

        Raises
        ------
        EstimationError
            If no grid has a known cell.
        DataError
            If a pose is not finite, or the map would be larger than 400 million cells.
        """
        planes = [grid for grid in grids if isinstance(grid, ProbabilityGrid)]
        if len(planes) < len(grids) or not grids:
            return draw_submaps(grids, T_map_local, _tidy(grids), self._frame_id)
        if not np.isfinite(T_map_local).all():
            raise DataError("drawing submaps: a pose is not finite")
        self._resolution_m = self._resolution_m or _tidy(grids)
        touched = [*self._open]
        open_ = [
            _drawn(grid, pose) for grid, pose in zip(planes[num_finished:], T_map_local[num_finished:], strict=True)
        ]
        self._make_room([*(one.box for one in open_)])
        touched += self._settle(planes[:num_finished], T_map_local[:num_finished])
        self._open = [one.box for one in open_ if one.box is not None]
        self._redraw([*touched, *self._open], open_)
        if not self._cells.size:
            raise EstimationError("the map is empty: no submap has a known cell")
        x, y = self._first * self._resolution_m
        return OccupancyGrid(self._cells.copy(), self._resolution_m, (float(x), float(y), 0.0), self._frame_id)

    def _settle(self, grids: Sequence[ProbabilityGrid], poses: NDArray[np.float64]) -> list[Box]:
        """Bring the sums up to date with the finished submaps; returns where they changed."""
        moved = [k for k, one in enumerate(self._settled) if self._has_moved(one.pose, poses[k])]
        fresh = range(len(self._settled), len(grids))
        new = {k: _drawn(grids[k], poses[k]) for k in (*moved, *fresh)}
        self._make_room([one.box for one in new.values()])
        changed = [one.box for one in new.values()] + [self._settled[k].box for k in moved]
        if 2 * len(moved) > len(self._settled):
            changed += [one.box for one in self._settled]
            self._sums[:], self._weights[:] = 0.0, 0.0
            new = {k: new.get(k) or self._settled[k] for k in range(len(grids))}
        else:
            for k in moved:
                self._add(self._settled[k], -1.0)
        for k in sorted(new):
            self._add(new[k], 1.0)
        self._settled = [new.get(k) or self._settled[k] for k in range(len(grids))]
        return [box for box in changed if box is not None]

    def _has_moved(self, drawn: NDArray[np.float64], pose: NDArray[np.float64]) -> bool:
        dx, dy, turn = pose - drawn
        return bool(np.hypot(dx, dy) > _SAME_CELLS * self._resolution_m or abs(float(se2.wrap_angle(turn))) > _SAME_RAD)

    def _redraw(self, boxes: list[Box], open_: list[_Drawn]) -> None:
        """Decide anew of what is known under the boxes, with the open submaps."""
        if not boxes:
            return
        around = (np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0))
        window = window_of(around, self._first, self._resolution_m, self._cells.shape)
        if window is None:
            return
        top, left, bottom, right = window.tolist()
        sums, weights = self._sums[top:bottom, left:right].copy(), self._weights[top:bottom, left:right].copy()
        for one in open_:
            self._add_to(one, 1.0, self._first + np.array([left, top]), sums, weights)
        self._cells[top:bottom, left:right] = trinary_by_odds(sums, weights)

    def _add(self, one: _Drawn, sign: float) -> None:
        self._add_to(one, sign, self._first, self._sums, self._weights)

    def _add_to(
        self,
        one: _Drawn,
        sign: float,
        first: NDArray[np.int64],
        sums: NDArray[np.float32],
        weights: NDArray[np.float32],
    ) -> None:
        window = None if one.box is None else window_of(one.box, first, self._resolution_m, sums.shape)
        if window is not None:
            kernels.add_submap(
                one.grid.cells, np.array(one.grid.origin), one.grid.resolution_m, log_odds_table(), one.pose,
                first * self._resolution_m, self._resolution_m, window, sign, sums, weights,
            )  # fmt: skip

    def _make_room(self, boxes: Sequence[Box | None]) -> None:
        """Let the canvas grow until it holds the boxes with a margin."""
        known = [box for box in boxes if box is not None]
        if not known:
            return
        low = np.floor(np.min([low for low, _ in known], axis=0) / self._resolution_m).astype(np.int64) - _MARGIN_CELLS
        end = np.ceil(np.max([high for _, high in known], axis=0) / self._resolution_m).astype(np.int64) + _MARGIN_CELLS
        height, width = self._cells.shape
        if self._cells.size:
            old = self._first + np.array([width, height])
            if (low >= self._first).all() and (end <= old).all():
                return
            low = np.where(low < self._first, low - _CHUNK_CELLS, self._first)
            end = np.where(end > old, end + _CHUNK_CELLS, old)
        if float(np.prod((end - low).astype(np.float64))) > _MAX_CELLS:
            raise DataError("the map would be too large: the submaps' poses are broken")
        column, row = self._first - low if self._cells.size else (0, 0)
        shape = (int(end[1] - low[1]), int(end[0] - low[0]))
        inside = (slice(row, row + height), slice(column, column + width))
        for name, empty in (("_sums", np.float32(0)), ("_weights", np.float32(0)), ("_cells", np.int8(-1))):
            grown = np.full(shape, empty)
            grown[inside] = getattr(self, name)
            setattr(self, name, grown)
        self._first = low


def _drawn(grid: ProbabilityGrid, pose: NDArray[np.float64]) -> _Drawn:
    return _Drawn(grid, np.ascontiguousarray(pose), known_corners(grid, pose))


def _tidy(grids: Sequence[SubmapGrid]) -> float:
    """Return the finest resolution without the noise of Cartographer's 0.05, which is 0.05000000074505806."""
    if not grids:
        raise EstimationError("the map is empty: there is no submap yet")
    return float(f"{min(grid.resolution_m for grid in grids):.6g}")
