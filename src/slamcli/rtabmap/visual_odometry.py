# SPDX-License-Identifier: MIT
"""Visual odometry: each frame is matched to a local map of points, which its keyframes make and adjust.

M. Labbé, F. Michaud, "RTAB-Map as an open-source lidar and visual SLAM library for large-scale and long-term online operation", JFR 36(2),
2019, doi:10.1002/rob.21831, section 3.1 (frame to map); R. Mur-Artal, J. D. Tardos, IEEE T-RO 33(5), 2017 (poses and adjustment).
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.frame_matching import FrameMatch, FrameMatcher
from slamcli.rtabmap.local_map import Floats, Ids, LocalMap
from slamcli.rtabmap.map_upkeep import insert_keyframe, keep_last_keyframe
from slamcli.rtabmap.motion_covariance import motion_covariance
from slamcli.rtabmap.motion_guess import MotionGuess
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.odometry_settings import OdometrySettings
from slamcli.rtabmap.odometry_track import OdometryTrack
from slamcli.vision.features import Features
from slamcli.vision.matching import FeatureGrid, feature_grid
from slamcli.vision.pinhole import Pinhole

_SURELY = 100
"""With fewer inliers keyframes are tried by their looks besides the guess, and the best wins."""
_MANY = 200
"""With so many by looks no other keyframe is tried."""
_KEEPS = 0.8
"""So too, with the newest of them alone, where a frame has fewer than this share of the inliers of the one before: a guess that is off,
as where a turn begins, finds its like in what repeats."""
_NEWEST = 6
"""Keyframes that are tried by their looks; for a frame that these do not explain, others that look like it as well."""


class VisualOdometry:
    """Takes the features of one frame after the other.

    Parameters
    ----------
    settings
        How to track.
    camera
        The ideal camera with a (virtual) baseline, as `FeatureExtractor.camera`.
    T_base_camera
        float64 (4, 4), its pose in the base frame.
    """

    def __init__(self, settings: OdometrySettings, camera: Pinhole, T_base_camera: Floats) -> None:
        self.settings, self.camera = settings, camera
        self.counts: Counter[str] = Counter()
        """What happened how often."""
        self._T_base_camera, self._T_camera_base = T_base_camera, se3.inverse(T_base_camera)
        self._matcher = FrameMatcher(settings)
        self._guess = MotionGuess(settings, T_base_camera)
        self._track = OdometryTrack(settings, T_base_camera)
        self._map = LocalMap(camera, settings.scales)
        self._number = -1
        self._last: Features | None = None
        self._T_last = self._T_camera_base
        """T_camera_odom of the last frame that has a pose."""
        self._keyframe_ns, self._keyframe_frame = 0, 0
        """Stamp and number of the frame that became the newest keyframe."""
        self._kept = 0
        """Points that the newest keyframe sees."""
        self._held = 0
        """Inliers of the last frame that has a pose."""
        self._num_lost = 0
        """Frames in a row."""

    def step(self, stamp_ns: int, features: Features, guess: Floats | None = None) -> OdometryStep:
        """Return where the next frame was taken.

        Parameters
        ----------
        features
            As `FeatureExtractor.extract` returns them.
        guess
            float64 (4, 4), T_prev_cur of the base since the last frame that has a pose, by other sensors; None: none.
        """
        self._number += 1
        grid = feature_grid(features, self.camera)
        if not self._map.keyframes:
            return self._begin(stamp_ns, features, grid, anew=self._last is not None)
        if self._num_lost == 0 and _repeats(self._last, features):
            self.counts["frames that repeat the one before"] += 1
            self._track.repeat(stamp_ns)
            return self._told(stamp_ns, features, np.zeros((6, 6)), len(features))
        match = self._match(stamp_ns, features, grid, guess)
        if match is None:
            return self._lose(stamp_ns, features, grid)
        self._num_lost = 0
        return self._keep(stamp_ns, features, grid, match)

    def track(self) -> tuple[NDArray[np.int64], Floats]:
        """Return stamps (F,) and poses of the base (F, 4, 4) in the odometry's frame, of all frames that have one, as known by now.

        Each frame hangs on a keyframe, and keyframes lie where their last adjustment left them.
        """
        return self._track.poses()

    def _begin(self, stamp_ns: int, features: Features, grid: FeatureGrid, *, anew: bool = False) -> OdometryStep:
        if np.count_nonzero(np.isfinite(features.depth)) < self.settings.min_inliers:
            return _nowhere(stamp_ns, features)
        self._guess.forget()
        self._num_lost = 0
        self._add_keyframe(stamp_ns, features, grid, self._T_last, np.full(len(features), -1, dtype=np.int64))
        self._track.add(stamp_ns, self._map.keyframes[-1], self._T_last, begins=True)
        self._last = features
        held = self._kept
        self.counts["resets"] += anew
        return self._told(stamp_ns, features, np.zeros((6, 6)), held, keyframe=True, began_anew=anew)

    def _match(self, stamp_ns: int, features: Features, grid: FeatureGrid, guess: Floats | None) -> FrameMatch | None:
        """Find out where the frame was taken; None: it is lost."""
        best = self._matcher.by_guess(self._map, features, grid, self._guess.predicted(stamp_ns, self._T_last, guess))
        if best is not None and best.num_inliers >= _SURELY:
            enough = int(_KEEPS * self._held)
            if best.num_inliers >= enough:
                return best
            newest = self._map.keyframes[-1:]
            return self._matcher.by_looks(self._map, features, grid, newest, best, self._number, enough)
        newest = self._map.keyframes[: -_NEWEST - 1 : -1]
        best = self._matcher.by_looks(self._map, features, grid, newest, best, self._number, _MANY)
        if best is None:
            alike = self._matcher.alike(self._map.keyframes[:-_NEWEST], features)
            best = self._matcher.by_looks(self._map, features, grid, alike, best, self._number, _MANY)
        return best

    def _lose(self, stamp_ns: int, features: Features, grid: FeatureGrid) -> OdometryStep:
        self.counts["frames lost"] += 1
        self._num_lost += 1
        self._guess.forget()
        if 0 < self.settings.reset_countdown <= self._num_lost:
            self._map = LocalMap(self.camera, self.settings.scales, num_before=self._map.num_keyframes)
            return self._begin(stamp_ns, features, grid, anew=True)
        return _nowhere(stamp_ns, features)

    def _keep(self, stamp_ns: int, features: Features, grid: FeatureGrid, match: FrameMatch) -> OdometryStep:
        """Take the frame's pose, and the frame into the map where that needs one."""
        self._map.note_sightings(match.points, match.visible, self._number)
        self._guess.add(stamp_ns, match.T_camera_odom @ se3.inverse(self._T_last))
        covariance = motion_covariance(match, self._T_base_camera)
        self._T_last, self._last, self._held = match.T_camera_odom, features, match.num_inliers
        keyframe = self._wants_keyframe(stamp_ns, features, match)
        if keyframe:
            self._T_last = self._add_keyframe(stamp_ns, features, grid, match.T_camera_odom, match.points)
        self._track.add(stamp_ns, self._map.keyframes[-1], self._T_last)
        return self._told(stamp_ns, features, covariance, match.num_inliers, keyframe=keyframe)

    def _wants_keyframe(self, stamp_ns: int, features: Features, match: FrameMatch) -> bool:
        settings, held = self.settings, match.num_inliers
        few = held < settings.keyframe_share * len(features) or held < settings.keyframe_inliers
        fewer = held < settings.keyframe_kept * self._kept
        age_ns = stamp_ns - self._keyframe_ns
        skipped = self._number > self._keyframe_frame + 1
        due = age_ns >= (settings.keyframe_gap_ns if skipped else settings.keyframe_age_ns)
        wanted = few or (fewer and due)
        if wanted and settings.adjust and settings.least_motion_px > 0.0:
            return self._map.keyframes[-1].mean_motion(features, match.points) >= settings.least_motion_px
        return wanted

    def _add_keyframe(
        self, stamp_ns: int, features: Features, grid: FeatureGrid, T_camera_odom: Floats, points: Ids
    ) -> Floats:
        """Take a frame into the map; return its pose T_camera_odom after the adjustment."""
        if not self.settings.frame_to_map:
            keep_last_keyframe(self._map, 0)
            points = np.full(len(features), -1, dtype=np.int64)
        keyframe = insert_keyframe(
            self._map, features, grid, T_camera_odom, points, self._number, self.settings, self._T_base_camera
        )
        self._kept = int(np.count_nonzero(keyframe.points >= 0))
        self._keyframe_ns, self._keyframe_frame = stamp_ns, self._number
        self._track.settle(self._map.keyframes)
        self.counts["keyframes"] += 1
        return keyframe.T_camera_odom

    def _told(
        self, stamp_ns: int, features: Features, covariance: Floats, num_inliers: int, *, keyframe: bool = False,
        began_anew: bool = False,
    ) -> OdometryStep:  # fmt: skip
        return OdometryStep(
            stamp_ns=stamp_ns, T_odom_base=self._track.newest(), covariance=covariance, began_anew=began_anew,
            num_features=len(features), num_inliers=num_inliers, keyframe=keyframe,
        )  # fmt: skip


def _repeats(last: Features | None, features: Features) -> bool:
    """Return whether a frame shows the very image of the last one, as drivers send when they have no new one."""
    return (
        last is not None
        and len(last) == len(features) > 0
        and np.array_equal(last.pixels, features.pixels)
        and np.array_equal(last.descriptors, features.descriptors)
    )


def _nowhere(stamp_ns: int, features: Features) -> OdometryStep:
    return OdometryStep(stamp_ns=stamp_ns, T_odom_base=None, covariance=np.zeros((6, 6)), num_features=len(features))
