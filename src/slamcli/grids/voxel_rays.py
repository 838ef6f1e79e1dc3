# SPDX-License-Identifier: MIT
"""Which cells of space are free, as rays went through them; numbers of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.grids import _voxel_kernels as kernels

REACH_CELLS = kernels.HALF
_MOST_STEPS = 2_000_000_000


def numbers_of(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number for each cell (N, 3); see `slamcli.grids._voxel_kernels`."""
    x, y, z = (indices + kernels.HALF).T
    return (x << 42) | (y << 21) | z


def indices_of(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return cells (N, 3) of their numbers."""
    parts = [numbers >> 42, (numbers >> 21) & kernels.MASK, numbers & kernels.MASK]
    return np.column_stack(parts) - kernels.HALF


def free_voxels(
    start: NDArray[np.float64], hits: NDArray[np.float64], ends: NDArray[np.float64], cell_m: float
) -> NDArray[np.int64]:
    """Return int64 (F, 3): index of every cell that a ray of one view went through and none ended in, in the order of rays.

    Cell (i, j, k) covers x from i to i + 1 times `cell_m`, and y and z likewise.

    Parameters
    ----------
    start
        float64 (3,), metres, where the rays begin.
    hits
        float64 (N, 3), where they met something.
    ends
        float64 (M, 3), up to where others met nothing: their last cells are free too.

    Raises
    ------
    DataError
        If the rays go through more than two billion cells, or farther than a million from the map's origin.
    """
    targets = np.ascontiguousarray(np.concatenate([hits, ends]) / cell_m)
    if len(targets) == 0:
        return np.zeros((0, 3), dtype=np.int64)
    origin = np.ascontiguousarray(start / cell_m, dtype=np.float64)
    steps = float(np.abs(targets - origin).sum())
    if max(float(np.abs(targets).max()), float(np.abs(origin).max())) >= REACH_CELLS - 1 or steps > _MOST_STEPS:
        raise DataError(
            f"rays of {np.linalg.norm(targets - origin, axis=1).max() * cell_m:.0f} m cannot be traced through cells of"
            f" {cell_m:g} m: ranges or poses are broken, or the cells are too small"
        )
    return indices_of(kernels.trace_space(origin, targets, len(hits)))


def warm() -> None:
    """Compile the kernels of this module."""
    free_voxels(np.zeros(3), np.ones((1, 3)), np.ones((1, 3)), 0.5)
