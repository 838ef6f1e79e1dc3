# SPDX-License-Identifier: MIT
"""Similarity of two keyframes, refined by the reprojection errors of their matched points in both images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.geometry.alignment import Similarity
from slamcli.vision import _similarity_refinement_kernels as kernels
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.similarity_ransac import SidedPoints

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
CHI2_LIMIT = 10.0
"""Squared residual over squared sigma in either image up to which a match counts (ORB-SLAM's own)."""
START = 1e-6  # damping in the beginning, as a share of the diagonal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimilarityEstimate:
    """How one keyframe's camera lies in the other's, and which matches agree."""

    S_1_2: Similarity
    """p_1 = S_1_2 p_2 between the cameras' frames."""
    inliers: Flags
    """bool (N,): within the limit in both images, and ahead of both cameras."""
    chi2: Floats
    """float64 (N, 2): of the second camera's point in the first image, and the other way round."""
    information: Floats
    """float64 (7, 7): J'J of the inliers, of the increment (phi, rho, sigma) in the first camera's axes:
    p_1 becomes e^sigma Exp(phi) p_1 + rho. With a fixed scale the last row and column are 0."""

    @property
    def num_inliers(self) -> int:
        """How many matches agree."""
        return int(np.count_nonzero(self.inliers))


def optimise_similarity(
    S_1_2: Similarity,
    side_1: SidedPoints,
    side_2: SidedPoints,
    camera: Pinhole,
    *,
    fix_scale: bool,
    iterations: int = 5,
    chi2_limit: float = CHI2_LIMIT,
    min_inliers: int = 10,
) -> SimilarityEstimate:
    """Return the similarity that minimises the reprojection errors of matches in both images.

    Parameters
    ----------
    S_1_2 : where to begin, p_1 = S_1_2 p_2 between the cameras' frames.
    side_1, side_2 : the matches from both cameras, row by row.
    camera : of both images.
    fix_scale : SE(3) instead of Sim(3): the scale stays as given.
    iterations : with Huber's loss; then outliers are taken out and as many follow (twice as many if there were any).
    chi2_limit : bound of an inlier in each image, and of Huber's loss.
    min_inliers : fewer are no result.

    Raises
    ------
    EstimationError
        If fewer matches agree, before or after; the message holds how many.
    DataError
        If the shapes do not fit.

    Notes
    -----
    The points stay where they are; only the similarity moves (Mur-Artal and Tardós, "Visual-inertial monocular SLAM with
    map reuse", RA-L 2017, appendix B).
    """
    sides = _columns(side_1, side_2)
    count = len(sides[0])
    state = np.concatenate([np.asarray(S_1_2.rotation).ravel(), S_1_2.translation_m, [S_1_2.scale]]).astype(np.float64)
    active: Flags = np.ones(count, np.bool_)
    for turn in range(2):
        more = iterations if turn == 0 or active.all() else 2 * iterations
        state, chi2, information = _descend(
            state, (*sides, camera.array), active, chi2_limit, more, fix_scale, turn == 0
        )
        active = np.all(chi2 <= chi2_limit, axis=1)
        if np.count_nonzero(active) < min_inliers:
            raise EstimationError(
                f"similarity: {np.count_nonzero(active)} of {count} matches agree with it, fewer than {min_inliers}"
            )
    scratch, hessian = np.zeros_like(chi2), np.zeros((7, 7))
    kernels.linearise(state, *sides, camera.array, chi2_limit, False, active, scratch, hessian, np.zeros(7))
    information = _scaled(hessian, fix_scale)
    rotation = state[:9].reshape(3, 3)
    return SimilarityEstimate(
        S_1_2=Similarity(rotation @ (3 * np.eye(3) - rotation.T @ rotation) / 2, state[9:12].copy(), float(state[12])),
        inliers=active, chi2=np.where(chi2 < kernels.BEHIND, chi2, np.inf), information=information,
    )  # fmt: skip


def _descend(
    state: Floats, data: tuple[Floats, ...], active: Flags, bound: float, iterations: int, fix_scale: bool, robust: bool
) -> tuple[Floats, Floats, Floats]:
    """Return the state (13,), chi2 (N, 2) and the normal matrix (7, 7) after at most so many steps."""
    chi2, hessian, gradient = np.zeros((len(data[0]), 2)), np.zeros((7, 7)), np.zeros(7)
    other_chi2, other_hessian, other_gradient = chi2.copy(), hessian.copy(), gradient.copy()
    trial, damping = np.empty(13), START
    cost = kernels.linearise(state, *data, bound, robust, active, chi2, hessian, gradient)
    for _ in range(iterations):
        matrix = _scaled(hessian, fix_scale)
        diagonal = np.diag(matrix)
        matrix = matrix + np.diag(damping * np.maximum(diagonal, 1e-9 * diagonal.max()) + (diagonal <= 0))
        delta = -np.linalg.solve(matrix, np.where(np.arange(7) == 6, 0.0, gradient) if fix_scale else gradient)
        kernels.move(state, delta, trial)
        other = kernels.linearise(trial, *data, bound, robust, active, other_chi2, other_hessian, other_gradient)
        if other > cost:
            damping *= 10
            continue
        settled = cost - other <= 1e-7 * cost
        state, cost, damping = trial.copy(), other, max(0.1 * damping, 1e-9)
        chi2, other_chi2 = other_chi2, chi2
        hessian, other_hessian = other_hessian, hessian
        gradient, other_gradient = other_gradient, gradient
        if settled:
            break
    return state, chi2, hessian


def _scaled(hessian: Floats, fix_scale: bool) -> Floats:
    """Return the matrix, without what concerns the scale if that is fixed."""
    if not fix_scale:
        return hessian.copy()
    out = np.zeros((7, 7))
    out[:6, :6] = hessian[:6, :6]
    return out


def _columns(side_1: SidedPoints, side_2: SidedPoints) -> tuple[Floats, ...]:
    """Return points, pixels and weights (of the first, then the second side each), contiguous."""
    count = len(side_1.pixels)
    out: list[tuple[Floats, Floats, Floats]] = []
    for name, side in (("side_1", side_1), ("side_2", side_2)):
        points, pixels = np.asarray(side.points_camera, np.float64), np.asarray(side.pixels, np.float64)
        sigmas = np.asarray(side.sigmas, np.float64)
        if points.shape != (count, 3) or pixels.shape != (count, 2) or sigmas.shape != (count,):
            raise DataError(
                f"similarity: {name} has points {points.shape}, pixels {pixels.shape} and sigmas {sigmas.shape}, {count} rows "
                "of each are wanted"
            )
        out.append((np.ascontiguousarray(points), np.ascontiguousarray(pixels), 1.0 / (sigmas * sigmas)))
    (first, pixels_1, weights_1), (second, pixels_2, weights_2) = out
    return first, second, pixels_1, pixels_2, weights_1, weights_2


def warm() -> None:
    """Compile the kernels of this module."""
    points = np.random.default_rng(0).uniform([-1, -1, 2], [1, 1, 5], (8, 3))
    camera = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=50.0, width=100, height=100)
    side = SidedPoints(points_camera=points, pixels=camera.project(points), sigmas=np.ones(8))
    optimise_similarity(Similarity(np.eye(3), np.zeros(3)), side, side, camera, fix_scale=False, min_inliers=3)
