# SPDX-License-Identifier: MIT
"""Where a frame was taken: from the motion so far, from a keyframe, and from the local map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.orbslam3.visible_points import visible_points
from slamcli.vision.matching import match_brute_force, search_by_projection
from slamcli.vision.pnp import estimate_pose_pnp
from slamcli.vision.pose_optimisation import PoseEstimate, optimise_pose

_MOST_KEYFRAMES = 80
"""Of a local map (ORB-SLAM3's limit)."""
_FEW = 20
"""Fewer matches than these ask for a wider search."""
_LEAST_TRACKED = 10
_TH_HIGH = 100
"""Hamming distance up to which descriptors can be of the same point (ORB-SLAM's TH_HIGH)."""
_STRICTNESS = ((65, 0.8), (100, 1.0))
"""Largest distance and ratio to the second best when matching without a motion model: strictly, then as loosely as RANSAC can bear."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingSettings:
    """How far to look; the defaults are those of ORB-SLAM3."""

    motion_radius: float = 15.0
    """Pixels at the finest level around the prediction; 7 for stereo."""
    local_radius: float = 1.0
    """Factor of the radius in which points of the local map are looked for; 3 for RGB-D."""
    close_m: float = float("inf")
    """Depth up to which a point's position is known from one view (ThDepth x baseline)."""
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalTrack:
    """What tracking the local map came to."""

    held: int
    """Points that the frame sees where they should be."""
    visible: Ids
    """Points that it should have seen."""


def track_motion(
    sparse_map: SparseMap, last: Frame, frame: Frame, predicted: NDArray[np.float64], settings: TrackingSettings
) -> bool:
    """Find the points of the last frame around where the motion puts them; set the frame's pose and points.

    Close features of the last frame that see no map point yet help as points of this one step (ORB-SLAM2, "visual odometry points").
    """
    rows = np.flatnonzero(last.points >= 0)
    ids = last.points[rows]
    positions, descriptors = sparse_map.positions[ids], sparse_map.descriptors[ids]
    loose = np.flatnonzero((last.points < 0) & (last.features.depth < settings.close_m))
    if len(loose):
        seen = sparse_map.camera.back_project(last.features.pixels[loose], last.features.depth[loose])
        T_map_camera = np.linalg.inv(last.T_camera_map)
        positions = np.concatenate([positions, seen @ T_map_camera[:3, :3].T + T_map_camera[:3, 3]])
        descriptors = np.concatenate([descriptors, last.features.descriptors[loose]])
        ids = np.concatenate([ids, np.full(len(loose), -1)])
        rows = np.concatenate([rows, loose])
    if len(rows) < _LEAST_TRACKED:
        return False
    octaves, angles = last.features.octaves[rows], last.features.angles[rows]
    at_camera = positions @ predicted[:3, :3].T + predicted[:3, 3]
    camera = sparse_map.camera
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = camera.project(at_camera)
        right = pixels[:, 0] - camera.bf / at_camera[:, 2]
    x_min, y_min, x_max, y_max = camera.limits
    inside = (
        (at_camera[:, 2] > 0)
        & (pixels[:, 0] >= x_min)
        & (pixels[:, 0] < x_max)
        & (pixels[:, 1] >= y_min)
        & (pixels[:, 1] < y_max)
    )
    lowest, highest = _octave_range(octaves, last, predicted, camera.baseline_m)
    chosen = np.flatnonzero(inside)
    for factor in (1.0, 2.0):
        matched = search_by_projection(
            pixels[chosen], factor * settings.motion_radius * sparse_map.scales[octaves[chosen]], lowest[chosen], highest[chosen],
            descriptors[chosen], frame.features, frame.grid, np.ones(len(frame.features), dtype=np.bool_),
            predicted_right=right[chosen] if camera.bf > 0 else None, max_distance=_TH_HIGH, angles=angles[chosen],
        )  # fmt: skip
        hits = np.flatnonzero(matched >= 0)
        if len(hits) >= _FEW:
            break
    if len(hits) < _FEW:
        return False
    features = matched[hits]
    estimate = optimise_pose(
        predicted, positions[chosen[hits]], frame.features.pixels[features], frame.features.right[features],
        frame.features.sigmas[features], camera,
    )  # fmt: skip
    good = np.flatnonzero(estimate.inliers)
    frame.T_camera_map = estimate.T_camera_map
    frame.points[:] = -1
    frame.points[features[good]] = ids[chosen[hits[good]]]
    return len(good) >= max(_LEAST_TRACKED, _FEW if not (ids >= 0).any() else 0) and frame.num_points >= _LEAST_TRACKED


def _octave_range(octaves: Ids, last: Frame, predicted: NDArray[np.float64], baseline_m: float) -> tuple[Ids, Ids]:
    """Return the levels to look at: finer ones are out when the camera went ahead by more than a baseline, coarser ones when back."""
    ahead = float((last.T_camera_map @ np.linalg.inv(predicted))[2, 3])
    if baseline_m > 0 and ahead > baseline_m:
        return octaves, np.full_like(octaves, 1 << 10)
    if baseline_m > 0 and -ahead > baseline_m:
        return np.zeros_like(octaves), octaves
    return octaves - 1, octaves + 1


def track_keyframe(
    sparse_map: SparseMap, keyframe: int, guess: NDArray[np.float64], frame: Frame, settings: TrackingSettings
) -> bool:
    """Match a keyframe's points by their descriptors alone; set the frame's pose and points.

    This needs no motion model: the pose comes from P3P within RANSAC where refinement from `guess` finds too few.
    """
    seen = sparse_map.seen[keyframe, : sparse_map.counts[keyframe]]
    rows = np.flatnonzero(seen >= 0)
    if len(rows) < _LEAST_TRACKED:
        return False
    for max_distance, ratio in _STRICTNESS:
        matched = match_brute_force(
            sparse_map.key_descriptors[keyframe, rows], frame.features.descriptors, max_distance=max_distance, ratio=ratio, mutual=True,
            angles_a=sparse_map.angles[keyframe, rows], angles_b=frame.features.angles,
        )  # fmt: skip
        hits = np.flatnonzero(matched >= 0)
        features, ids = matched[hits], seen[rows[hits]]
        estimate = _pose_of_matches(sparse_map, frame, features, ids, guess, settings.seed)
        if estimate is not None:
            good = np.flatnonzero(estimate.inliers)
            frame.T_camera_map = estimate.T_camera_map
            frame.points[:] = -1
            frame.points[features[good]] = ids[good]
            return True
    return False


def _pose_of_matches(
    sparse_map: SparseMap, frame: Frame, features: Ids, ids: Ids, guess: NDArray[np.float64], seed: int
) -> PoseEstimate | None:
    """Return the pose at which enough matches agree: refined from a guess, else from P3P; None if there is none."""
    if len(ids) < _LEAST_TRACKED:
        return None
    positions, pixels = sparse_map.positions[ids], frame.features.pixels[features]
    right, sigmas = frame.features.right[features], frame.features.sigmas[features]
    estimate = optimise_pose(guess, positions, pixels, right, sigmas, sparse_map.camera)
    if estimate.inliers.sum() >= max(_LEAST_TRACKED, 0.5 * len(ids)):
        return estimate
    try:
        other = estimate_pose_pnp(
            positions, pixels, sigmas, sparse_map.camera, seed=seed + frame.number, iterations=1000
        )
    except EstimationError:
        return None
    estimate = optimise_pose(other.T_camera_map, positions, pixels, right, sigmas, sparse_map.camera)
    return estimate if estimate.inliers.sum() >= _LEAST_TRACKED else None


def local_keyframes(sparse_map: SparseMap, frame: Frame) -> Ids:
    """Return the keyframes that share points with the frame, the strongest first, and then those that share points with them."""
    counts = sparse_map.count_shared(np.unique(frame.points))
    first = np.flatnonzero(counts)
    first = first[np.lexsort((first, -counts[first]))][:_MOST_KEYFRAMES]
    if len(first) == _MOST_KEYFRAMES or not len(first):
        return first
    shared = sparse_map.count_shared(sparse_map.points_of(first))
    shared[first] = 0
    second = np.flatnonzero(shared)
    second = second[np.lexsort((second, -shared[second]))][: min(_MOST_KEYFRAMES - len(first), max(10, len(first)))]
    return np.concatenate([first, second])


def track_local_map(sparse_map: SparseMap, frame: Frame, settings: TrackingSettings) -> LocalTrack:
    """Find more points of the local map in the frame and refine its pose with all of them.

    Sets the frame's pose, points and reference keyframe.
    """
    keyframes = local_keyframes(sparse_map, frame)
    if not len(keyframes):
        return LocalTrack(held=0, visible=np.empty(0, dtype=np.int64))
    frame.reference = int(keyframes[0])
    ids = sparse_map.points_of(keyframes)
    matched = frame.points[frame.points >= 0]
    fresh = np.ones(sparse_map.num_points, dtype=np.bool_)
    fresh[matched] = False
    seen = visible_points(sparse_map, ids[fresh[ids]], frame.T_camera_map)
    radius = np.where(seen.cosines > 0.998, 2.5, 4.0) * settings.local_radius * sparse_map.scales[seen.octaves]
    found = search_by_projection(
        seen.pixels, radius, seen.octaves - 1, seen.octaves, sparse_map.descriptors[seen.ids], frame.features, frame.grid,
        frame.points < 0, predicted_right=seen.right if sparse_map.camera.bf > 0 else None, max_distance=_TH_HIGH, ratio=0.8,
    )  # fmt: skip
    hits = np.flatnonzero(found >= 0)
    frame.points[found[hits]] = seen.ids[hits]
    held = refine_pose(sparse_map, frame)
    return LocalTrack(held=held, visible=np.concatenate([matched, seen.ids]))


def count_sightings(sparse_map: SparseMap, frame: Frame, visible: Ids) -> None:
    """Note which points a tracked frame should have seen, and which it did."""
    sparse_map.visible[visible] += 1
    sparse_map.found[frame.points[frame.points >= 0]] += 1


def refine_pose(sparse_map: SparseMap, frame: Frame) -> int:
    """Optimise the pose of a frame on all points that it sees; return how many hold, and let go of the others."""
    features = np.flatnonzero(frame.points >= 0)
    if len(features) < 3:
        return 0
    ids = frame.points[features]
    estimate = optimise_pose(
        frame.T_camera_map, sparse_map.positions[ids], frame.features.pixels[features], frame.features.right[features],
        frame.features.sigmas[features], sparse_map.camera,
    )  # fmt: skip
    frame.T_camera_map = estimate.T_camera_map
    frame.points[features[~estimate.inliers]] = -1
    return int(estimate.inliers.sum())
