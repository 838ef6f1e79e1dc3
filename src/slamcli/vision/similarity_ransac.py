# SPDX-License-Identifier: MIT
"""How one part of a map lies on another: Sim(3) or SE(3) from matched points of two keyframes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.geometry.alignment import Similarity
from slamcli.vision import _similarity_kernels as kernels
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.sampling import draw_samples

Floats = NDArray[np.float64]

CHI2_LIMIT = 9.210
"""99 % of two degrees of freedom."""
CONFIDENCE = 0.99
"""Probability with which a sample without outliers has been drawn when the search stops early."""
REFITS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SidedPoints:
    """Matched points as one camera knows them, N rows."""

    points_camera: Floats
    """(N, 3), metres (of its map), in this camera's frame."""
    pixels: Floats
    """(N, 2), where this camera sees them."""
    sigmas: Floats
    """(N,), standard deviations of the pixels."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimilarityMatch:
    """The similarity of two keyframes."""

    S_1_2: Similarity
    """p_1 = S_1_2 p_2 between the cameras' frames; scale 1 where it was fixed."""
    inliers: NDArray[np.bool_]
    """(N,), matches that reproject well in both images (chi2 <= 9.210)."""
    num_iterations: int
    """Samples that were tried."""


def estimate_similarity(
    side_1: SidedPoints,
    side_2: SidedPoints,
    camera: Pinhole,
    *,
    fix_scale: bool,
    seed: int,
    iterations: int = 300,
    min_inliers: int = 15,
) -> SimilarityMatch:
    """Return the similarity that most matched points agree on, fitted to its inliers.

    Each sample of three matches gives a similarity (Horn's closed form); it is judged by projecting each point through it
    into the other image, both ways. The one with the least truncated chi2 is fitted again to its inliers while that helps.

    Parameters
    ----------
    side_1, side_2
        The matches from both cameras, row by row.
    camera
        Of both images.
    fix_scale
        SE(3): maps of stereo and RGB-D cameras have metres; Sim(3): those of a mono camera have a scale of their own.
    seed, iterations
        Of the samples: the same input and seed give the same similarity.
    min_inliers
        Fewer are no result.

    Raises
    ------
    EstimationError
        If no similarity has `min_inliers` inliers; the message holds how many the best one has.
    DataError
        If the shapes do not fit.

    References
    ----------
    B. K. P. Horn, "Closed-form solution of absolute orientation using unit quaternions", JOSA A 4(4), 1987,
    doi:10.1364/JOSAA.4.000629.
    C. Campos et al., "ORB-SLAM3", IEEE T-RO 37(6), 2021, doi:10.1109/TRO.2021.3075644, section VI.
    """
    count = len(side_1.pixels)
    arrays = [*_columns(side_1, count), *_columns(side_2, count)]
    if count < max(3, min_inliers):
        raise EstimationError(f"similarity: {count} matches, fewer than {max(3, min_inliers)}")
    first, pixels_1, weights_1, second, pixels_2, weights_2 = arrays
    judged = (first, second, pixels_1, pixels_2, weights_1, weights_2, camera.array)
    best, inliers = np.zeros((3, 5)), np.empty(count, np.bool_)
    samples = draw_samples(count, 3, iterations, seed)
    tried = kernels.ransac(*judged, samples, CHI2_LIMIT, math.log1p(-CONFIDENCE), fix_scale, best, inliers)
    again, agree = np.zeros((3, 5)), np.empty(count, np.bool_)
    cost = kernels.judge(best, *judged, CHI2_LIMIT, agree)
    for _ in range(REFITS):
        if not kernels.horn(first[inliers], second[inliers], fix_scale, again):
            break
        refitted = kernels.judge(again, *judged, CHI2_LIMIT, agree)
        if refitted >= cost:
            break
        cost, best, inliers = refitted, again.copy(), agree.copy()
    found = int(np.count_nonzero(inliers))
    if found < min_inliers:
        raise EstimationError(
            f"similarity: the best one has {found} inliers of {count} matches, fewer than {min_inliers}"
        )
    return SimilarityMatch(
        S_1_2=Similarity(best[:, :3].copy(), best[:, 3].copy(), float(best[0, 4])),
        inliers=inliers,
        num_iterations=tried,
    )


def _columns(side: SidedPoints, count: int) -> tuple[Floats, Floats, Floats]:
    """Return points, pixels and weights of one side, contiguous."""
    points = np.ascontiguousarray(side.points_camera, np.float64)
    pixels, sigmas = np.ascontiguousarray(side.pixels, np.float64), np.asarray(side.sigmas, np.float64)
    if points.shape != (count, 3) or pixels.shape != (count, 2) or sigmas.shape != (count,):
        raise DataError(
            f"similarity: points {points.shape}, pixels {pixels.shape} and sigmas {sigmas.shape} do not fit"
        )
    return points, pixels, 1.0 / (sigmas * sigmas)


def warm() -> None:
    """Compile the kernels of this module."""
    rng = np.random.default_rng(0)
    camera = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=50.0, width=100, height=100)
    points = rng.uniform([-1, -1, 2], [1, 1, 5], (8, 3))
    side = SidedPoints(points_camera=points, pixels=camera.project(points), sigmas=np.ones(8))
    estimate_similarity(side, side, camera, fix_scale=True, seed=0, min_inliers=3)
