# SPDX-License-Identifier: MIT
"""Pose of a camera from points of the map that it may see: P3P in RANSAC, refined on the inliers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.vision import _pnp_kernels as kernels
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.pose_optimisation import optimise_pose
from slamcli.vision.sampling import draw_samples

CHI2_LIMIT = 5.991
"""95 % of two degrees of freedom."""
CONFIDENCE = 0.99
"""Probability with which a sample without outliers has been drawn when the search stops early."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PnpResult:
    """Where a camera stands, found without a guess."""

    T_camera_map: NDArray[np.float64]
    """(4, 4)."""
    inliers: NDArray[np.bool_]
    """(N,), matches that the pose explains (chi2 <= 5.991)."""
    num_iterations: int
    """Samples that were tried."""


def estimate_pose_pnp(
    points: NDArray[np.float64],
    pixels: NDArray[np.float64],
    sigmas: NDArray[np.float64],
    camera: Pinhole,
    *,
    seed: int,
    iterations: int = 300,
    min_inliers: int = 10,
    right: NDArray[np.float64] | None = None,
) -> PnpResult:
    """Return the pose that most matches of points and pixels agree on.

    Each sample of three matches gives up to four poses (Lambda Twist); the one with the least truncated chi2 over all
    matches wins and is refined twice on its inliers with `optimise_pose`, which uses `right` too.

    Parameters
    ----------
    points
        float64 (N, 3), metres, map frame.
    pixels, sigmas
        float64 (N, 2) and (N,), pixels of the ideal camera and their standard deviations.
    camera
        The camera.
    seed
        Of the samples: the same input and seed give the same pose.
    iterations
        Samples at most.
    min_inliers
        Fewer are no result.
    right
        float64 (N,), columns in the right image, NaN where unknown; None: a mono camera.

    Raises
    ------
    EstimationError
        If no pose has `min_inliers` inliers; the message holds how many the best one has.
    DataError
        If the shapes do not fit.

    Notes
    -----
    Points on one line, or a share of inliers below (1 - 0.01^(1 / iterations))^(1/3) (25 % for 300), are beyond it.

    References
    ----------
    M. Persson, K. Nordberg, "Lambda Twist: an accurate fast robust perspective three point (P3P) solver", ECCV 2018,
    doi:10.1007/978-3-030-01225-0_20.
    P. H. S. Torr, A. Zisserman, "MLESAC", CVIU 78(1), 2000, doi:10.1006/cviu.1999.0832 (the truncated cost).
    """
    count = len(points)
    points, pixels = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(pixels, np.float64)
    sigmas = np.ascontiguousarray(sigmas, np.float64)
    if points.shape != (count, 3) or pixels.shape != (count, 2) or sigmas.shape != (count,):
        raise DataError(f"PnP: points {points.shape}, pixels {pixels.shape} and sigmas {sigmas.shape} do not fit")
    if count < max(min_inliers, 4):
        raise EstimationError(f"PnP: {count} matches, fewer than {max(min_inliers, 4)}")
    right = np.full(count, np.nan) if right is None else np.ascontiguousarray(right, np.float64)
    weights = 1.0 / (sigmas * sigmas)
    T = np.eye(4)
    samples = draw_samples(count, 3, iterations, seed)
    tried, found = kernels.ransac(
        points, pixels, weights, camera.array, samples, CHI2_LIMIT, math.log1p(-CONFIDENCE), T[:3]
    )
    if found < min(min_inliers, 4):
        raise EstimationError(f"PnP: the best pose has {found} inliers of {count} matches")
    inliers = _inliers(T, points, pixels, weights, camera)
    for _ in range(2):
        chosen = np.flatnonzero(inliers)
        if len(chosen) < 4:
            break
        T = optimise_pose(
            T, points[chosen], pixels[chosen], right[chosen], sigmas[chosen], camera, rounds=2
        ).T_camera_map
        inliers = _inliers(T, points, pixels, weights, camera)
    if np.count_nonzero(inliers) < min_inliers:
        raise EstimationError(
            f"PnP: the best pose has {np.count_nonzero(inliers)} inliers of {count} matches, fewer than {min_inliers}"
        )
    return PnpResult(T_camera_map=T, inliers=inliers, num_iterations=tried)


def _inliers(
    T_camera_map: NDArray[np.float64],
    points: NDArray[np.float64],
    pixels: NDArray[np.float64],
    weights: NDArray[np.float64],
    camera: Pinhole,
) -> NDArray[np.bool_]:
    """Return which matches a pose explains, (N,)."""
    points_camera = points @ T_camera_map[:3, :3].T + T_camera_map[:3, 3]
    ahead = points_camera[:, 2] > 0.0
    points_camera[~ahead, 2] = 1.0
    errors = camera.project(points_camera) - pixels
    return ahead & ((errors * errors).sum(axis=1) * weights <= CHI2_LIMIT)


def warm() -> None:
    """Compile the kernels of this module."""
    rng = np.random.default_rng(0)
    camera = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=50.0, width=100, height=100)
    points = rng.uniform([-1, -1, 2], [1, 1, 5], (12, 3))
    estimate_pose_pnp(points, camera.project(points), np.ones(12), camera, seed=0)
