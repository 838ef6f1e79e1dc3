# SPDX-License-Identifier: MIT
"""Where a frame was taken, by the points of the local map that it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamcli.errors import EstimationError
from slamcli.rtabmap.local_map import Floats, Ids, Keyframe, LocalMap
from slamcli.rtabmap.odometry_settings import OdometrySettings
from slamcli.vision.features import Features
from slamcli.vision.matching import FeatureGrid, match_brute_force, search_by_projection
from slamcli.vision.pnp import estimate_pose_pnp
from slamcli.vision.pose_optimisation import PoseEstimate, optimise_pose

_FAR, _NEAR = 100, 64
"""Bits by which descriptors of one point may differ: where the place is sure, and where nothing is known."""
_SURE_WINDOW = 3.0
"""Pixels of the finest level around where a known pose puts a point."""
_FIRST_WINDOW = 15.0
_GUIDED_WINDOWS = (10.0, _SURE_WINDOW)
"""The same around a pose by RANSAC, first and last."""
_DRAWS = 3
"""Times that RANSAC is run for a keyframe, each with other samples: with few true matches the best of one run is often poor."""
_STRICTNESS = ((_NEAR, 0.8), (_FAR, 1.0))
"""Largest distance and ratio to the second best without a guess: strictly, then as loosely as RANSAC can bear."""
_NUM_SKETCHED, _NUM_ALIKE = 150, 5
"""Features of a frame that are compared with keyframes, and keyframes that are tried then."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameMatch:
    """A pose and what speaks for it."""

    T_camera_odom: Floats
    """float64 (4, 4)."""
    points: Ids
    """(N,), row of the map's point that each feature sees, or -1."""
    information: Floats
    """float64 (6, 6), as `slamcli.vision.pose_optimisation.PoseEstimate`."""
    visible: Ids
    """Rows of points that should be seen."""
    mean_chi2: float = 1.0
    """Of the inliers, per degree of freedom."""

    @property
    def num_inliers(self) -> int:
        """Points that agree."""
        return int(np.count_nonzero(self.points >= 0))


class FrameMatcher:
    """Matches one frame after the other."""

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings

    def by_guess(
        self, local_map: LocalMap, features: Features, grid: FeatureGrid, T_guess: Floats
    ) -> FrameMatch | None:
        """Return the pose found from a guess: points in a window around it, in a wider one if that gives few, then closely."""
        for window in (_FIRST_WINDOW, self._settings.window):
            seen = local_map.seen_from(T_guess)
            if len(seen.rows) < self._settings.min_inliers:
                return None
            found = search_by_projection(
                seen.pixels, window * local_map.scales[seen.octaves], seen.octaves - 1, seen.octaves + 1,
                local_map.descriptors[seen.rows], features, grid, np.ones(len(features), dtype=np.bool_),
                max_distance=_FAR, ratio=self._settings.ratio,
            )  # fmt: skip
            hits = np.flatnonzero(found >= 0)
            if len(hits) < self._settings.min_inliers:
                continue
            estimate = _optimised(local_map, features, T_guess, found[hits], seen.rows[hits])
            if estimate.num_inliers >= max(self._settings.min_inliers // 2, 0.3 * len(hits)):
                return self.closely(local_map, features, grid, estimate.T_camera_map)
        return None

    def by_looks(
        self, local_map: LocalMap, features: Features, grid: FeatureGrid, keyframes: Sequence[Keyframe], best: FrameMatch | None,
        number: int, enough: int,
    ) -> FrameMatch | None:  # fmt: skip
        """Return the pose with most inliers: `best`, or one found from the descriptors of one of the keyframes alone.

        `number` is the frame's; a pose with `enough` inliers ends the search.
        """
        for keyframe in keyframes:
            if best is not None and best.num_inliers >= enough:
                break
            for most, ratio in _STRICTNESS:
                other = self._by_keyframe(local_map, features, grid, keyframe, number, most, ratio, enough)
                if other is not None and (best is None or other.num_inliers > best.num_inliers):
                    best = other
                if best is not None and best.num_inliers >= enough:
                    break
        return best

    def alike(self, keyframes: Sequence[Keyframe], features: Features) -> list[Keyframe]:
        """Return the keyframes that the frame's strongest features look like most, the best first."""
        sketch = features.descriptors[:_NUM_SKETCHED]
        counted = []
        for keyframe in keyframes:
            rows = np.flatnonzero(keyframe.points >= 0)
            if len(rows) and len(sketch):
                matched = match_brute_force(
                    sketch, keyframe.features.descriptors[rows], max_distance=_NEAR, ratio=self._settings.ratio
                )
                counted.append((-int(np.count_nonzero(matched >= 0)), -keyframe.number, keyframe))
        counted.sort(key=lambda one: one[:2])
        return [keyframe for count, _, keyframe in counted[:_NUM_ALIKE] if count < 0]

    def _by_keyframe(
        self, local_map: LocalMap, features: Features, grid: FeatureGrid, keyframe: Keyframe, number: int, most: int,
        ratio: float, enough: int,
    ) -> FrameMatch | None:  # fmt: skip
        rows = np.flatnonzero(keyframe.points >= 0)
        if len(rows) < self._settings.min_inliers or len(features) == 0:
            return None
        matched = match_brute_force(
            keyframe.features.descriptors[rows], features.descriptors, max_distance=most, ratio=ratio,
            angles_a=keyframe.features.angles[rows], angles_b=features.angles,
        )  # fmt: skip
        hits = np.flatnonzero(matched >= 0)
        points = keyframe.points[rows[hits]]
        best: FrameMatch | None = None
        for turn in range(_DRAWS):
            try:
                sampled = estimate_pose_pnp(
                    local_map.positions[points], features.pixels[matched[hits]], features.sigmas[matched[hits]], local_map.camera,
                    seed=self._settings.seed + _DRAWS * number + turn, iterations=self._settings.iterations,
                    min_inliers=max(self._settings.min_inliers // 2, 6), right=features.right[matched[hits]],
                )  # fmt: skip
            except EstimationError:
                continue
            match = self.closely(local_map, features, grid, sampled.T_camera_map, _GUIDED_WINDOWS)
            if match is not None and (best is None or match.num_inliers > best.num_inliers):
                best = match
            if best is not None and best.num_inliers >= enough:
                break
        return best

    def closely(
        self, local_map: LocalMap, features: Features, grid: FeatureGrid, T_camera_odom: Floats, windows: tuple[float, ...] = (_SURE_WINDOW,)
    ) -> FrameMatch | None:  # fmt: skip
        """Return the pose that all points agree on near a pose that is known well; None with too few."""
        for window in windows:
            seen = local_map.seen_from(T_camera_odom)
            found = search_by_projection(
                seen.pixels, window * np.where(seen.cosines > 0.998, 1.0, 1.6) * local_map.scales[seen.octaves], seen.octaves - 1,
                seen.octaves + 1, local_map.descriptors[seen.rows], features, grid, np.ones(len(features), dtype=np.bool_),
                predicted_right=seen.right, max_distance=_FAR, ratio=0.9,
            )  # fmt: skip
            hits = np.flatnonzero(found >= 0)
            if len(hits) < self._settings.min_inliers:
                return None
            estimate = _optimised(local_map, features, T_camera_odom, found[hits], seen.rows[hits])
            T_camera_odom = estimate.T_camera_map
        if estimate.num_inliers < self._settings.min_inliers:
            return None
        points = np.full(len(features), -1, dtype=np.int64)
        good = hits[estimate.inliers]
        points[found[good]] = seen.rows[good]
        degrees = 2 * estimate.num_inliers + np.count_nonzero(np.isfinite(features.right[found[good]])) - 6
        return FrameMatch(
            T_camera_odom=T_camera_odom, points=points, information=estimate.information, visible=seen.rows,
            mean_chi2=float(estimate.chi2[estimate.inliers].sum() / max(degrees, 1)),
        )  # fmt: skip


def _optimised(local_map: LocalMap, features: Features, T_guess: Floats, at: Ids, rows: Ids) -> PoseEstimate:
    return optimise_pose(
        T_guess,
        local_map.positions[rows],
        features.pixels[at],
        features.right[at],
        features.sigmas[at],
        local_map.camera,
    )
