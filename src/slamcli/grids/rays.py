# SPDX-License-Identifier: MIT
"""Which cells of the plane are free, as rays went through them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.grids import _ray_kernels as kernels

_MOST_CELLS = 1 << 27


def free_cells(
    start: NDArray[np.float64], hits: NDArray[np.float64], ends: NDArray[np.float64], cell_m: float
) -> NDArray[np.int64]:
    """Return int64 (F, 2): x and y index of every cell that a ray of one scan went through, in the order of rows.

    Cell (i, j) covers x from i to i + 1 times `cell_m`, and y likewise. Every ray ends at the first cell that any ray hit, which
    is not free; so the result does not depend on the order of the rays.

    Parameters
    ----------
    start
        float64 (2,), metres, where the rays begin.
    hits
        float64 (N, 2), where they met something.
    ends
        float64 (M, 2), up to where others met nothing: their last cells are free too.

    Raises
    ------
    DataError
        If the scan covers more than 134 million cells.
    """
    if len(hits) + len(ends) == 0:
        return np.zeros((0, 2), dtype=np.int64)
    everything = np.concatenate([start[None], hits, ends]) / cell_m
    corner = np.floor(everything.min(axis=0))
    size = (np.floor(everything.max(axis=0)) - corner + 1).astype(np.int64)
    if int(size[0]) * int(size[1]) > _MOST_CELLS:
        raise DataError(
            f"a scan covers {size[0] * cell_m:.0f} x {size[1] * cell_m:.0f} m in cells of {cell_m:g} m: its ranges are broken,"
            " or the cells are too small"
        )
    window = np.zeros((size[1], size[0]), dtype=np.uint8)
    cells = np.floor(everything - corner).astype(np.int64)
    hit = cells[1 : 1 + len(hits)]
    window[hit[:, 1], hit[:, 0]] = kernels.HIT
    local = np.ascontiguousarray(everything - corner)
    kernels.trace_plane(local[0], local[1:], window)
    row, column = np.nonzero(window == kernels.FREE)
    return np.column_stack([column, row]) + corner.astype(np.int64)


def swept_ends(
    start: NDArray[np.float64], hits: NDArray[np.float64], reach_m: float, cell_m: float
) -> NDArray[np.float64]:
    """Return ends (M, 2) of rays `reach_m` long between the first hit and the last, the way the scanner turned.

    They fill what beams without a return leave unknown (``Grid/Scan2dUnknownSpaceFilled``): every quarter of a turn has as many
    of them as cells lie along one.
    """
    if len(hits) < 2 or reach_m <= cell_m:
        return np.zeros((0, 2))
    apart = hits - start
    angles = np.unwrap(np.arctan2(apart[:, 1], apart[:, 0]))
    first, turn = float(angles[0]), float(angles[-1] - angles[0])
    num = int(abs(turn) / ((math.pi / 2) * cell_m / reach_m))
    at = first + np.sign(turn) * ((math.pi / 2) * cell_m / reach_m) * np.arange(1, num + 1)
    return start + reach_m * np.column_stack([np.cos(at), np.sin(at)])


def warm() -> None:
    """Compile the kernels of this module."""
    free_cells(np.zeros(2), np.ones((1, 2)), np.ones((1, 2)), 0.1)
