# SPDX-License-Identifier: MIT
"""Where a frame was taken when nothing is known of where the camera is: from the map alone.

R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, IEEE T-RO 31(5), 2015, doi:10.1109/TRO.2015.2463671, V-C: candidates by bags of words,
matches of their points, P3P within RANSAC, more points by guided search. Here descriptors are compared with all of a candidate's, which
finds more than comparing them under the same word, and keyframes are tried by their descriptors where words give no candidate that holds.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.orbslam3.visible_points import visible_points
from slamcli.vision.matching import match_brute_force, search_by_projection
from slamcli.vision.pnp import estimate_pose_pnp
from slamcli.vision.pose_optimisation import optimise_pose

_WINDOWS = ((10.0, 100), (3.0, 64))
"""Radius of the guided search, pixels at the finest level, and largest Hamming distance: wide, then narrow once the pose is known better."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RelocalisationSettings:
    """What a frame must show to be found again; the defaults are those of ORB-SLAM3."""

    least_matches: int = 15
    """Points of a candidate that features look like."""
    max_distance: int = 75
    """Hamming distance of such a match, bits."""
    ratio: float = 0.85
    """Of its distance to the second best."""
    least_sampled: int = 10
    """Matches that RANSAC's best pose explains."""
    iterations: int = 300
    least_held: int = 50
    """Points of the map that hold at the pose in the end."""
    surely_held: int = 150
    """With so many no other candidate is tried."""
    num_candidates: int = 8
    """Keyframes that are tried by words, and again by descriptors."""
    num_sketched: int = 150
    """Features of the frame that are compared with all keyframes where words do not help: its strongest."""
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Relocalisation:
    """What came of the search for one frame."""

    found: bool
    reason: str
    """Why it was not found; empty if it was."""
    keyframe: int = -1
    """Of the map, through which it was found."""
    T_camera_map: NDArray[np.float64] | None = None
    """float64 (4, 4)."""
    points: Ids | None = None
    """(F,), map point that each feature of the frame sees, or -1."""
    num_held: int = 0
    """Points that hold; where nothing was found the most that any candidate had."""


def relocalise(
    sparse_map: SparseMap, frame: Frame, candidates: Iterable[int], settings: RelocalisationSettings
) -> Relocalisation:
    """Return the pose of a frame beside one of the candidate keyframes of a map, or why there is none.

    Neither the map nor the frame is changed. The candidate with most points that hold wins: one that shows a small part of the view
    only may hold at a wrong pose too.
    """
    tried, most_matched, best = 0, 0, Relocalisation(found=False, reason="")
    for keyframe in candidates:
        tried += 1
        features, ids = _matches(sparse_map, keyframe, frame, settings)
        most_matched = max(most_matched, len(ids))
        if len(ids) < settings.least_matches:
            continue
        try:
            sampled = estimate_pose_pnp(
                sparse_map.positions[ids], frame.features.pixels[features], frame.features.sigmas[features], sparse_map.camera,
                seed=settings.seed + frame.number, iterations=settings.iterations, min_inliers=settings.least_sampled,
                right=frame.features.right[features],
            )  # fmt: skip
        except EstimationError:
            continue
        points = np.full(len(frame.features), -1, dtype=np.int64)
        points[features[sampled.inliers]] = ids[sampled.inliers]
        T_camera_map, points = _guided(sparse_map, keyframe, frame, sampled.T_camera_map, points, settings)
        held = int(np.count_nonzero(points >= 0))
        if held > best.num_held:
            best = Relocalisation(
                found=True, reason="", keyframe=keyframe, T_camera_map=T_camera_map, points=points, num_held=held
            )
        if held >= settings.surely_held:
            break
    if best.num_held >= settings.least_held:
        return best
    why = _why(tried, most_matched, best.num_held, settings)
    return Relocalisation(found=False, reason=why, num_held=best.num_held)


def alike(sparse_map: SparseMap, frame: Frame, settings: RelocalisationSettings) -> list[int]:
    """Return the keyframes whose points the frame's strongest features look like most, the best first; slow on large maps."""
    strongest = np.argsort(-frame.features.responses, kind="stable")[: settings.num_sketched]
    sketch = frame.features.descriptors[strongest]
    living = sparse_map.living_keyframes
    counts = np.zeros(len(living), dtype=np.int64)
    for row, keyframe in enumerate(living.tolist()):
        seeing = np.flatnonzero(sparse_map.seen[keyframe, : sparse_map.counts[keyframe]] >= 0)
        if len(seeing):
            matched = match_brute_force(
                sketch, sparse_map.key_descriptors[keyframe, seeing], max_distance=settings.max_distance, ratio=settings.ratio
            )  # fmt: skip
            counts[row] = np.count_nonzero(matched >= 0)
    order = np.lexsort((living, -counts))
    return [int(living[row]) for row in order[: settings.num_candidates] if counts[row]]


def _matches(sparse_map: SparseMap, keyframe: int, frame: Frame, settings: RelocalisationSettings) -> tuple[Ids, Ids]:
    """Return features of the frame and the points of a keyframe that they look like, (N,) each; no point and no feature twice."""
    seen = sparse_map.seen[keyframe, : sparse_map.counts[keyframe]]
    rows = np.flatnonzero(seen >= 0)
    if not len(rows) or not len(frame.features):
        return rows[:0], rows[:0]
    matched = match_brute_force(
        sparse_map.key_descriptors[keyframe, rows], frame.features.descriptors, max_distance=settings.max_distance,
        ratio=settings.ratio, angles_a=sparse_map.angles[keyframe, rows], angles_b=frame.features.angles,
    )  # fmt: skip
    hits = np.flatnonzero(matched >= 0)
    ids, first = np.unique(seen[rows[hits]], return_index=True)
    return matched[hits[first]], ids


def _guided(
    sparse_map: SparseMap, keyframe: int, frame: Frame, T_camera_map: NDArray[np.float64], points: Ids,
    settings: RelocalisationSettings,
) -> tuple[NDArray[np.float64], Ids]:  # fmt: skip
    """Return pose and points (F,) after searching around where the points of the neighbourhood must be, ever closer."""
    T_camera_map, points = _optimised(sparse_map, frame, T_camera_map, points)
    neighbours, _ = sparse_map.covisible(keyframe)
    around = sparse_map.points_of(np.concatenate([[keyframe], neighbours[:10]]))
    for radius, max_distance in _WINDOWS:
        if np.count_nonzero(points >= 0) < settings.least_sampled:
            break
        fresh = np.setdiff1d(around, points, assume_unique=False)
        seen = visible_points(sparse_map, fresh, T_camera_map)
        found = search_by_projection(
            seen.pixels, radius * sparse_map.scales[seen.octaves], seen.octaves - 1, seen.octaves + 1,
            sparse_map.descriptors[seen.ids], frame.features, frame.grid, points < 0,
            predicted_right=seen.right if sparse_map.camera.bf > 0 else None, max_distance=max_distance, ratio=0.9,
        )  # fmt: skip
        hits = np.flatnonzero(found >= 0)
        points = points.copy()
        points[found[hits]] = seen.ids[hits]
        T_camera_map, points = _optimised(sparse_map, frame, T_camera_map, points)
    return T_camera_map, points


def _optimised(
    sparse_map: SparseMap, frame: Frame, T_camera_map: NDArray[np.float64], points: Ids
) -> tuple[NDArray[np.float64], Ids]:
    """Return the pose that the points agree on, and the points without those that do not."""
    rows = np.flatnonzero(points >= 0)
    features = frame.features
    estimate = optimise_pose(
        T_camera_map, sparse_map.positions[points[rows]], features.pixels[rows], features.right[rows],
        features.sigmas[rows], sparse_map.camera,
    )  # fmt: skip
    kept = np.full_like(points, -1)
    kept[rows[estimate.inliers]] = points[rows[estimate.inliers]]
    return estimate.T_camera_map, kept


def _why(tried: int, matched: int, held: int, settings: RelocalisationSettings) -> str:
    if not tried:
        return "no keyframe looks like it"
    if matched < settings.least_matches:
        return f"of {tried} keyframes none has {settings.least_matches} points that look like its features (at most {matched})"
    return f"of {tried} keyframes none explains {settings.least_held} of its features (at most {held})"
