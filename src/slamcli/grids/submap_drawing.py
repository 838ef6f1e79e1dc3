# SPDX-License-Identifier: MIT
"""Submaps' grids, each at its optimised pose, drawn into one occupancy grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se2
from slamcli.grids import _submap_kernels as kernels
from slamcli.grids.distance_drawing import drawn_distances, trinary_by_distance
from slamcli.grids.occupancy import OccupancyGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.submap_grid import SubmapGrid, shown
from slamcli.grids.tsdf_grid import TsdfGrid

_BAND_ROWS = 512
"""Rows that are drawn at once: so much of the map exists in floating point."""
_MAX_CELLS = 400_000_000
_FARTHEST_CELL = 1 << 40
_MIN_WEIGHT = 0.499
"""A cell is known if half a cell of submaps lies under it; a hair less, so that rounding does not decide."""
_HAIR = 1e-6
"""Of a cell, by which known cells may reach into the next one through rounding."""


def draw_submaps(
    grids: Sequence[SubmapGrid],
    T_map_local: NDArray[np.float64],
    resolution_m: float,
    frame_id: str = "map",
    *,
    occupied_probability: float = 0.51,
    free_probability: float = 0.51,
    margin_cells: int = 20,
) -> OccupancyGrid:
    """Return one trinary grid from the submaps of a run.

    Where submaps overlap, the means of their log odds count: each submap is an independent estimate of the same cell
    (its scans were matched within it), so one submap that was off by a cell does not smear the walls of the others.
    Of signed distances the means count for the same reason, cut at two cells.

    Parameters
    ----------
    grids
        Grids in their trajectory's local frame; those without a known cell add nothing. From signed distances come cells that
        are occupied on a surface and free in front of it; next to grids of probabilities they are drawn as such.
    T_map_local
        float64 (S, 3), x, y (metres) and yaw of each grid's local frame in the map:
        ``T_map_submap @ inverse(T_local_submap)``.
    resolution_m
        Edge of a cell of the result, metres; not coarser than that of the grids, or thin walls have holes.
    frame_id
        Name of the map's frame.
    occupied_probability, free_probability
        Of grids of probabilities: a cell whose probability is over the first is occupied, under the second free, and unknown between. At 0.51 instead
        of even odds 6 to 8 % of the occupied cells go, beside walls and at the ends of beams, and 1 % of those on walls
        (mit-csail, intel).
    margin_cells
        Unknown cells around what is known.

    Raises
    ------
    DataError
        If poses and grids do not fit each other, or the map would be larger than 400 million cells.
    EstimationError
        If no grid has a known cell.
    """
    poses = np.asarray(T_map_local, dtype=np.float64)
    if poses.shape != (len(grids), 3) or not np.isfinite(poses).all():
        raise DataError(f"drawing submaps: poses are {poses.shape} or not finite, not finite ({len(grids)}, 3)")
    drawn = grids if all(isinstance(grid, TsdfGrid) for grid in grids) else [shown(grid) for grid in grids]
    boxes = [known_corners(grid, pose) for grid, pose in zip(drawn, poses, strict=True)]
    known = [box for box in boxes if box is not None]
    if not known:
        raise EstimationError("the map is empty: no submap has a known cell")
    low = np.floor(np.min([low for low, _ in known], axis=0) / resolution_m + _HAIR) - margin_cells
    end = np.ceil(np.max([high for _, high in known], axis=0) / resolution_m - _HAIR) + margin_cells
    if np.prod(end - low) > _MAX_CELLS or max(np.abs(low).max(), np.abs(end).max()) > _FARTHEST_CELL:
        width_m, height_m = (end - low) * resolution_m
        raise DataError(
            f"the map would be {width_m:.3g} x {height_m:.3g} m in cells of {resolution_m:g} m: "
            "the submaps' poses are broken, or the resolution is too fine for a place of this size"
        )
    first = low.astype(np.int64)
    width, height = (int(n) for n in end - low)
    corner = first * resolution_m
    distances = all(isinstance(grid, TsdfGrid) for grid in drawn)
    band = height if distances else _BAND_ROWS  # distances are looked at across rows
    parts = []
    for top in range(0, height, band):
        sums, weights = (np.zeros((min(band, height - top), width), np.float32) for _ in range(2))
        origin = corner + np.array([0.0, top * resolution_m])
        for grid, pose, box in zip(drawn, poses, boxes, strict=True):
            window = None if box is None else window_of(box, first + np.array([0, top]), resolution_m, sums.shape)
            if window is not None:
                cells, table = _values(grid, resolution_m)
                kernels.add_submap(
                    cells, np.array(grid.origin), grid.resolution_m, table, pose, origin, resolution_m, window, 1.0, sums, weights
                )  # fmt: skip
        if distances:
            enough = weights >= _MIN_WEIGHT
            parts.append(trinary_by_distance(np.divide(sums, weights, where=enough, out=np.full_like(sums, np.nan))))
        else:
            parts.append(trinary_by_odds(sums, weights, occupied_probability, free_probability))
    trinary = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return OccupancyGrid(trinary, resolution_m, (float(corner[0]), float(corner[1]), 0.0), frame_id)


def window_of(
    box: tuple[NDArray[np.float64], NDArray[np.float64]],
    first: NDArray[np.int64],
    resolution_m: float,
    shape: tuple[int, ...],
) -> NDArray[np.int64] | None:
    """Return the rows and columns (first row, first column, end row, end column) under a box; None where there are none."""
    (x0, y0), (x1, y1) = (np.asarray(point) / resolution_m - first for point in box)
    rows = max(math.floor(y0) - 1, 0), min(math.ceil(y1) + 1, shape[0])
    columns = max(math.floor(x0) - 1, 0), min(math.ceil(x1) + 1, shape[1])
    if rows[0] >= rows[1] or columns[0] >= columns[1]:
        return None
    return np.array([rows[0], columns[0], rows[1], columns[1]], np.int64)


def _values(grid: SubmapGrid, cell_m: float) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Return the cells that are drawn, and what each stored value adds to the mean."""
    return drawn_distances(grid, cell_m) if isinstance(grid, TsdfGrid) else (grid.cells, log_odds_table())


def trinary_by_odds(
    sums: NDArray[np.float32],
    weights: NDArray[np.float32],
    occupied_probability: float = 0.51,
    free_probability: float = 0.51,
) -> NDArray[np.int8]:
    """Return the cells of a map whose submaps' log odds and weights add up to `sums` and `weights`; see `draw_submaps`."""
    known = weights >= _MIN_WEIGHT
    occupied = known & (sums > weights * np.float32(_log_odds(occupied_probability)))
    free = known & ~occupied & (sums < weights * np.float32(_log_odds(free_probability)))
    cells = np.full(sums.shape, OccupancyGrid.UNKNOWN, np.int8)
    cells[free] = OccupancyGrid.FREE
    cells[occupied] = OccupancyGrid.OCCUPIED
    return cells


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


@lru_cache(maxsize=1)
def log_odds_table() -> NDArray[np.float32]:
    """Return float32 (32768,), the log odds of each stored correspondence cost; 0 for unknown."""
    values = np.arange(1, 32768, dtype=np.uint16).reshape(1, -1)
    probabilities = ProbabilityGrid(values, 1.0, (0.0, 0.0)).probabilities()[0].astype(np.float64)
    return np.concatenate([[0.0], np.log(probabilities / (1.0 - probabilities))]).astype(np.float32)


def known_corners(
    grid: SubmapGrid, T_map_local: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the least and greatest x, y (metres, map) of a grid's known cells."""
    known = grid.cells != 0
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return None
    x = grid.origin[0] + grid.resolution_m * np.array([columns[0], columns[-1] + 1])
    y = grid.origin[1] + grid.resolution_m * np.array([rows[0], rows[-1] + 1])
    corners = se2.transform_points(T_map_local, [[x[i], y[j]] for i in (0, 1) for j in (0, 1)])
    return corners.min(axis=0), corners.max(axis=0)


def warm() -> None:
    """Compile the kernel."""
    grid = ProbabilityGrid(np.ones((2, 2), np.uint16), 1.0, (0.0, 0.0))
    draw_submaps([grid], np.zeros((1, 3)), 1.0)
