# SPDX-License-Identifier: MIT
"""Two cameras and what both see: refined together, and how well their motion is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from slamcli.geometry import se3
from slamcli.vision.bundle_adjustment import adjust_in_rounds
from slamcli.vision.bundle_problem import BundleProblem
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
POINT_STEPS = 3
CALIBRATED_RATIO = 4
"""Vis/PnPVarianceMedianRatio at which covariances are unbiased for Gaussian errors."""
CELLS = 16
"""Cells along the image's width within which errors are alike: the same edge, the same piece of the depth image."""
REGIONS = 5
"""Regions along the image's width, each of which is left out in turn."""
DOUBTED = 6
"""One cell in so many may be wrong although it agrees, and two at least."""
KEPT_SHARE = 0.5
"""Of what evenly spread cells tell, so much is left without those that tell most."""
SYSTEMATIC = 0.01
"""rad, and share of the depth: errors that all matches share, as those of the calibration and the shutter."""
MEDIAN_FACTOR = 2.1981
"""Square of 1.4826: from the median of squared errors to their variance."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SharedView:
    """N matches of two places, as rows."""

    points: Floats
    """float64 (N, 3), metres, base frame of a."""
    a: Features
    """N features, as the next."""
    b: Features
    sigma_px: float
    """Standard deviation of a pixel at the finest octave."""
    camera: Pinhole
    T_camera_base: Floats

    @property
    def index(self) -> NDArray[np.int64]:
        """int64 (N,): 0, 1, 2 ..."""
        return np.arange(len(self.points))


def adjust_pair(view: SharedView, T_a_b: Floats) -> Floats:
    """Return the refined ``T_a_b``: both cameras' pixels and depths count, camera a stays."""
    count = len(view.points)
    poses = np.stack([view.T_camera_base, view.T_camera_base @ se3.inverse(T_a_b)])
    problem = BundleProblem(
        T_camera_map=poses, fixed=np.array([True, False]), points=view.points,
        camera_index=np.repeat([0, 1], count), point_index=np.tile(view.index, 2),
        pixels=np.concatenate([view.a.pixels, view.b.pixels]), right=np.concatenate([view.a.right, view.b.right]),
        sigmas=view.sigma_px * np.concatenate([view.a.sigmas, view.b.sigmas]), camera=view.camera,
    )  # fmt: skip
    result = adjust_in_rounds(problem)
    return se3.inverse(result.T_camera_map[1]) @ view.T_camera_base


def agreeing(view: SharedView, T_a_b: Floats, factor: float) -> NDArray[np.bool_]:
    """Return which matches (N,) some point explains at this motion: squared errors up to `factor` times the 95 % bound.

    The points as camera a alone knows them say less: their depth may be off by far more than a pixel from elsewhere.
    """
    T_camera_b = view.T_camera_base @ se3.inverse(T_a_b)
    points = _eliminated(view, T_a_b, T_camera_b)
    residuals, _, _ = _linearised(view, T_a_b, T_camera_b, points)
    bound = 2.0 * gammaincinv(0.5 * _freedom(view), 0.95)
    depths = [points @ T[2, :3] + T[2, 3] for T in (view.T_camera_base, T_camera_b)]
    good: NDArray[np.bool_] = ((residuals**2).sum(axis=1) <= factor * bound) & (np.minimum(*depths) > 0.0)
    return good


def motion_covariance(view: SharedView, T_a_b: Floats, median_ratio: int) -> Floats:
    """Return the covariance float64 (6, 6) of a motion, as `Registration` defines it, from the spread of its inliers.

    Parameters
    ----------
    view
        The inliers, at least four.
    T_a_b
        float64 (4, 4), as :func:`adjust_pair` refined it: of a motion that was not, this says too little.
    median_ratio
        Of the sorted squared errors the one at N / ratio tells their size.

    Notes
    -----
    The information of both cameras' observations about the motion, with each point eliminated, times how much larger the
    errors are than they were thought to be.
    """
    T_camera_b = view.T_camera_base @ se3.inverse(T_a_b)
    points = _eliminated(view, T_a_b, T_camera_b)
    residuals, by_point, by_motion = _linearised(view, T_a_b, T_camera_b, points)
    cross = np.einsum("nij,nik->njk", by_motion, by_point)
    eliminated = np.einsum("nij,njk->nik", cross, np.linalg.solve(_damped(by_point), cross.transpose(0, 2, 1)))
    each = np.einsum("nij,nik->njk", by_motion, by_motion) - eliminated
    pulls = np.einsum("nij,ni->nj", by_motion, residuals)
    jackknife = _jackknife(view, each, pulls)
    each = _by_cell(view, each)
    depth_m = float(np.median(points @ T_camera_b[2, :3] + T_camera_b[2, 3]))
    covariance = _unit_variance(view, residuals, median_ratio) * _trusted(each, depth_m)
    return covariance + jackknife + np.diag(np.repeat([(SYSTEMATIC * depth_m) ** 2, (0.5 * SYSTEMATIC) ** 2], 3))


def _jackknife(view: SharedView, each: Floats, pulls: Floats) -> Floats:
    """Return the covariance (6, 6) by how far the motion moves when all matches of one region of b's image are left out.

    Parameters
    ----------
    each
        float64 (N, 6, 6), what each match tells.
    pulls
        float64 (N, 6), how each pulls at the motion; in balance.

    References
    ----------
    H. R. Künsch, "The jackknife and the bootstrap for general stationary observations", Annals of Statistics 1989 (blocks of
    observations whose errors are not independent).
    """
    size = view.camera.width / REGIONS
    _, group = np.unique(np.floor(view.b.pixels / size).astype(np.int64), axis=0, return_inverse=True)
    count = int(group.max()) + 1
    sums, forces = np.zeros((count, 6, 6)), np.zeros((count, 6))
    np.add.at(sums, group.ravel(), each)
    np.add.at(forces, group.ravel(), pulls)
    total = sums.sum(axis=0)
    forces -= forces.mean(axis=0)
    rest = total - sums
    rest += 1e-6 * np.diag(np.diagonal(total))
    moves = np.linalg.solve(rest, forces[:, :, None])[:, :, 0]
    covariance: Floats = moves.T @ moves * ((count - 1) / count)
    return covariance


def _by_cell(view: SharedView, each: Floats) -> Floats:
    """Return the mean (C, 6, 6) of what the matches (N, 6, 6) in each cell of b's image tell: their errors are alike."""
    cells = np.floor(view.b.pixels / (view.camera.width / CELLS)).astype(np.int64)
    _, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(counts), 6, 6))
    np.add.at(sums, group.ravel(), each)
    return sums / counts[:, None, None]


def _trusted(each: Floats, depth_m: float) -> Floats:
    """Return the inverse (6, 6) of the information that cells (C, 6, 6) give together, were a few of them wrong.

    Along each principal direction those that tell most about it are left out, and the rest is taken for what they are worth if
    they tell as much as the others: nothing changes for cells all over the view, but where nearly all lie on one line the few
    beside it are not believed.
    """
    scale = np.array([depth_m, depth_m, depth_m, 1.0, 1.0, 1.0])  # the same effect in the image
    each = each * np.outer(scale, scale)
    values, directions = np.linalg.eigh(0.5 * (each.sum(axis=0) + each.sum(axis=0).T))
    told = np.sort(np.einsum("ik,nij,jk->nk", directions, each, directions), axis=0)
    left = len(each) - max(2, -(-len(each) // DOUBTED))
    kept = told[: max(left, 1)].sum(axis=0) / KEPT_SHARE
    values = np.maximum(np.minimum(values, kept), 1e-9 * max(float(values[-1]), 1e-12))
    inverse: Floats = (directions / values) @ directions.T
    return inverse * np.outer(scale, scale)


def _eliminated(view: SharedView, T_a_b: Floats, T_camera_b: Floats) -> Floats:
    """Return the points (N, 3) where both cameras together see them."""
    points = view.points.copy()
    for _ in range(POINT_STEPS):
        residuals, by_point, _ = _linearised(view, T_a_b, T_camera_b, points)
        gradient = np.einsum("nij,ni->nj", by_point, residuals)
        points = points - np.linalg.solve(_damped(by_point), gradient[:, :, None])[:, :, 0]
    return points


def points_covariance(points_a: Floats, points_b: Floats, eye: Floats, median_ratio: int) -> Floats:
    """Return the covariance (6, 6) as RTAB-Map takes it: the variance of one inlier's point, seen from both places.

    Parameters
    ----------
    points_a, points_b
        float64 (N, 3), metres, the same points in the same frame; NaN: not known.
    eye
        float64 (3,), where the camera is in that frame.
    median_ratio
        Of the sorted squared errors the one at N / ratio, times 2.1981, is the variance.
    """
    known = np.isfinite(points_a).all(axis=1) & np.isfinite(points_b).all(axis=1)
    if not known.any():
        return np.eye(6)
    a, b = points_a[known] - eye, points_b[known] - eye
    norms = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    angles = np.arccos(np.clip((a * b).sum(axis=1) / np.maximum(norms, 1e-12), -1.0, 1.0))
    place = len(a) // max(median_ratio, 2)
    linear, angular = np.sort(((a - b) ** 2).sum(axis=1))[place], np.sort(angles**2)[place]
    return np.diag(np.repeat(MEDIAN_FACTOR * np.maximum([linear, angular], 1e-6), 3))


def _freedom(view: SharedView) -> NDArray[np.int64]:
    """Return how many numbers (N,) each match has more than its point."""
    return 1 + _stereo(view.a, view.camera).astype(np.int64) + _stereo(view.b, view.camera)


def _unit_variance(view: SharedView, residuals: Floats, median_ratio: int) -> float:
    """Return the variance of the whitened residuals (N, 6), robustly: 1 where pixels are as good as they were thought to be."""
    squares = (residuals**2).sum(axis=1)
    shares = np.sort(squares / (2.0 * gammaincinv(0.5 * _freedom(view), 1.0 / CALIBRATED_RATIO)))
    return float(max(shares[len(shares) // max(median_ratio, 2)], 1e-4))


def _stereo(features: Features, camera: Pinhole) -> NDArray[np.bool_]:
    flags: NDArray[np.bool_] = np.isfinite(features.right) & (camera.bf > 0)
    return flags


def _linearised(view: SharedView, T_a_b: Floats, T_camera_b: Floats, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return whitened residuals (N, 6) and derivatives by the point (N, 6, 3) and by the motion (N, 6, 6); 0: not seen."""
    first, by_first = _observed(view.a, view, view.T_camera_base, points)
    second, by_second = _observed(view.b, view, T_camera_b, points)
    arms = points - T_a_b[:3, 3]
    turned = np.zeros((len(points), 3, 6))  # of p_b' = R' Exp(-phi) (p_a - t - rho), times R
    turned[:, [0, 1, 2], [0, 1, 2]] = -1.0
    turned[:, 0, 4], turned[:, 0, 5] = -arms[:, 2], arms[:, 1]
    turned[:, 1, 3], turned[:, 1, 5] = arms[:, 2], -arms[:, 0]
    turned[:, 2, 3], turned[:, 2, 4] = -arms[:, 1], arms[:, 0]
    by_motion = np.concatenate([np.zeros_like(turned), by_second @ turned], axis=1)
    return np.concatenate([first, second], axis=1), np.concatenate([by_first, by_second], axis=1), by_motion


def _observed(features: Features, view: SharedView, T_camera_a: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Return whitened residuals (N, 3) of u, v and the right column, and their derivatives by the point (N, 3, 3)."""
    camera, count = view.camera, len(points)
    local = points @ T_camera_a[:3, :3].T + T_camera_a[:3, 3]
    x, y = local[:, 0], local[:, 1]
    z = np.maximum(local[:, 2], 1e-3)
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    seen = _stereo(features, camera)
    weights = 1.0 / (view.sigma_px * features.sigmas)
    weight_right = np.where(seen, weights, 0.0)
    right = np.where(seen, features.right, 0.0)
    residuals = np.stack(
        [
            weights * (u - features.pixels[:, 0]),
            weights * (v - features.pixels[:, 1]),
            weight_right * (u - camera.bf / z - right),
        ],
        axis=1,
    )
    jacobians = np.zeros((count, 3, 3))
    jacobians[:, 0, 0], jacobians[:, 0, 2] = camera.fx / z, -camera.fx * x / z**2
    jacobians[:, 1, 1], jacobians[:, 1, 2] = camera.fy / z, -camera.fy * y / z**2
    jacobians[:, 2, 0], jacobians[:, 2, 2] = camera.fx / z, (camera.bf - camera.fx * x) / z**2
    jacobians *= np.stack([weights, weights, weight_right], axis=1)[:, :, None]
    return residuals, jacobians @ T_camera_a[:3, :3]


def _damped(by_point: Floats) -> Floats:
    """Return the normal matrices (N, 3, 3) of the points, invertible also where a point's depth is not known."""
    normal = np.einsum("nij,nik->njk", by_point, by_point)
    normal[:, [0, 1, 2], [0, 1, 2]] += 1e-6 * np.trace(normal, axis1=1, axis2=2)[:, None] + 1e-12
    return normal
