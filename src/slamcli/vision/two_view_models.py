# SPDX-License-Identifier: MIT
"""Homography and fundamental matrix of two images by RANSAC on the same samples, and the motions that they allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.vision import _two_view_kernels as kernels
from slamcli.vision.sampling import draw_samples

Floats = NDArray[np.float64]

HOMOGRAPHY_LIMIT = 5.991
"""95 % of two degrees of freedom; also what an inlier of either model can gain."""
FUNDAMENTAL_LIMIT = 3.841
"""95 % of one degree of freedom: the distance from a line."""
REFITS = 3
"""How often the winner is fitted again to all its inliers, as long as its score grows."""


@dataclass(frozen=True, slots=True, eq=False)
class PairModel:
    """A relation between the pixels of two images."""

    matrix: Floats
    """(3, 3): of a homography, pixel_b ~ matrix @ pixel_a; of a fundamental matrix, pixel_b' matrix pixel_a = 0."""
    inliers: NDArray[np.bool_]
    """(N,)."""
    score: float
    """Sum of 5.991 - chi2 over inliers and both images: comparable between the two models."""


def fit_models(
    pixels_a: Floats, pixels_b: Floats, *, sigma_px: float, seed: int, iterations: int
) -> tuple[PairModel, PairModel]:
    """Return the homography and the fundamental matrix of highest score, fitted again to their inliers.

    Parameters
    ----------
    pixels_a, pixels_b
        float64 (N, 2), matched pixels, N >= 8.
    sigma_px
        Standard deviation of a pixel.
    seed, iterations
        Of the samples of eight matches (a homography takes the first four).

    References
    ----------
    R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, IEEE T-RO 31(5), 2015, doi:10.1109/TRO.2015.2463671, section IV.
    R. I. Hartley, "In defense of the eight-point algorithm", IEEE PAMI 19(6), 1997, doi:10.1109/34.601246.
    """
    a, b = np.ascontiguousarray(pixels_a, np.float64), np.ascontiguousarray(pixels_b, np.float64)
    (normal_a, N_a), (normal_b, N_b) = _normalised(a), _normalised(b)
    samples = draw_samples(len(a), 8, iterations, seed)
    h, f = np.empty((iterations, 9)), np.empty((iterations, 9))
    kernels.hypotheses(normal_a, normal_b, samples, h, f)
    weight = 1.0 / sigma_px**2
    homographies = np.linalg.inv(N_b) @ h.reshape(-1, 3, 3) @ N_a
    homography = _best(homographies, _score_homographies, a, b, weight)
    fundamental = _best(N_b.T @ _rank_two(f.reshape(-1, 3, 3)) @ N_a, _score_fundamentals, a, b, weight)
    for _ in range(REFITS):
        again = _refit(homography, homography_of, _score_homographies, a, b, weight)
        if again.score <= homography.score:
            break
        homography = again
    for _ in range(REFITS):
        again = _refit(fundamental, fundamental_of, _score_fundamentals, a, b, weight)
        if again.score <= fundamental.score:
            break
        fundamental = again
    return homography, fundamental


def homography_of(pixels_a: Floats, pixels_b: Floats) -> Floats:
    """Return the homography (3, 3) of least algebraic error of four or more matches (N, 2)."""
    (a, N_a), (b, N_b) = _normalised(pixels_a), _normalised(pixels_b)
    one, zero = np.ones(len(a)), np.zeros((len(a), 3))
    homogeneous = np.column_stack([a, one])
    rows = np.vstack(
        [
            np.hstack([zero, -homogeneous, b[:, 1:] * homogeneous]),
            np.hstack([homogeneous, zero, -b[:, :1] * homogeneous]),
        ]
    )
    return np.linalg.inv(N_b) @ _least(rows) @ N_a


def fundamental_of(pixels_a: Floats, pixels_b: Floats) -> Floats:
    """Return the fundamental matrix (3, 3), of rank 2, of least algebraic error of eight or more matches (N, 2)."""
    (a, N_a), (b, N_b) = _normalised(pixels_a), _normalised(pixels_b)
    homogeneous = np.column_stack([a, np.ones(len(a))])
    rows = np.hstack([b[:, :1] * homogeneous, b[:, 1:] * homogeneous, homogeneous])
    return N_b.T @ _rank_two(_least(rows)[None])[0] @ N_a


def motions_of_homography(homography: Floats, matrix: Floats) -> Floats:
    """Return the poses ``T_b_a`` (M, 4, 4), |t| = 1, that a homography of pixels allows: 8, or none for a pure rotation.

    References
    ----------
    O. Faugeras, F. Lustman, "Motion and structure from motion in a piecewise planar environment", IJPRAI 2(3), 1988,
    doi:10.1142/S0218001488000285.
    """
    u, (d1, d2, d3), vt = np.linalg.svd(np.linalg.inv(matrix) @ homography @ matrix)
    if d1 / max(d2, 1e-300) < 1.00001 or d2 / max(d3, 1e-300) < 1.00001:
        return np.empty((0, 4, 4))
    s = np.linalg.det(u) * np.linalg.det(vt)
    x1, x3 = np.sqrt((d1**2 - d2**2) / (d1**2 - d3**2)), np.sqrt((d2**2 - d3**2) / (d1**2 - d3**2))  # eq. 12
    product = np.sqrt((d1**2 - d2**2) * (d2**2 - d3**2))
    poses = []
    for e1, e3 in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        cosine, sine = (d2**2 + d1 * d3) / ((d1 + d3) * d2), e1 * e3 * product / ((d1 + d3) * d2)  # eq. 13, d' = d2
        turn = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
        poses.append(se3.from_rotation_translation(s * u @ turn @ vt, _unit(u @ [e1 * x1, 0, -e3 * x3])))
        cosine, sine = (d1 * d3 - d2**2) / ((d1 - d3) * d2), e1 * e3 * product / ((d1 - d3) * d2)  # eq. 15, d' = -d2
        turn = np.array([[cosine, 0, sine], [0, -1, 0], [sine, 0, -cosine]])
        poses.append(se3.from_rotation_translation(s * u @ turn @ vt, _unit(u @ [e1 * x1, 0, e3 * x3])))
    return np.array(poses)


def motions_of_fundamental(fundamental: Floats, matrix: Floats) -> Floats:
    """Return the four poses ``T_b_a`` (4, 4, 4), |t| = 1, that a fundamental matrix of pixels allows (K = `matrix`).

    References
    ----------
    R. Hartley, A. Zisserman, "Multiple view geometry in computer vision", 2nd ed., 2003, result 9.19.
    """
    u, _, vt = np.linalg.svd(matrix.T @ fundamental @ matrix)
    w = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotations = [np.linalg.det(u) * np.linalg.det(vt) * u @ turn @ vt for turn in (w, w.T)]
    return np.array([se3.from_rotation_translation(R, t) for R in rotations for t in (u[:, 2], -u[:, 2])])


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)


def _normalised(pixels: Floats) -> tuple[Floats, Floats]:
    """Return pixels with mean 0 and mean absolute deviation 1, and the matrix that makes them so."""
    mean = pixels.mean(axis=0)
    scale = 1.0 / np.maximum(np.abs(pixels - mean).mean(axis=0), 1e-9)
    matrix = np.array([[scale[0], 0, -mean[0] * scale[0]], [0, scale[1], -mean[1] * scale[1]], [0, 0, 1]])
    return np.ascontiguousarray((pixels - mean) * scale), matrix


def _rank_two(matrices: Floats) -> Floats:
    u, d, vt = np.linalg.svd(matrices)
    d[:, 2] = 0.0
    return (u * d[:, None, :]) @ vt


def _least(rows: Floats) -> Floats:
    """Return x (3, 3), |x| = 1, of least |rows x|."""
    _, vectors = np.linalg.eigh(rows.T @ rows)
    return vectors[:, 0].reshape(3, 3)


def _inverses(homographies: Floats) -> tuple[Floats, Floats]:
    """Return contiguous homographies and their inverses; singular ones become zeros, which explain nothing."""
    scaled = homographies / np.maximum(np.abs(homographies).max(axis=(1, 2), keepdims=True), 1e-300)
    bad = ~(np.abs(np.linalg.det(scaled)) > 1e-14)
    scaled[bad] = np.eye(3)
    back = np.linalg.inv(scaled)
    scaled[bad], back[bad] = 0.0, 0.0
    return np.ascontiguousarray(scaled), np.ascontiguousarray(back)


def _score_homographies(matrices: Floats, a: Floats, b: Floats, weight: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Return scores (K,) and the inliers (N,) of the best."""
    forth, back = _inverses(matrices)
    scores, inliers = np.empty(len(matrices)), np.empty(len(a), np.bool_)
    kernels.score_homographies(forth, back, a, b, weight, HOMOGRAPHY_LIMIT, scores)
    k = int(np.argmax(scores))
    kernels.homography_inliers(forth[k], back[k], a, b, weight, HOMOGRAPHY_LIMIT, inliers)
    return scores, inliers


def _score_fundamentals(matrices: Floats, a: Floats, b: Floats, weight: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Return scores (K,) and the inliers (N,) of the best."""
    matrices = np.ascontiguousarray(matrices)
    scores, inliers = np.empty(len(matrices)), np.empty(len(a), np.bool_)
    kernels.score_fundamentals(matrices, a, b, weight, FUNDAMENTAL_LIMIT, HOMOGRAPHY_LIMIT, scores)
    kernels.fundamental_inliers(matrices[int(np.argmax(scores))], a, b, weight, FUNDAMENTAL_LIMIT, inliers)
    return scores, inliers


Score = Callable[[Floats, Floats, Floats, float], tuple[Floats, NDArray[np.bool_]]]


def _best(matrices: Floats, score: Score, a: Floats, b: Floats, weight: float) -> PairModel:
    scores, inliers = score(matrices, a, b, weight)
    k = int(np.argmax(scores))
    return PairModel(matrices[k], inliers, float(scores[k]))


def _refit(
    model: PairModel, fit: Callable[[Floats, Floats], Floats], score: Score, a: Floats, b: Floats, weight: float
) -> PairModel:
    """Return the model fitted to its inliers; itself where they are too few."""
    if np.count_nonzero(model.inliers) < 8:
        return model
    return _best(fit(a[model.inliers], b[model.inliers])[None], score, a, b, weight)
