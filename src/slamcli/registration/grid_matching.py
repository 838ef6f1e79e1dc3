# SPDX-License-Identifier: MIT
"""Alignment of scans with the grid of a submap: least squares on the interpolated grid, and exhaustive search in a window."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.probability_grid import ProbabilityGrid, cost_of
from slamcli.grids.submap_grid import SubmapGrid
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.registration import _grid_kernels as _kernels

_SPREAD_STEP_M, _SPREAD_TEMPERATURE = 0.2, 0.02
_FIT_CELLS = 3.0
_NO_WEIGHTS = np.empty((0, 0), np.uint16)


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastSquaresMatch:
    """Weights of the nonlinear least squares match (Hess et al., ICRA 2016, equation CS), with a pull to the prediction."""

    occupied_space_weight: float = 1.0
    translation_weight: float = 10.0
    rotation_weight: float = 40.0
    max_num_iterations: int = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrelativeMatch:
    """Window and penalties of the real-time correlative match (Olson, ICRA 2009)."""

    linear_search_window_m: float = 0.1
    angular_search_window_rad: float = math.radians(20.0)
    translation_delta_cost_weight: float = 0.1
    rotation_delta_cost_weight: float = 0.1


def match_least_squares(
    grid: SubmapGrid,
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    prior: NDArray[np.float64],
    settings: LeastSquaresMatch,
) -> tuple[NDArray[np.float64], float]:
    """Return the pose (3,) at which the points lie best on surfaces, and the cost of the grid term.

    Minimises ``1/2 (w_o^2 / N sum r_k^2 + w_t^2 |t - t_prior|^2 + w_r^2 (yaw - yaw_prior)^2)`` by Levenberg-Marquardt from
    `start`. On a grid of probabilities ``r_k = 1 - M(T p_k)``, where M is their bicubic interpolation. On signed distances
    ``r_k = N D(T p_k) W(T p_k) / sum_i W(T p_i)``, where D and W are the bilinear interpolations of the distances, metres, and
    of their weights; where no point lies on a known cell, the start is returned and the cost is infinite.

    Parameters
    ----------
    points : float64 (N, 2), in the frame whose pose is sought, metres.
    start, prior : float64 (3,), x, y, yaw in the grid's frame.
    """
    s = settings
    x, y, yaw, cost = _kernels.match(
        grid.cells, _weights(grid), _residual_table(grid), *grid.origin, 1.0 / grid.resolution_m, points, start, prior,
        s.occupied_space_weight, s.translation_weight, s.rotation_weight, s.max_num_iterations,
    )  # fmt: skip
    return np.array([x, y, yaw]), cost


def match_correlative(
    grid: SubmapGrid, points: NDArray[np.float64], prior: NDArray[np.float64], settings: CorrelativeMatch
) -> tuple[NDArray[np.float64], float]:
    """Return the best pose (3,) of a window around the prior, and its score: mean score times a penalty for the distance.

    The mean is that of `mean_probability`; on signed distances, as in Cartographer, it falls up to the truncation distance
    and is weighted by the cells' weights, so that unknown cells do not count. The angular step moves the farthest point by
    one cell. Without points that is the prior, with a score of 0.
    """
    if len(points) == 0:
        return prior.copy(), 0.0
    s = settings
    step = angular_step(grid.resolution_m, float(np.hypot(points[:, 0], points[:, 1]).max()))
    table = _fit_table(1.0) if isinstance(grid, TsdfGrid) else probability_table()
    x, y, yaw, best = _kernels.best_in_window(
        grid.cells, _weights(grid), table, *grid.origin, 1.0 / grid.resolution_m, points, prior,
        math.ceil(s.linear_search_window_m / grid.resolution_m), grid.resolution_m,
        math.ceil(s.angular_search_window_rad / step), step, s.translation_delta_cost_weight, s.rotation_delta_cost_weight,
    )  # fmt: skip
    return np.array([x, y, yaw]), best


def mean_probability(grid: SubmapGrid, points: NDArray[np.float64], pose: NDArray[np.float64]) -> float:
    """Return the mean score, 0.1 to 0.9, of the cells in which points (N, 2) fall when seen from `pose` (3,).

    That is the probability that a cell is occupied. Of signed distances it is 0.9 on a surface and falls linearly to 0.1 at
    three cells from it: then scores of right and of wrong places are about those of probabilities (mit-csail, aces), and
    the same least score parts them; over the truncation distance, wrong places reach 0.6.
    """
    return float(
        _kernels.score(grid.cells, score_table(grid), *grid.origin, 1.0 / grid.resolution_m, points, *pose.tolist())
    )


def position_spread(
    grid: SubmapGrid, points: NDArray[np.float64], pose: NDArray[np.float64], window_m: float
) -> NDArray[np.float64]:
    """Return the covariance float64 (2, 2), m^2, of the positions about `pose` at which the points fit about as well.

    Positions on a raster of 0.2 m within `window_m` weigh by exp((score - score at the pose) / 0.02): along a corridor,
    or between doors that look alike, the covariance is large (after Olson, ICRA 2009, on the covariance of a match).
    """
    step = max(1, round(_SPREAD_STEP_M / grid.resolution_m))
    half = max(1, math.ceil(window_m / (step * grid.resolution_m)))
    moments = np.empty(5)
    _kernels.spread(
        grid.cells, score_table(grid), *grid.origin, 1.0 / grid.resolution_m, points, pose, half, step,
        _SPREAD_TEMPERATURE, moments,
    )  # fmt: skip
    xx, xy, yy = moments[2:] * grid.resolution_m**2
    return np.array([[xx, xy], [xy, yy]])


def angular_step(resolution_m: float, farthest_m: float) -> float:
    """Return the turn in radians that moves a point at that distance by one cell (section V-B of the paper)."""
    distance = max(farthest_m, 3.0 * resolution_m)
    return 0.99 * math.acos(1.0 - resolution_m**2 / (2.0 * distance**2))


@lru_cache(maxsize=1)
def cost_table() -> NDArray[np.float32]:
    """Return float32 (32768,), the cost by stored value; unknown cells cost as much as free ones."""
    table = cost_of(np.arange(32768, dtype=np.uint16))
    table[0] = ProbabilityGrid.MAX_COST
    return table


@lru_cache(maxsize=1)
def probability_table() -> NDArray[np.float32]:
    """Return float32 (32768,), the probability by stored value."""
    return (np.float32(1.0) - cost_table()).astype(np.float32)


def score_table(grid: SubmapGrid) -> NDArray[np.float32]:
    """Return float32 (32768,), by stored value how well a point fits into a cell, 0.1 (or unknown) to 0.9."""
    if not isinstance(grid, TsdfGrid):
        return probability_table()
    return _fit_table(min(_FIT_CELLS * grid.resolution_m / grid.truncation_distance_m, 1.0))


@lru_cache(maxsize=8)
def _fit_table(reach: float) -> NDArray[np.float32]:
    """Return the scores of signed distances, least from `reach` on, a part of the truncation distance."""
    sizes = np.abs(np.concatenate([[1.0], np.linspace(-1.0, 1.0, 32767)]))
    span = ProbabilityGrid.MAX_COST - ProbabilityGrid.MIN_COST
    return (ProbabilityGrid.MAX_COST - span * np.minimum(sizes / reach, 1.0)).astype(np.float32)


def _residual_table(grid: SubmapGrid) -> NDArray[np.float32]:
    return grid.distance_table() if isinstance(grid, TsdfGrid) else cost_table()


def _weights(grid: SubmapGrid) -> NDArray[np.uint16]:
    return grid.weights if isinstance(grid, TsdfGrid) else _NO_WEIGHTS


def warm() -> None:
    """Compile the kernels of this module with one point."""
    grid = ProbabilityGrid.empty(0.05, (0.0, 0.0), 8)
    point, pose = np.zeros((1, 2)), np.zeros(3)
    match_least_squares(grid, point, pose, pose, LeastSquaresMatch())
    match_correlative(grid, point, pose, CorrelativeMatch())
    mean_probability(grid, point, pose)
    position_spread(grid, point, pose, 0.2)
