# SPDX-License-Identifier: MIT
"""Maps of many particles that share their tiles: copy on write, so that memory follows the distinct area."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.grids import _tile_kernels as _kernels
from slamcli.grids.occupancy import OccupancyGrid

_RESERVED_TILES = 1 << 16  # 1 GiB of address space; the system gives memory to the tiles that are written
_MAX_TILES = 1 << 18  # 268 million cells, 819 x 819 m at 5 cm: a larger map is a broken one, and would fill the memory


class TiledMaps:
    """Hit and visit counts of `num_maps` maps over one common extent that grows by itself.

    A tile is 32 x 32 cells of float32 (visits, hits, mean hit x, mean hit y from the cell's lower left corner); see
    `_kernels`. Tile 0 is empty and belongs to nobody. Writing is done in four steps, of which only the second one (who
    owns which tile) is serial, so the result does not depend on the number of threads.
    """

    def __init__(
        self,
        num_maps: int,
        delta: float,
        bounds: tuple[float, float, float, float],
        executor: ThreadPoolExecutor | None = None,
        jobs: int = 1,
    ) -> None:
        self.delta = delta
        self._tile_m = delta * _kernels.TILE
        self._executor, self._jobs = executor, max(1, jobs)
        if not np.isfinite(bounds).all():
            raise DataError(f"the first extent of a map must be finite, not {tuple(float(value) for value in bounds)}")
        x_min, y_min, x_max, y_max = bounds
        column, row = int(np.floor(x_min / self._tile_m)), int(np.floor(y_min / self._tile_m))
        columns, rows = int(np.ceil(x_max / self._tile_m)) - column, int(np.ceil(y_max / self._tile_m)) - row
        if rows * columns > _MAX_TILES:  # the extent grows by itself: a smaller first one changes nothing
            row, column = row + rows // 2 - 2, column + columns // 2 - 2
            rows, columns = 4, 4
        self._corner = (row, column)
        self.tables: NDArray[np.int32] = np.zeros((num_maps, max(rows, 1), max(columns, 1)), np.int32)
        self.cells: NDArray[np.float32] = np.zeros((_RESERVED_TILES, _kernels.TILE, _kernels.TILE, 4), np.float32)
        self._owners: NDArray[np.int32] = np.zeros(_RESERVED_TILES, np.int32)
        self._free: list[int] = []
        self._next = 1

    @property
    def origin(self) -> tuple[float, float]:
        """Position x, y of the lower left corner of the extent, metres."""
        return self._corner[1] * self._tile_m, self._corner[0] * self._tile_m

    @property
    def num_tiles(self) -> int:
        """Number of distinct tiles in use."""
        return self._next - 1 - len(self._free)

    def add_scan(
        self,
        poses: NDArray[np.float64],
        start: NDArray[np.float64],
        ends: NDArray[np.float64],
        hit: NDArray[np.bool_],
        maps: NDArray[np.int64] | None = None,
    ) -> None:
        """Add one scan to each map (or to `maps`) as seen from its pose.

        Parameters
        ----------
        poses : float64 (K, 3), one pose of the base per map.
        start, ends : float64 (B, 2), both ends of each beam in the base frame, metres.
        hit : bool (B,), whether the beam ended at an obstacle.
        """
        if len(ends) == 0:
            return
        indices = np.arange(len(self.tables)) if maps is None else maps
        self._grow_to(poses, start, ends)
        touched = np.zeros((len(indices), *self.tables.shape[1:]), np.uint8)
        ox, oy = self.origin

        def mark(chunk: range) -> None:
            for k in chunk:
                _kernels.touched_tiles(touched[k], ox, oy, self.delta, start, ends, poses[k])

        self._in_chunks(mark, len(indices))
        copies = self._own(indices, touched)

        def copy(chunk: range) -> None:
            for k in chunk:
                for source, target in copies[k]:
                    self.cells[target] = self.cells[source]

        def write(chunk: range) -> None:
            for k in chunk:
                _kernels.register(self.cells, self.tables[indices[k]], ox, oy, self.delta, start, ends, hit, poses[k])

        # All copies before the first write: the last owner of a shared tile writes to the tile that the others copy.
        self._in_chunks(copy, len(indices))
        self._in_chunks(write, len(indices))

    def resample(self, parents: NDArray[np.int64]) -> None:
        """Make map i a copy of map ``parents[i]``; tiles are shared until one of them is written to."""
        counts = np.bincount(parents, minlength=len(self.tables))
        for index in np.flatnonzero(counts == 0):
            self._release(index)
        for index in np.flatnonzero(counts > 1):
            used = self.tables[index][self.tables[index] > 0]
            self._owners[used] += np.int32(counts[index] - 1)
        self.tables = self.tables[parents]

    def clear(self, index: int) -> None:
        """Empty one map."""
        self._release(index)
        self.tables[index] = 0

    def each(self, work: Callable[[range], None]) -> None:
        """Call `work` with ranges that together cover all maps, on all threads."""
        self._in_chunks(work, len(self.tables))

    def _release(self, index: np.signedinteger | int) -> None:
        used = self.tables[index][self.tables[index] > 0]
        self._owners[used] -= 1
        gone = used[self._owners[used] == 0]
        self.cells[gone] = 0.0
        self._free.extend(int(tile) for tile in gone[::-1])

    def _own(self, indices: NDArray[np.int64], touched: NDArray[np.uint8]) -> list[list[tuple[int, int]]]:
        """Give each map its own copy of every tile that it will write to; returns what to copy from where, per map."""
        copies: list[list[tuple[int, int]]] = []
        for k, index in enumerate(indices):
            rows, columns = np.nonzero(touched[k])
            tiles = self.tables[index, rows, columns]
            shared = (tiles == 0) | (self._owners[tiles] > 1)
            rows, columns, tiles = rows[shared], columns[shared], tiles[shared]
            fresh = self._allocate(len(tiles))
            self.tables[index, rows, columns] = fresh
            self._owners[tiles[tiles > 0]] -= 1
            copies.append([(int(s), int(t)) for s, t in zip(tiles, fresh, strict=True) if s > 0])
        return copies

    def _allocate(self, count: int) -> NDArray[np.int32]:
        reused = [self._free.pop() for _ in range(min(count, len(self._free)))]
        end = self._next + count - len(reused)
        while end > len(self.cells):
            self.cells = np.concatenate([self.cells, np.zeros_like(self.cells)])
            self._owners = np.concatenate([self._owners, np.zeros_like(self._owners)])
        fresh = np.array([*reused, *range(self._next, end)], np.int32)
        self._next = end
        self._owners[fresh] = 1
        return fresh

    def _grow_to(self, poses: NDArray[np.float64], start: NDArray[np.float64], ends: NDArray[np.float64]) -> None:
        reach = float(np.sqrt(max((start**2).sum(axis=1).max(), (ends**2).sum(axis=1).max()))) + 2 * self.delta
        low, high = poses[:, :2].min(axis=0) - reach, poses[:, :2].max(axis=0) + reach
        if not all(np.isfinite(values).all() for values in (low, high, poses, start, ends)):
            raise DataError("a scan cannot be drawn: its pose or one of its ranges is not finite")
        row, column = self._corner
        need_row, need_column = int(np.floor(low[1] / self._tile_m)), int(np.floor(low[0] / self._tile_m))
        end_row, end_column = int(np.floor(high[1] / self._tile_m)) + 1, int(np.floor(high[0] / self._tile_m)) + 1
        rows, columns = self.tables.shape[1:]
        if need_row >= row and need_column >= column and end_row <= row + rows and end_column <= column + columns:
            return
        new_row, new_column = min(row, need_row - 4), min(column, need_column - 4)
        new_rows = max(row + rows, end_row + 4) - new_row
        new_columns = max(column + columns, end_column + 4) - new_column
        self._check_size(new_rows, new_columns)
        tables = np.zeros((len(self.tables), new_rows, new_columns), np.int32)
        tables[:, row - new_row : row - new_row + rows, column - new_column : column - new_column + columns] = (
            self.tables
        )
        self.tables, self._corner = tables, (new_row, new_column)

    def _check_size(self, rows: int, columns: int) -> None:
        if rows * columns > _MAX_TILES:
            raise DataError(
                f"the map would grow to {columns * self._tile_m:.0f} x {rows * self._tile_m:.0f} m: the odometry or the ranges "
                f"are broken, or delta={self.delta:g} is too small for a place of this size"
            )

    def occupancy(self, index: int, occ_thresh: float, frame_id: str, margin_cells: int = 20) -> OccupancyGrid:
        """Return one map as an occupancy grid, cropped to what was seen.

        A cell whose share of hits is over `occ_thresh` is occupied, any other that was visited is free.

        Raises
        ------
        EstimationError
            If nothing was seen.
        """
        rows, columns = np.nonzero(self.tables[index])
        if len(rows) == 0:
            raise EstimationError("the map is empty: no beam of any scan was within range")
        first_row, first_column = int(rows.min()), int(columns.min())
        size = _kernels.TILE
        table = self.tables[index, first_row : rows.max() + 1, first_column : columns.max() + 1]
        whole = np.full((table.shape[0] * size, table.shape[1] * size), -1, np.int8)
        _kernels.trinary(self.cells, np.ascontiguousarray(table), np.float32(occ_thresh), whole)
        known = whole >= 0
        i0, i1 = _extent(np.any(known, axis=1), margin_cells)
        j0, j1 = _extent(np.any(known, axis=0), margin_cells)
        x, y = self.origin
        corner = (x + (first_column * size + j0) * self.delta, y + (first_row * size + i0) * self.delta, 0.0)
        return OccupancyGrid(np.ascontiguousarray(whole[i0:i1, j0:j1]), self.delta, corner, frame_id)

    def _in_chunks(self, work: Callable[[range], None], count: int) -> None:
        """Run `work` over ranges of 0..count, one per thread; kernels release the GIL."""
        if self._executor is None or self._jobs == 1 or count == 1:
            work(range(count))
            return
        step = -(-count // self._jobs)
        chunks = [range(first, min(first + step, count)) for first in range(0, count, step)]
        _wait(self._executor.submit(work, chunk) for chunk in chunks)


def _extent(known: NDArray[Any], margin: int) -> tuple[int, int]:
    """First and past-the-last index with something known, widened by the margin within the array."""
    found = np.flatnonzero(known)
    return max(int(found[0]) - margin, 0), min(int(found[-1]) + 1 + margin, len(known))


def _wait(futures: Iterable[Future[None]]) -> None:
    for future in list(futures):
        future.result()
