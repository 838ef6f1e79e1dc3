# SPDX-License-Identifier: MIT
"""Motion between two places by what the camera saw (Labbé and Michaud, JFR 2019, section 3.3, "motion estimation").

Matches by descriptors, strictly and, where that does not hold, loosely; a motion that most agree on; then, as RTAB-Map's
``Reg/RepeatOnce`` does, matches once more around where the motion puts the points, which finds many that descriptors alone
did not tell apart; then both cameras together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.rtabmap.depth_agreement import depth_agreement
from slamcli.rtabmap.registration import Registration, flat_motion, inverted, refused
from slamcli.rtabmap.signature import Signature
from slamcli.rtabmap.two_frame_adjustment import SharedView, adjust_pair, agreeing, motion_covariance, points_covariance
from slamcli.rtabmap.visual_matching import GUIDED_RATIO, match_descriptors, match_projected
from slamcli.rtabmap.visual_motion import PIXELS_TO_PIXELS, estimate_motion, sigma_px
from slamcli.rtabmap.visual_settings import VisualSettings
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.pose_optimisation import optimise_pose

Floats = NDArray[np.float64]
Pairs = NDArray[np.int64]

LEAST_SAMPLED = 10
"""Matches that must agree on a motion before more are sought around where it puts them."""
FIRST_TOLERANCE = 2.0
"""Times Vis/PnPReprojError that a match may be off before both cameras were adjusted together: points are less exact than pixels."""
LEAST_DEPTH_AGREEMENT = 0.6
HYPOTHESES = 2
"""Motions that are tried: what most matches agree on, then what most of the others do."""
ENOUGH = 150
"""Inliers with which nothing else is tried."""
WINDOWS_PX = (15.0, 6.0)
"""Half sides of the windows of the second search, wide, then narrow once the motion is known better."""
PRUNING = (4.0, 1.0)
"""Times the 95 % bound that a match's squared error may reach in each round of the refinement."""


class _Views(NamedTuple):
    """Two places and what is asked of them again and again."""

    a: Signature
    b: Signature
    camera: Pinhole
    T_base_camera: Floats
    settings: VisualSettings
    seed: int


class _Held(NamedTuple):
    """A motion and the pairs of features (M, 2) that hold."""

    T_a_b: Floats
    pairs: Pairs


def register_visual(
    a: Signature, b: Signature, camera: Pinhole, T_base_camera: Floats, settings: VisualSettings, *, seed: int,
    guess: Floats | None = None,
) -> Registration:  # fmt: skip
    """Return how the base at b lies in the base at a, by features, or why that is not known.

    Parameters
    ----------
    a
        Whose points are used.
    b
        Whose pixels are used, and whose depths in the refinement.
    camera
        The ideal camera of both.
    T_base_camera
        float64 (4, 4).
    settings
        Fewer than ``Vis/MinInliers`` are no result.
    seed
        Of the samples: the same input and seed give the same bytes.
    guess
        float64 (4, 4), ``T_a_b`` as it is expected: matches are sought within ``Vis/CorGuessWinSize`` of where it puts the
        points, and nowhere else. None: everywhere.

    Notes
    -----
    Views that share less than about a tenth of their features are beyond it.
    """
    views = _Views(a, b, camera, np.asarray(T_base_camera, np.float64), settings, seed)
    if not len(a.features) or not len(b.features):
        return refused(f"node {a.id if not len(a.features) else b.id} has no features")
    rows = np.flatnonzero(np.isfinite(a.points).all(axis=1))
    if settings.estimation_type != PIXELS_TO_PIXELS and len(rows) < settings.min_inliers:
        return refused(f"node {a.id} has {len(rows)} features whose depth is known, fewer than {settings.min_inliers}")
    if guess is not None and settings.cor_guess_win_size > 0:
        pairs = _projected(views, rows, guess, float(settings.cor_guess_win_size), settings.cor_nndr)
        return _concluded(views, rows, pairs, repeat=False)
    everything = rows if settings.estimation_type != PIXELS_TO_PIXELS else np.arange(len(a.features))
    strict = match_descriptors(a, b, everything, settings, loose=False)
    found = _concluded(views, rows, strict, repeat=settings.repeat_once)
    if not settings.repeat_once or (found.T_a_b is not None and found.num_inliers >= ENOUGH):
        return found
    again = _concluded(views, rows, match_descriptors(a, b, everything, settings, loose=True), repeat=True)
    return again if again.num_inliers > found.num_inliers else found


def register_best(
    candidates: Sequence[Signature], b: Signature, camera: Pinhole, T_base_camera: Floats, settings: VisualSettings,
    *, seed: int, enough: int = 150, guess: Floats | None = None, inversely: bool = False,
) -> tuple[int, Registration]:  # fmt: skip
    """Return the id of the place that b is registered with best, and how: the one with most inliers.

    Parameters
    ----------
    candidates
        At least one: the hypothesis, then its neighbours. With `enough` inliers no further one is tried.
    guess
        As :func:`register_visual` takes it (``RGBD/LoopClosureIdentityGuess``).
    inversely
        Whether b's points and a's pixels are used (``RGBD/InvertedReg``); the result is of b in a all the same.
    """

    def registered(a: Signature) -> Registration:
        if inversely:
            back = None if guess is None else se3.inverse(guess)
            return inverted(register_visual(b, a, camera, T_base_camera, settings, seed=seed, guess=back))
        return register_visual(a, b, camera, T_base_camera, settings, seed=seed, guess=guess)

    best_id, best = candidates[0].id, registered(candidates[0])
    for a in candidates[1:]:
        if best.T_a_b is not None and best.num_inliers >= enough:
            break
        found = registered(a)
        if (found.T_a_b is not None, found.num_inliers) > (best.T_a_b is not None, best.num_inliers):
            best_id, best = a.id, found
    return best_id, best


def _concluded(views: _Views, rows: Pairs, pairs: Pairs, *, repeat: bool) -> Registration:
    """Return the registration from matches; with `repeat` more are sought around where the first motion puts them."""
    settings, num_matches = views.settings, len(pairs)
    least = min(LEAST_SAMPLED, settings.min_inliers) if repeat else settings.min_inliers
    try:
        supposed = _supposed(views, pairs, least, again=repeat)
    except EstimationError as problem:
        return refused(f"{num_matches} features look alike: {problem}", num_matches=num_matches)
    held = supposed[0]
    if repeat:
        searched = [_repeated(views, rows, pairs, one) for one in supposed]
        pairs, held = max(searched, key=lambda one: len(one[1].pairs))
    if settings.bundle_adjustment and len(held.pairs) >= least:
        held = _adjusted(views, pairs, held)
    if len(held.pairs) < settings.min_inliers:
        return refused(
            f"{len(held.pairs)} of {num_matches} matched features agree on a motion, fewer than {settings.min_inliers}",
            num_matches=num_matches, num_inliers=len(held.pairs),
        )  # fmt: skip
    return _judged(views, num_matches, held)


def _supposed(views: _Views, pairs: Pairs, least: int, *, again: bool) -> list[_Held]:
    """Return the motion that most pairs agree on, and, with `again`, the one that most of the others do.

    Raises
    ------
    EstimationError
        If there is none.
    """
    settings, found = views.settings, list[_Held]()
    if again:  # points are less well known than pixels: a first motion need not be as exact as the last one
        settings = replace(settings, pnp_reproj_error=FIRST_TOLERANCE * settings.pnp_reproj_error)
    for _ in range(HYPOTHESES if again else 1):
        try:
            T_a_b, agree = estimate_motion(
                views.a, views.b, pairs, views.camera, views.T_base_camera, settings, seed=views.seed, least=least
            )
        except EstimationError:
            if not found:
                raise
            break
        found.append(_Held(T_a_b, pairs[agree]))
        pairs = pairs[~agree]
    return found


def _adjusted(views: _Views, pairs: Pairs, held: _Held) -> _Held:
    """Return the motion that both cameras together agree on, with all pairs that it explains."""
    pairs = pairs[np.isfinite(views.a.points[pairs[:, 0]]).all(axis=1)]
    T_a_b = held.T_a_b
    for factor in PRUNING:
        good = pairs[agreeing(_view(views, pairs), T_a_b, factor)]
        if len(good) < LEAST_SAMPLED:
            return held
        T_a_b = adjust_pair(_view(views, good), T_a_b)
    return _Held(T_a_b, pairs[agreeing(_view(views, pairs), T_a_b, 1.0)])


def _repeated(views: _Views, rows: Pairs, pairs: Pairs, held: _Held) -> tuple[Pairs, _Held]:
    """Return matches around where the motion so far puts the points, ever closer, and the motion that they agree on."""
    for radius in WINDOWS_PX:
        nearer = _projected(views, rows, held.T_a_b, radius, max(views.settings.cor_nndr, GUIDED_RATIO))
        better = _optimised(views, held.T_a_b, nearer, FIRST_TOLERANCE)
        if len(better.pairs) < len(held.pairs):
            break
        pairs, held = nearer, better
    return pairs, held


def _optimised(views: _Views, T_a_b: Floats, pairs: Pairs, tolerance: float) -> _Held:
    """Return the motion that the pairs agree on, and those that do; from a motion near by."""
    rows_a, rows_b = pairs.T
    b = views.b.features
    start = se3.inverse(T_a_b @ views.T_base_camera)
    found = optimise_pose(
        start, views.a.points[rows_a], b.pixels[rows_b], b.right[rows_b],
        tolerance * sigma_px(views.settings) * b.sigmas[rows_b], views.camera,
    )  # fmt: skip
    T_camera_a = found.T_camera_map
    return _Held(se3.inverse(T_camera_a) @ se3.inverse(views.T_base_camera), pairs[found.inliers])


def _projected(views: _Views, rows: Pairs, T_a_b: Floats, radius_px: float, ratio: float) -> Pairs:
    T_camera_a = se3.inverse(T_a_b @ views.T_base_camera)
    return match_projected(views.a, views.b, rows, T_camera_a, views.camera, radius_px, ratio)


def _view(views: _Views, pairs: Pairs) -> SharedView:
    return SharedView(
        points=views.a.points[pairs[:, 0]], a=_selected(views.a.features, pairs[:, 0]),
        b=_selected(views.b.features, pairs[:, 1]), sigma_px=sigma_px(views.settings), camera=views.camera,
        T_camera_base=se3.inverse(views.T_base_camera),
    )  # fmt: skip


def _selected(features: Features, rows: Pairs) -> Features:
    """Return the features of some rows."""
    columns = {name: getattr(features, name)[rows] for name in Features.__slots__}
    return replace(features, **columns)


def _judged(views: _Views, num_matches: int, held: _Held) -> Registration:
    """Return the registration, or why its inliers are not good enough."""
    settings, pairs, T_a_b = views.settings, held.pairs, held.T_a_b
    known = np.isfinite(views.a.points[pairs[:, 0]]).all(axis=1)
    points_a = views.a.points[pairs[:, 0]] @ T_a_b[:3, :3] - T_a_b[:3, :3].T @ T_a_b[:3, 3]  # in b's base
    points_b = views.b.points[pairs[:, 1]]
    eye, ratio = views.T_base_camera[:3, 3], settings.pnp_variance_median_ratio
    spread = points_covariance(points_a, points_b, eye, ratio)
    why = _unfit(views, pairs, points_a, float(spread[0, 0])) or _contradicted(views, T_a_b)
    if why:
        return refused(why, num_matches=num_matches, num_inliers=len(pairs))
    if settings.bundle_adjustment:
        spread = motion_covariance(_view(views, pairs[known]), T_a_b, ratio)
    return Registration(
        T_a_b=flat_motion(T_a_b) if settings.force_3dof else T_a_b, covariance=spread, num_matches=num_matches,
        num_inliers=len(pairs), matches=pairs, reason="",
    )  # fmt: skip


def _unfit(views: _Views, pairs: Pairs, points: Floats, variance: float) -> str:
    """Return why the inliers do not hold the motion well enough; empty if they do."""
    settings = views.settings
    if np.count_nonzero(np.isfinite(points).all(axis=1)) < 4:
        return "fewer than 4 inliers have a known depth"
    if settings.mean_inliers_distance > 0:
        mean = float(np.nanmean(np.linalg.norm(points - views.T_base_camera[:3, 3], axis=1)))
        if mean > settings.mean_inliers_distance:
            return f"the inliers are {mean:.2f} m away on average, farther than {settings.mean_inliers_distance:g} m"
    if settings.min_inliers_distribution > 0:
        spread = inliers_distribution(views.b.features.pixels[pairs[:, 1]], views.camera)
        if spread < settings.min_inliers_distribution:
            return (
                f"the inliers are spread {spread:.4f} over the image, less than {settings.min_inliers_distribution:g}"
            )
    if settings.pnp_max_variance > 0 and variance > settings.pnp_max_variance:
        return f"the inliers' points lie apart, variance {variance:.2g} m^2, more than {settings.pnp_max_variance:g}"
    return ""


def _contradicted(views: _Views, T_a_b: Floats) -> str:
    """Return how far the depths that both places see contradict the motion; empty if they do not."""
    share = depth_agreement(views.a, views.b, views.camera, views.T_base_camera, T_a_b)
    if not share < LEAST_DEPTH_AGREEMENT:
        return ""
    return f"by the motion that was found only {share:.0%} of the points that both see have the same depth"


def inliers_distribution(pixels: Floats, camera: Pinhole) -> float:
    """Return how widely pixels (N, 2) are spread: the smaller variance along their principal axes, in sizes of the image."""
    places = (pixels - (0.5 * camera.width, 0.5 * camera.height)) / (camera.width, camera.height)
    return float(np.linalg.eigvalsh(np.cov(places.T, bias=True))[0])
