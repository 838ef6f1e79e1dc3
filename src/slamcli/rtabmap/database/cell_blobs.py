# SPDX-License-Identifier: MIT
"""Local grids as the database's columns ground_cells, obstacle_cells, empty_cells, cell_size and view_point hold them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.rtabmap.database.blobs import pack_matrix, unpack_matrix
from slamcli.rtabmap.local_grid import LocalGrid

CellColumns = tuple[bytes | None, bytes | None, bytes | None, float, float, float, float]
NO_CELLS: CellColumns = (None, None, None, 0.0, 0.0, 0.0, 0.0)


def pack_cells(cells: LocalGrid | None) -> CellColumns:
    """Return the seven columns, ground, obstacles and empty first."""
    if cells is None:
        return NO_CELLS
    ground, obstacles, empty = (_pack(part) for part in (cells.ground, cells.obstacles, cells.empty))
    x, y, z = (float(value) for value in cells.view_point)
    return ground, obstacles, empty, float(cells.cell_size_m), x, y, z


def unpack_cells(columns: Sequence[Any]) -> LocalGrid | None:
    """Return the cells of the seven columns, or None where the node has no local grid.

    Raises
    ------
    FormatError
        If the bytes are damaged.
    """
    *blobs, cell_size_m, x, y, z = columns
    if not cell_size_m:
        return None
    parts = [_unpack(blob) for blob in blobs]
    wide = any(len(part) and part.shape[1] == 3 for part in parts)
    ground, obstacles, empty = (part if len(part) or not wide else np.zeros((0, 3), dtype=np.float32) for part in parts)
    view_point = np.array([x or 0.0, y or 0.0, z or 0.0])
    return LocalGrid(
        ground=ground, obstacles=obstacles, empty=empty, cell_size_m=float(cell_size_m), view_point=view_point
    )


def _pack(points: NDArray[np.float32]) -> bytes | None:
    return pack_matrix(np.ascontiguousarray(points, dtype="<f4")[None]) if len(points) else None


def _unpack(blob: bytes | None) -> NDArray[np.float32]:
    if not blob:
        return np.zeros((0, 2), dtype=np.float32)
    matrix = unpack_matrix(blob)
    if matrix.dtype != np.float32 or matrix.ndim != 3:
        raise FormatError(f"local grid cells of type {matrix.dtype} and shape {matrix.shape}: damaged")
    places = matrix.reshape(-1, matrix.shape[2])
    return np.ascontiguousarray(places[:, : 2 if matrix.shape[2] == 2 else 3], dtype=np.float32)
