# SPDX-License-Identifier: MIT
"""How well a map agrees with a reference map, once it lies on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from slamcli.errors import EstimationError, UsageError
from slamcli.evaluation.map_layers import MapLayers
from slamcli.evaluation.statistics import Statistics
from slamcli.geometry import se2

_ROWS = 256
_SSIM_SIGMA, _SSIM_MARGIN = 1.5, 6
_SSIM_C1, _SSIM_C2 = 0.01**2, 0.03**2


@dataclass(frozen=True, slots=True, eq=False)
class MapErrors:
    """Figures on two maps; shares are between 0 and 1."""

    to_reference_m: NDArray[np.float64]
    """float64 (K,), distance from each wall cell of the map to the nearest wall cell of the reference, metres."""
    to_map_m: NDArray[np.float64]
    """float64 (M,), distance from each wall cell of the reference to the nearest wall cell of the map, metres."""
    tolerance_m: float
    agreement: float
    """Share of the cells known in both maps that are of the same kind (free or occupied)."""
    occupied_iou: float
    """Cells occupied in both maps over cells occupied in one or both, of those known in both."""
    free_iou: float
    """The same of free cells."""
    coverage: float
    """Share of the reference's known cells that are known in the map."""
    ssim: float
    """Mean structural similarity of the two pictures over the cells known in either."""

    @property
    def accuracy(self) -> float:
        """Share of the map's walls within the tolerance of a wall of the reference."""
        return float((self.to_reference_m <= self.tolerance_m).mean())

    @property
    def completeness(self) -> float:
        """Share of the reference's walls within the tolerance of a wall of the map."""
        return float((self.to_map_m <= self.tolerance_m).mean())

    @property
    def f_score(self) -> float:
        """Harmonic mean of accuracy and completeness."""
        total = self.accuracy + self.completeness
        return 2 * self.accuracy * self.completeness / total if total > 0 else 0.0


@dataclass(frozen=True, slots=True)
class WallDistance:
    """Figures on distances between walls, metres."""

    mean: float
    median: float
    p95: float
    max: float
    rmse: float

    @classmethod
    def of(cls, distances_m: NDArray[np.float64]) -> WallDistance:
        """Return the figures of distances (N,)."""
        s = Statistics.of(distances_m)
        return cls(s.mean, s.median, float(np.percentile(distances_m, 95)), s.max, s.rmse)


def map_errors(
    layers: MapLayers, reference: MapLayers, T_reference_map: NDArray[np.float64], *, tolerance_m: float
) -> MapErrors:
    """Return the figures of a map that lies at a pose in the frame of a reference map.

    Parameters
    ----------
    layers, reference
        The maps.
    T_reference_map
        float64 (3,), where the map lies: see `slamcli.evaluation.map_registration.register`.
    tolerance_m
        Distance up to which two walls are the same, metres.

    Raises
    ------
    UsageError
        If the tolerance is not positive.
    EstimationError
        If the two maps know no cell in common.

    References
    ----------
    Z. Wang et al., "Image quality assessment: from error visibility to structural similarity", IEEE TIP 13(4), 2004,
    doi:10.1109/TIP.2003.819861 (Gaussian window of 1.5 cells, K1 = 0.01, K2 = 0.03).
    """
    if not tolerance_m > 0:
        raise UsageError(f"tolerance {tolerance_m:g} m must be a positive number")
    walls = se2.transform_points(T_reference_map, layers.walls_m)
    to_reference, _ = cKDTree(reference.walls_m).query(walls)
    to_map, _ = cKDTree(walls).query(reference.walls_m)
    free, occupied = _on_reference(layers, reference, T_reference_map)
    both = (free | occupied) & reference.known
    if not both.any():
        raise EstimationError("the two maps know no cell in common")
    same = (free & reference.free) | (occupied & reference.occupied)
    picture = _picture(free, occupied), _picture(reference.free, reference.occupied)
    return MapErrors(
        to_reference_m=to_reference,
        to_map_m=to_map,
        tolerance_m=tolerance_m,
        agreement=float(same[both].mean()),
        occupied_iou=_iou(occupied & both, reference.occupied & both),
        free_iou=_iou(free & both, reference.free & both),
        coverage=float((both & reference.known).sum() / reference.known.sum()),
        ssim=_ssim(*picture, free | occupied | reference.known),
    )


def _on_reference(
    layers: MapLayers, reference: MapLayers, T_reference_map: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which cells of the reference's grid are free and occupied in the map: the map's cell at each cell's centre."""
    shape = reference.occupied.shape
    (x0, y0), (x_column, y_column), (x_row, y_row) = _cells_of_map(layers, reference, T_reference_map)
    columns = np.arange(shape[1])
    free, occupied = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    for top in range(0, shape[0], _ROWS):
        rows = np.arange(top, min(top + _ROWS, shape[0]))[:, None]
        column = np.floor(x0 + columns * x_column + rows * x_row).astype(np.int64)
        row = np.floor(y0 + columns * y_column + rows * y_row).astype(np.int64)
        inside = (row >= 0) & (row < layers.grid.height) & (column >= 0) & (column < layers.grid.width)
        row, column = row[inside], column[inside]
        free[top : top + _ROWS][inside] = layers.free[row, column]
        occupied[top : top + _ROWS][inside] = layers.occupied[row, column]
    return free, occupied


def _cells_of_map(
    layers: MapLayers, reference: MapLayers, T_reference_map: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return where in the map's cells the reference's first cell has its centre, and the steps to its right and upper one."""
    corners = reference.grid.cell_to_map([[0, 0], [0, 1], [1, 0]])
    local = se2.transform_points(se2.inverse(se2.compose(T_reference_map, layers.grid.origin)), corners)
    start, right, up = local / layers.grid.resolution_m
    return start, right - start, up - start


def _iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    union = int((a | b).sum())
    return float((a & b).sum() / union) if union else 1.0


def _picture(free: NDArray[np.bool_], occupied: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.where(occupied, 0.0, np.where(free, 1.0, 0.5))


def _ssim(a: NDArray[np.float64], b: NDArray[np.float64], known: NDArray[np.bool_]) -> float:
    """Return the mean structural similarity of two pictures over the known cells."""
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    box = tuple(slice(max(int(s[0]) - _SSIM_MARGIN, 0), int(s[-1]) + _SSIM_MARGIN + 1) for s in (rows, columns))
    a, b, known = a[box], b[box], known[box]

    def blurred(image: NDArray[np.float64]) -> NDArray[np.float64]:
        result: NDArray[np.float64] = ndimage.gaussian_filter(image, _SSIM_SIGMA, truncate=3.5)
        return result

    mean_a, mean_b = blurred(a), blurred(b)
    variances = blurred(a * a) - mean_a**2 + blurred(b * b) - mean_b**2
    covariance = blurred(a * b) - mean_a * mean_b
    above = (2 * mean_a * mean_b + _SSIM_C1) * (2 * covariance + _SSIM_C2)
    below = (mean_a**2 + mean_b**2 + _SSIM_C1) * (variances + _SSIM_C2)
    return float((above[known] / below[known]).mean())
