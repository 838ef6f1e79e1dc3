# SPDX-License-Identifier: MIT
"""The 3D probability grid that scans are put into: sparse blocks of cells, updated by odds (Hess et al., ICRA 2016, IV-B)."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import _hybrid_kernels as kernels
from slamcli.grids.hybrid_grid import HybridGrid

MIN_PROBABILITY, MAX_PROBABILITY = np.float32(0.1), np.float32(0.9)


def probability_of(values: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return the probabilities of cell values 0 to 32767; 0 (unknown) gives 0.1, as Cartographer has it in 3D."""
    scale = (MAX_PROBABILITY - MIN_PROBABILITY) / np.float32(32766)
    return np.where(values == 0, MIN_PROBABILITY, (values.astype(np.float32) - 1) * scale + MIN_PROBABILITY)


def value_of(probabilities: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Return the cell values 1 to 32767 of probabilities, which are first limited to 0.1 ... 0.9."""
    limited = np.clip(probabilities, MIN_PROBABILITY, MAX_PROBABILITY)
    scaled = (limited - MIN_PROBABILITY) * (np.float32(32766) / (MAX_PROBABILITY - MIN_PROBABILITY))
    return (np.floor(scaled + np.float32(0.5)) + 1).astype(np.uint16)


@functools.cache
def update_table(probability: float) -> NDArray[np.uint16]:
    """Return uint16 (32768,): the value a cell takes when it is seen with `probability`, with the mark of an update on it."""
    odds = np.float32(probability) / (np.float32(1) - np.float32(probability))
    values = np.arange(32768).astype(np.uint16)
    before = probability_of(values)
    together = odds * before / (np.float32(1) - before)
    table = value_of(together / (np.float32(1) + together))
    table[0] = value_of(np.array([probability], dtype=np.float32))[0]
    table = table | np.uint16(kernels.UPDATED)
    table.setflags(write=False)
    return table


class HybridBlocks:
    """A sparse grid of cubic cells of `resolution_m`; cell (x, y, z) is centred on that multiple of it.

    Memory is 1 KB per block of 8 x 8 x 8 cells that holds a known cell. Cells reach four million to each side.
    """

    def __init__(self, resolution_m: float) -> None:
        self.resolution_m = float(resolution_m)
        self.keys = np.full(1 << 10, -1, dtype=np.int64)
        self.blocks = np.zeros(1 << 10, dtype=np.int64)
        self.cells = np.zeros((1 << 8, 512), dtype=np.uint16)
        self._held = np.zeros(1 << 8, dtype=np.int64)
        self._used = 0

    @classmethod
    def from_record(cls, grid: HybridGrid) -> HybridBlocks:
        """Return a working grid with the cells of a record."""
        made = cls(grid.resolution_m)
        done = 0
        while done < len(grid.indices):
            made._used, done = kernels.set_cells(
                grid.indices, grid.values, made.keys, made.blocks, made._held, made.cells, made._used, done
            )
            if done < len(grid.indices):
                made._reserve(made._used + max(64, made._used // 2))
        return made

    def record(self) -> HybridGrid:
        """Return the known cells, sorted."""
        most = int(np.count_nonzero(self.cells[: self._used]))
        indices, values = np.empty((most, 3), dtype=np.int32), np.empty(most, dtype=np.uint16)
        kernels.known_cells(self._held, self.cells, self._used, indices, values)
        order = np.lexsort((indices[:, 2], indices[:, 1], indices[:, 0]))
        return HybridGrid(indices[order], values[order], self.resolution_m)

    def insert(
        self,
        origin_m: NDArray[np.float64],
        points_m: NDArray[np.float64],
        hit_probability: float,
        miss_probability: float,
        num_free_space_voxels: int,
    ) -> None:
        """Put a scan into the grid: the cells of its points as hits, then the last cells before each as misses.

        Parameters
        ----------
        origin_m, points_m
            float64 (3,) and (N, 3), where the scan was taken and what it hit, metres, in the grid's frame.
        num_free_space_voxels
            How many cells of the ray before a point are missed; the rest of the ray says nothing.
        """
        origin_m, points_m = np.ascontiguousarray(origin_m), np.ascontiguousarray(points_m)
        changed = np.empty(len(points_m) * (1 + num_free_space_voxels), dtype=np.int64)
        count, num_hits, done = 0, -1, False
        while not done:
            self._used, count, num_hits, done = kernels.insert_scan(
                origin_m, points_m, self.resolution_m, num_free_space_voxels, update_table(hit_probability),
                update_table(miss_probability), self.keys, self.blocks, self._held, self.cells, changed, self._used, count,
                num_hits,
            )  # fmt: skip
            if not done:
                self._reserve(self._used + 1 + max(num_free_space_voxels, self._used // 2))

    def probabilities(self, indices: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the probabilities of cells (N, 3), 0.1 where unknown."""
        values = np.empty(len(indices), dtype=np.uint16)
        kernels.values_at(indices, self.keys, self.blocks, self.cells, values)
        return probability_of(values)

    def interpolate(self, points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return probabilities (N,) and their gradients (N, 3), per metre, at points (N, 3) between the cells' centres."""
        points_m = np.ascontiguousarray(points_m)
        values, gradients = np.empty(len(points_m)), np.empty((len(points_m), 3))
        kernels.interpolate(points_m, self.resolution_m, self.keys, self.blocks, self.cells, values, gradients)
        return values, gradients

    def _reserve(self, blocks: int) -> None:
        if blocks > len(self._held):
            rows = max(len(self._held) * 3 // 2, blocks)
            cells = np.zeros((rows, 512), dtype=np.uint16)
            cells[: self._used] = self.cells[: self._used]
            self.cells, self._held = cells, np.resize(self._held, rows)
        if 2 * blocks > len(self.keys):
            slots = 1 << int(2 * blocks - 1).bit_length()
            self.keys, self.blocks = np.full(slots, -1, dtype=np.int64), np.zeros(slots, dtype=np.int64)
            kernels.insert_keys(self.keys, self.blocks, self._held[: self._used])


def warm() -> None:
    """Compile the kernels of this module."""
    grid = HybridBlocks(0.1)
    grid.insert(np.zeros(3), np.ones((1, 3)), 0.55, 0.49, 2)
    HybridBlocks.from_record(grid.record()).interpolate(np.ones((1, 3)))
    grid.probabilities(np.zeros((1, 3), dtype=np.int64))
