# SPDX-License-Identifier: MIT
"""Motion between two places from matched features: points to points, points to pixels, or pixels to pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.geometry.alignment import umeyama
from slamcli.rtabmap.signature import Signature
from slamcli.rtabmap.visual_settings import VisualSettings
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.pnp import CHI2_LIMIT, estimate_pose_pnp
from slamcli.vision.sampling import draw_samples
from slamcli.vision.two_view import initialise_two_view

Floats = NDArray[np.float64]
Pairs = NDArray[np.int64]
Flags = NDArray[np.bool_]

POINTS_TO_POINTS, POINTS_TO_PIXELS, PIXELS_TO_PIXELS = 0, 1, 2
"""Vis/EstimationType."""


def sigma_px(settings: VisualSettings) -> float:
    """Return the standard deviation of a pixel at which Vis/PnPReprojError is the 95 % bound."""
    return settings.pnp_reproj_error / CHI2_LIMIT**0.5


def estimate_motion(
    a: Signature, b: Signature, pairs: Pairs, camera: Pinhole, T_base_camera: Floats, settings: VisualSettings,
    *, seed: int, least: int,
) -> tuple[Floats, Flags]:  # fmt: skip
    """Return ``T_a_b`` and which pairs of features agree with it, bool (M,).

    Parameters
    ----------
    pairs
        int64 (M, 2), rows of a's and of b's features.
    least
        Fewer agreeing pairs are no result.

    Raises
    ------
    EstimationError
        If there is no motion that so many pairs agree on; the message says how many the best one has.
    """
    match settings.estimation_type:
        case 0:
            return _points_to_points(a, b, pairs, settings, seed, least)
        case 2:
            return _pixels_to_pixels(a, b, pairs, camera, T_base_camera, settings, seed, least)
    rows_a, rows_b = pairs.T
    known = np.flatnonzero(np.isfinite(a.points[rows_a]).all(axis=1))
    found = estimate_pose_pnp(
        a.points[rows_a[known]], b.features.pixels[rows_b[known]],
        sigma_px(settings) * b.features.sigmas[rows_b[known]], camera,
        seed=seed, iterations=settings.iterations, min_inliers=least, right=b.features.right[rows_b[known]],
    )  # fmt: skip
    inliers = np.zeros(len(pairs), np.bool_)
    inliers[known[found.inliers]] = True
    return se3.inverse(found.T_camera_map) @ se3.inverse(T_base_camera), inliers


def _points_to_points(
    a: Signature, b: Signature, pairs: Pairs, settings: VisualSettings, seed: int, least: int
) -> tuple[Floats, Flags]:
    """Horn's closed form in RANSAC, by the distance between points."""
    first, second = a.points[pairs[:, 0]], b.points[pairs[:, 1]]
    known = np.flatnonzero(np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1))
    first, second = first[known], second[known]
    if len(known) < max(least, 3):
        raise EstimationError(f"{len(known)} matches have points at both places, fewer than {max(least, 3)}")
    best: Flags = np.zeros(len(known), np.bool_)
    T = np.eye(4)
    for sample in draw_samples(len(known), 3, settings.iterations, seed):
        candidate = _aligned(first[sample], second[sample])
        if candidate is None:
            continue
        near = _near(candidate, first, second, settings.inlier_distance)
        if np.count_nonzero(near) > np.count_nonzero(best):
            T, best = candidate, near
    for _ in range(settings.refine_iterations):
        again = _aligned(first[best], second[best]) if np.count_nonzero(best) >= 3 else None
        near = best if again is None else _near(again, first, second, settings.inlier_distance)
        if again is None or np.count_nonzero(near) < np.count_nonzero(best):
            break
        settled = bool(np.array_equal(near, best))
        T, best = again, near
        if settled:
            break
    if np.count_nonzero(best) < least:
        raise EstimationError(
            f"{np.count_nonzero(best)} of {len(known)} matched points agree on a motion, fewer than {least}"
        )
    inliers = np.zeros(len(pairs), np.bool_)
    inliers[known[best]] = True
    return T, inliers


def _aligned(first: Floats, second: Floats) -> Floats | None:
    """Return the motion that lays the second points on the first, None where they lie on a line."""
    try:
        found = umeyama(second, first)
    except EstimationError:
        return None
    return se3.from_rotation_translation(found.rotation, found.translation_m)


def _near(T: Floats, first: Floats, second: Floats, distance_m: float) -> Flags:
    errors = second @ T[:3, :3].T + T[:3, 3] - first
    near: Flags = np.einsum("ni,ni->n", errors, errors) <= distance_m**2
    return near


def _pixels_to_pixels(
    a: Signature, b: Signature, pairs: Pairs, camera: Pinhole, T_base_camera: Floats, settings: VisualSettings,
    seed: int, least: int,
) -> tuple[Floats, Flags]:  # fmt: skip
    """Two views of pixels alone; the length of the baseline by the depths of a's points."""
    found = initialise_two_view(
        a.features.pixels[pairs[:, 0]], b.features.pixels[pairs[:, 1]], camera, seed=seed, iterations=settings.iterations,
        sigma_px=sigma_px(settings), min_points=max(least, 8),
    )  # fmt: skip
    T_camera_base = se3.inverse(T_base_camera)
    depth = (a.points[pairs[:, 0]] @ T_camera_base[:3, :3].T + T_camera_base[:3, 3])[:, 2]
    known = found.inliers & np.isfinite(depth) & np.isfinite(found.points[:, 2])
    if np.count_nonzero(known) < 3:
        raise EstimationError("two views: no point tells how long the way between them is")
    scales = depth[known] / found.points[known, 2]
    scale = float(np.median(scales))
    variance = (1.4826 * float(np.median(np.abs(scales / scale - 1.0)))) ** 2
    if variance > settings.epipolar_geometry_var:
        raise EstimationError(
            f"two views: the points disagree on the length of the way, relative variance {variance:.2g}, more than "
            f"{settings.epipolar_geometry_var:g}"
        )
    T_b_a = found.T_b_a.copy()
    T_b_a[:3, 3] *= scale
    return T_base_camera @ se3.inverse(T_b_a) @ T_camera_base, found.inliers
