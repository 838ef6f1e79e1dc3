# SPDX-License-Identifier: MIT
"""Matching of points with 3D probability grids: least squares on a smooth grid, and an exhaustive search around a start.

References
----------
W. Hess, D. Kohler, H. Rapp, D. Andor, "Real-time loop closure in 2D LIDAR SLAM", ICRA 2016, doi:10.1109/ICRA.2016.7487258,
section IV-C, carried to three dimensions and two resolutions as the Cartographer project does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.hybrid_blocks import HybridBlocks
from slamcli.registration import _volume_kernels as kernels


@dataclass(frozen=True, slots=True, kw_only=True)
class VolumeMatch:
    """Weights of the least squares, as Cartographer's ``ceres_scan_matcher`` (3D) names them."""

    occupied_space_weight_0: float
    """Of the high-resolution points: each counts ``weight / sqrt(N)`` times one minus its probability."""
    occupied_space_weight_1: float
    translation_weight: float
    """Of the distance from the target, per metre."""
    rotation_weight: float
    """Of the rotation from the target: of the vector part of its quaternion."""
    only_optimize_yaw: bool = False
    max_num_iterations: int = 12


def align_with_volumes(
    high_points_m: NDArray[np.float64],
    low_points_m: NDArray[np.float64],
    high: HybridBlocks,
    low: HybridBlocks,
    T_grid_start: NDArray[np.float64],
    T_grid_target: NDArray[np.float64],
    settings: VolumeMatch,
) -> tuple[NDArray[np.float64], float]:
    """Return the pose of the points in the grids, float64 (4, 4), and half the sum of squares there.

    Parameters
    ----------
    high_points_m, low_points_m
        float64 (N, 3), (M, 3), metres, in the cloud's frame, for the grids of high and low resolution.
    T_grid_start, T_grid_target
        float64 (4, 4): where the search begins, and the pose to which the result is drawn.
    """
    high_points_m, low_points_m = np.ascontiguousarray(high_points_m), np.ascontiguousarray(low_points_m)
    rotation, shift = T_grid_start[:3, :3].copy(), T_grid_start[:3, 3].copy()
    weights = np.array(
        [
            settings.occupied_space_weight_0, settings.occupied_space_weight_1,
            settings.translation_weight, settings.rotation_weight,
        ]
    )  # fmt: skip
    cost, _ = kernels.align(
        high_points_m, low_points_m, _view(high), _view(low), weights, rotation, shift,
        np.ascontiguousarray(T_grid_target[:3, :3]), np.ascontiguousarray(T_grid_target[:3, 3]),
        settings.only_optimize_yaw, settings.max_num_iterations,
    )  # fmt: skip
    u, _, vt = np.linalg.svd(rotation)  # rounding must not add up over the iterations
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = u @ vt, shift
    return T, 0.5 * cost


def mean_probability(points_m: NDArray[np.float64], T_grid_points: NDArray[np.float64], grid: HybridBlocks) -> float:
    """Return the mean probability of the cells in which points (N, 3) lie; unknown cells count 0.1."""
    return float(
        kernels.mean_probability(
            np.ascontiguousarray(points_m),
            np.ascontiguousarray(T_grid_points[:3, :3]),
            np.ascontiguousarray(T_grid_points[:3, 3]),
            _view(grid),
        )
    )


def search_window(
    points_m: NDArray[np.float64],
    grid: HybridBlocks,
    T_grid_start: NDArray[np.float64],
    linear_m: float,
    angular_rad: float,
    cost_weights: tuple[float, float],
) -> tuple[NDArray[np.float64], float]:
    """Return the best pose of all within a window around the start, and its score (real-time correlative matching).

    Shifts are whole cells up to `linear_m` along each axis; rotations about the three axes up to `angular_rad`, in steps by
    which the farthest point moves no more than a cell. Scores are mean probabilities, lowered by
    ``exp(-(|shift| cost_weights[0] + |rotation| cost_weights[1])**2)``.
    """
    reach = max(float(np.sqrt((points_m**2).sum(axis=1)).max(initial=0.0)), 3.0 * grid.resolution_m)
    step = 0.999 * math.acos(1.0 - grid.resolution_m**2 / (2.0 * reach**2))
    shifts = _lattice(math.ceil(linear_m / grid.resolution_m), grid.resolution_m)
    turns = _lattice(math.ceil(angular_rad / step), step)
    score, s, t = kernels.best_of_window(
        points_m, _view(grid), np.ascontiguousarray(T_grid_start[:3, :3]), np.ascontiguousarray(T_grid_start[:3, 3]),
        shifts, turns, np.asarray(cost_weights, dtype=np.float64),
    )  # fmt: skip
    found = np.eye(4)
    found[:3, :3] = kernels.turned(np.eye(3), turns[t])
    found[:3, 3] = shifts[s]
    return T_grid_start @ found, float(score)


def _lattice(count: int, step: float) -> NDArray[np.float64]:
    """Return all (K, 3) combinations of ``-count ... count`` steps, the middle one first: of equals the nearest wins."""
    axis = np.arange(-count, count + 1)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    order = np.argsort((points**2).sum(axis=1), kind="stable")
    return np.asarray(points[order] * step, dtype=np.float64)


def _view(grid: HybridBlocks) -> tuple[float, NDArray[np.int64], NDArray[np.int64], NDArray[np.uint16]]:
    return grid.resolution_m, grid.keys, grid.blocks, grid.cells


def warm() -> None:
    """Compile the kernels of this module."""
    grid, point, here = HybridBlocks(0.1), np.ones((1, 3)), np.eye(4)
    settings = VolumeMatch(
        occupied_space_weight_0=1,
        occupied_space_weight_1=1,
        translation_weight=1,
        rotation_weight=1,
        max_num_iterations=1,
    )
    align_with_volumes(point, point, grid, grid, here, here, settings)
    mean_probability(point, here, grid)
    search_window(point, grid, here, 0.1, 0.01, (0.1, 0.1))
