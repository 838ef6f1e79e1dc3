# SPDX-License-Identifier: MIT
"""Grids of submaps from and to the layout of a ``.pbstream``.

Cartographer's cell (0, 0) lies at the greatest x and y; its x index runs against y and its y index against x. Ours lies
at the least x and y, rows along y and columns along x: both axes are turned round and swapped.

References
----------
Cartographer, ``mapping/2d/map_limits``, ``mapping/2d/grid_2d``, ``mapping/2d/tsdf_2d`` and ``mapping/3d/hybrid_grid``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats.pbstream import packed
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.tsdf_grid import TsdfGrid

_MOST = 32767
_MOST_CELLS = 1 << 28
_COSTS = float(np.float32(1.0) - np.float32(0.9)), 0.9
"""As Cartographer computes them, in single precision."""
_COST_TOLERANCE = 1e-5
_MOST_INDEX = 1 << 20
"""Of a voxel along an axis; Cartographer's grids end at 2^13 or so."""


def read_grid(grid: Any, what: str) -> ProbabilityGrid | TsdfGrid:
    """Return the grid of a 2D submap.

    Raises
    ------
    FormatError
        If sizes, values or limits do not fit.
    """
    limits = grid.limits
    shape = limits.cell_limits.num_y_cells, limits.cell_limits.num_x_cells
    resolution, corner = limits.resolution, (limits.max.x, limits.max.y)
    if not (math.isfinite(resolution) and resolution > 0 and all(map(math.isfinite, corner))):
        raise FormatError(f"{what}: cells of {resolution} m at {corner}")
    if min(shape) < 1 or shape[0] * shape[1] > _MOST_CELLS:
        raise FormatError(f"{what}: a grid of {shape[1]} x {shape[0]} cells")
    cells = _turned(packed.unpack_uint16(grid.cells, what, _MOST), shape, what)
    origin = corner[0] - resolution * shape[0], corner[1] - resolution * shape[1]
    if grid.HasField("tsdf_2d"):
        weights = _turned(packed.unpack_uint16(grid.tsdf_2d.weight_cells, what, _MOST), shape, what)
        truncation, most = _short(grid.tsdf_2d.truncation_distance), _short(grid.tsdf_2d.max_weight)
        if not (math.isfinite(truncation) and truncation > 0 and math.isfinite(most) and most > 0):
            raise FormatError(f"{what}: a truncation distance of {truncation:g} m and a greatest weight of {most:g}")
        return TsdfGrid(cells, weights, resolution, origin, truncation, most)
    costs = grid.min_correspondence_cost, grid.max_correspondence_cost
    expected = ProbabilityGrid.MIN_COST, ProbabilityGrid.MAX_COST
    if costs != (0.0, 0.0) and not np.allclose(costs, expected, rtol=0.0, atol=_COST_TOLERANCE):
        raise FormatError(f"{what}: correspondence costs from {costs[0]:g} to {costs[1]:g}, not from 0.1 to 0.9")
    return ProbabilityGrid(cells, resolution, origin)


def _turned(values: NDArray[np.uint16], shape: tuple[int, int], what: str) -> NDArray[np.uint16]:
    if len(values) != shape[0] * shape[1]:
        raise FormatError(f"{what}: {len(values)} cells, not {shape[1]} x {shape[0]}")
    return np.ascontiguousarray(values.reshape(shape).T[::-1, ::-1])


def fill_grid(message: Any, grid: ProbabilityGrid | TsdfGrid) -> None:
    """Write the grid of a 2D submap into a Grid2 message."""
    values = grid.cells
    height, width = values.shape
    limits = message.limits
    limits.resolution = grid.resolution_m
    limits.max.x = _end(grid.origin[0], grid.resolution_m * width)
    limits.max.y = _end(grid.origin[1], grid.resolution_m * height)
    limits.cell_limits.num_x_cells, limits.cell_limits.num_y_cells = height, width
    turned = values[::-1, ::-1].T
    message.cells = packed.pack(turned.ravel())
    rows, columns = np.flatnonzero(turned.any(axis=1)), np.flatnonzero(turned.any(axis=0))
    if len(rows):
        box = message.known_cells_box
        box.min_x, box.max_x, box.min_y, box.max_y = (int(i) for i in (columns[0], columns[-1], rows[0], rows[-1]))
    if isinstance(grid, ProbabilityGrid):
        message.probability_grid_2d.SetInParent()
        message.min_correspondence_cost, message.max_correspondence_cost = _COSTS
    else:
        tsdf = message.tsdf_2d
        tsdf.truncation_distance, tsdf.max_weight = grid.truncation_distance_m, grid.max_weight
        tsdf.weight_cells = packed.pack(grid.weights[::-1, ::-1].T.ravel())
        message.min_correspondence_cost = -grid.truncation_distance_m
        message.max_correspondence_cost = grid.truncation_distance_m


def _end(origin: float, length: float) -> float:
    """Return the number from which subtracting `length` gives `origin` to the last bit, where there is one."""
    end = origin + length
    for candidate in (end, math.nextafter(end, math.inf), math.nextafter(end, -math.inf)):
        if candidate - length == origin:
            return candidate
    return end


def read_hybrid_grid(grid: Any, what: str) -> HybridGrid:
    """Return a grid of a 3D submap.

    Raises
    ------
    FormatError
        If the numbers of indices and values differ, or one is out of range.
    """
    resolution = _short(grid.resolution)
    if not (math.isfinite(resolution) and resolution > 0):
        raise FormatError(f"{what}: voxels of {resolution:g} m")
    axes = [packed.unpack_zigzag(data, what) for data in (grid.x_indices, grid.y_indices, grid.z_indices)]
    values = packed.unpack_uint16(grid.values, what, _MOST)
    if any(len(axis) != len(values) for axis in axes):
        raise FormatError(f"{what}: {len(values)} voxels, but {', '.join(str(len(axis)) for axis in axes)} indices")
    indices = np.stack(axes, axis=1)
    if len(indices) and np.abs(indices).max() > _MOST_INDEX:
        raise FormatError(f"{what}: a voxel at index {np.abs(indices).max()}")
    order = np.lexsort(axes[::-1])
    indices = indices[order]
    if len(indices) > 1 and (indices[1:] == indices[:-1]).all(axis=1).any():
        raise FormatError(f"{what}: a voxel is in it twice")
    return HybridGrid(indices.astype(np.int32), values[order], resolution)


def fill_hybrid_grid(message: Any, grid: HybridGrid) -> None:
    """Write a grid of a 3D submap into a HybridGrid message."""
    message.resolution = grid.resolution_m
    message.x_indices, message.y_indices, message.z_indices = (packed.pack_zigzag(axis) for axis in grid.indices.T)
    message.values = packed.pack(grid.values)


def _short(value: float) -> float:
    """Return the shortest decimal number that is this float32: 0.1, not 0.10000000149."""
    return float(str(np.float32(value)))
