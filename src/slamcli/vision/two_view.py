# SPDX-License-Identifier: MIT
"""Motion and points of two images of one camera, from matched pixels alone: how a monocular map begins."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import quaternion, se3
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.triangulation import triangulate
from slamcli.vision.triangulation import warm as warm_triangulation
from slamcli.vision.two_view_models import (
    FUNDAMENTAL_LIMIT,
    PairModel,
    fit_models,
    motions_of_fundamental,
    motions_of_homography,
)

Floats = NDArray[np.float64]

HOMOGRAPHY_SHARE = 0.40
"""A homography is taken where its share of both scores is larger (0.45 in the paper, 0.40 in the authors' code)."""
FAR_COSINE = 0.99998
"""Rays that spread less (0.36 degrees) agree with every motion, and give no point."""
AGREEING_SHARE = 0.9
"""Of the inliers, so many must have a point ahead of both cameras."""
CLEAR_SHARE = {"homography": 0.75, "fundamental": 0.7}
"""The second best motion must have fewer points than this share of the best one's."""
REFINEMENTS = 10
WELL_KNOWN = 0.02
"""Relative standard deviation of a depth at which a point counts half in `TwoView.score`."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TwoView:
    """How camera b stands to camera a, |t| = 1, and what both see."""

    T_b_a: Floats
    """(4, 4), translation of length 1: the scale is free."""
    points: Floats
    """(N, 3), frame of camera a, in lengths of the baseline; NaN where a match gives none."""
    inliers: NDArray[np.bool_]
    """(N,), matches that gave a point."""
    parallax_rad: float
    """The 50th largest angle between the rays of a point."""
    model: Literal["homography", "fundamental"]
    """What the motion was taken from: the image shows a plane, or depth."""
    homography_share: float
    """Score of the homography over the sum of both."""
    score: float
    """How many points' depths are well known, sum of 1 / (1 + (s / 0.02)^2), s = sigma / (f sin(parallax)): the pair with
    the highest score makes the best first map."""


def initialise_two_view(
    pixels_a: Floats,
    pixels_b: Floats,
    camera: Pinhole,
    *,
    seed: int,
    iterations: int = 200,
    sigma_px: float = 1.0,
    min_points: int = 50,
    min_parallax_rad: float = math.radians(1.0),
) -> TwoView:
    """Return the motion between two images and the points that it gives.

    A homography and a fundamental matrix are fitted to the same samples (`fit_models`); the one that explains more names
    the candidates, of which the one with most points ahead of both cameras wins. Its five degrees of freedom are refined
    on the Sampson errors of all inliers. Bundle adjustment is left to the caller.

    Parameters
    ----------
    pixels_a, pixels_b
        float64 (N, 2), matched pixels of the ideal camera.
    camera
        The camera of both.
    seed, iterations
        Of the samples: the same input and seed give the same motion.
    sigma_px
        Standard deviation of a pixel.
    min_points, min_parallax_rad
        With fewer points or less parallax there is no result.

    Raises
    ------
    EstimationError
        If there are too few matches, too little parallax, or two motions explain the matches as well.

    References
    ----------
    R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, IEEE T-RO 31(5), 2015, doi:10.1109/TRO.2015.2463671, section IV.
    R. Hartley, A. Zisserman, "Multiple view geometry in computer vision", 2nd ed., 2003, section 11.4.3 (Sampson).
    """
    a, b = np.ascontiguousarray(pixels_a, np.float64), np.ascontiguousarray(pixels_b, np.float64)
    if a.shape != b.shape or a.shape != (len(a), 2):
        raise DataError(f"two views: pixels {a.shape} and {b.shape} are not paired pixels (N, 2)")
    if len(a) < max(8, min_points):
        raise EstimationError(f"two views: {len(a)} matches, fewer than {max(8, min_points)}")
    homography, fundamental = fit_models(a, b, sigma_px=sigma_px, seed=seed, iterations=iterations)
    total = homography.score + fundamental.score
    share = homography.score / total if total > 0.0 else 0.0
    views = _Pair(a, b, camera, sigma_px)
    model: Literal["homography", "fundamental"] = "homography" if share > HOMOGRAPHY_SHARE else "fundamental"
    found = homography if model == "homography" else fundamental
    motions = views.motions(found, model)
    if not len(motions):
        raise EstimationError("two views: the images differ by a rotation only")
    checks = [views.check(motion, found.inliers) for motion in motions]
    order = np.argsort([-check.num_good for check in checks], kind="stable")
    T_b_a = motions[order[0]]
    if model == "homography":
        T_b_a = views.refine(T_b_a, found.inliers)
    best = views.check(T_b_a, views.epipolar_inliers(T_b_a))
    if checks[order[1]].num_good > CLEAR_SHARE[model] * best.num_good:
        raise EstimationError(
            f"two views: two motions explain the matches ({best.num_good} and {checks[order[1]].num_good} points)"
        )
    if best.num_good < AGREEING_SHARE * best.num_inliers or np.count_nonzero(best.ok) < min_points:
        raise EstimationError(
            f"two views: {np.count_nonzero(best.ok)} points of {best.num_inliers} inliers, fewer than {min_points} or"
            f" than {AGREEING_SHARE:.0%} of them"
        )
    if best.parallax_rad < min_parallax_rad:
        raise EstimationError(
            f"two views: parallax {math.degrees(best.parallax_rad):.2f} deg, less than {math.degrees(min_parallax_rad):.2f}"
        )
    return TwoView(
        T_b_a=T_b_a,
        points=best.points,
        inliers=best.ok,
        parallax_rad=best.parallax_rad,
        model=model,
        homography_share=share,
        score=best.score,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Check:
    """What one motion makes of the matches."""

    points: Floats
    ok: NDArray[np.bool_]
    num_good: int
    """Matches with a point, or too far to have one."""
    num_inliers: int
    parallax_rad: float
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """The matches, and what is asked of them again and again."""

    a: Floats
    b: Floats
    camera: Pinhole
    sigma_px: float

    def motions(self, found: PairModel, model: Literal["homography", "fundamental"]) -> Floats:
        """Return the poses ``T_b_a`` (M, 4, 4) that a model allows.

        Those of a fundamental matrix share one essential matrix, which is refined before it is taken apart: a
        fundamental matrix knows nothing of the calibration, and what it says of the motion can be far off.
        """
        matrix = self.camera.matrix
        if model == "homography":
            return motions_of_homography(found.matrix, matrix)
        T_b_a = self.refine(motions_of_fundamental(found.matrix, matrix)[0], found.inliers)
        inverse = np.linalg.inv(matrix)
        return motions_of_fundamental(inverse.T @ _cross(T_b_a[:3, 3]) @ T_b_a[:3, :3] @ inverse, matrix)

    def check(self, T_b_a: Floats, inliers: NDArray[np.bool_]) -> _Check:
        """Return what a motion makes of the inliers (N,)."""
        sigmas = np.full(len(self.a), self.sigma_px)
        found = triangulate(
            np.eye(4), T_b_a, self.a, self.b, self.camera, sigmas_a=sigmas, sigmas_b=sigmas,
            max_cos_parallax=1.0, scale_factor=1e6,
        )  # fmt: skip
        cosines = self._cosines(T_b_a)
        far = cosines > FAR_COSINE
        ok = found.ok & inliers & ~far
        points = np.where(ok[:, None], found.points, np.nan)
        angles = np.sort(np.arccos(np.clip(cosines[ok], -1.0, 1.0)))[::-1]
        parallax = float(angles[min(50, len(angles) - 1)]) if len(angles) else 0.0
        spread = self.sigma_px / (self.camera.fx * np.maximum(np.sin(angles), 1e-9) * WELL_KNOWN)
        good = int(np.count_nonzero(ok | (far & inliers)))
        return _Check(
            points, ok, good, int(np.count_nonzero(inliers)), parallax, float((1.0 / (1.0 + spread**2)).sum())
        )

    def refine(self, T_b_a: Floats, inliers: NDArray[np.bool_]) -> Floats:
        """Return the motion of least truncated Sampson error near a first one: Gauss-Newton over R and the direction of t.

        Inliers are chosen anew before each step.
        """
        for _ in range(REFINEMENTS):
            errors = self._sampson(T_b_a)[inliers]
            steps = np.eye(5) * 1e-6
            jacobian = np.column_stack(
                [(self._sampson(_moved(T_b_a, step))[inliers] - errors) / 1e-6 for step in steps]
            )
            normal = jacobian.T @ jacobian
            if not np.trace(normal) > 0.0:  # all matches in one place
                break
            delta = np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(5), -jacobian.T @ errors)
            moved = _moved(T_b_a, delta)
            if self._truncated(moved) >= self._truncated(T_b_a):
                break
            T_b_a, inliers = moved, self.epipolar_inliers(moved)
        return T_b_a

    def epipolar_inliers(self, T_b_a: Floats) -> NDArray[np.bool_]:
        """Return which matches lie near their epipolar lines (N,)."""
        return self._sampson(T_b_a) ** 2 <= FUNDAMENTAL_LIMIT

    def _truncated(self, T_b_a: Floats) -> float:
        return float(np.minimum(self._sampson(T_b_a) ** 2, FUNDAMENTAL_LIMIT).sum())

    def _sampson(self, T_b_a: Floats) -> Floats:
        """Return first order distances from the epipolar relation (N,), in standard deviations."""
        inverse = np.linalg.inv(self.camera.matrix)
        F = inverse.T @ _cross(T_b_a[:3, 3]) @ T_b_a[:3, :3] @ inverse
        line_b = self.a @ F[:, :2].T + F[:, 2]
        line_a = self.b @ F[:2] + F[2]
        product = (line_b[:, :2] * self.b).sum(axis=1) + line_b[:, 2]
        square = (line_b[:, :2] ** 2).sum(axis=1) + (line_a[:, :2] ** 2).sum(axis=1)
        return product / np.sqrt(np.maximum(square, 1e-300)) / self.sigma_px

    def _cosines(self, T_b_a: Floats) -> Floats:
        """Return cosines of the angles between the rays of each match (N,)."""
        ones = np.ones(len(self.a))
        rays_a = self.camera.back_project(self.a, ones) @ T_b_a[:3, :3].T
        rays_b = self.camera.back_project(self.b, ones)
        return (rays_a * rays_b).sum(axis=1) / np.linalg.norm(rays_a, axis=1) / np.linalg.norm(rays_b, axis=1)


def _cross(vector: Floats) -> Floats:
    """Return the matrix (3, 3) of the cross product with a vector."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _moved(T_b_a: Floats, step: Floats) -> Floats:
    """Return a pose turned by about step[:3] rad, its direction of t by step[3:] across itself."""
    direction = T_b_a[:3, 3]
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    across /= np.linalg.norm(across)
    moved = direction + step[3] * across + step[4] * np.cross(direction, across)
    rotation = quaternion.to_matrix(quaternion.normalise([*(0.5 * step[:3]), 1.0])) @ T_b_a[:3, :3]
    return se3.from_rotation_translation(rotation, moved / np.linalg.norm(moved))


def warm() -> None:
    """Compile the kernels of this module."""
    warm_triangulation()
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, 100, (16, 2))
    fit_models(pixels, pixels + rng.uniform(0, 1, (16, 2)), sigma_px=1.0, seed=0, iterations=2)
