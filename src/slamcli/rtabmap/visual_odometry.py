# SPDX-License-Identifier: MIT
"""Visual odometry against a local map."""

from __future__ import annotations

from collections import Counter

import numpy as np

from slamcli.geometry import se3
from slamcli.geometry.motion import part_of
from slamcli.rtabmap.frame_matching import FrameMatch, FrameMatcher
from slamcli.rtabmap.local_map import Floats, LocalMap
from slamcli.rtabmap.map_adjustment import adjust_newest
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.odometry_settings import OdometrySettings
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.pinhole import Pinhole

_SURELY = 100


class VisualOdometry:
    def __init__(self, settings: OdometrySettings, camera: Pinhole, T_base_camera: Floats, *, seed: int = 0) -> None:
        self.settings, self.camera = settings, camera
        self._T_base_camera, self._T_camera_base = T_base_camera, se3.inverse(T_base_camera)
        self.counts: Counter[str] = Counter()
        self._matcher = FrameMatcher(settings, seed)
        self._map = LocalMap(camera, settings.scales)
        self._number = -1
        self._last: Features | None = None
        self._last_ns = 0
        self._T_last: Floats = self._T_camera_base.copy()  # T_camera_odom
        self._velocity: Floats | None = None
        self._velocity_ns = 1
        self._keyframe_ns = 0
        self._kept = 0
        self._keyframe_poses: list[Floats] = []
        self._frames: list[tuple[int, int, Floats]] = []

    def step(self, stamp_ns: int, features: Features, guess: Floats | None = None) -> OdometryStep:
        self._number += 1
        grid = feature_grid(features, self.camera)
        if not self._map.keyframes:
            return self._begin(stamp_ns, features, grid)
        if self._repeats(features):
            key, T = self._frames[-1][1:]
            self._frames.append((stamp_ns, key, T))
            self.counts["repeated"] += 1
            return self._result(stamp_ns, 0, len(features), False)
        match = self._track(stamp_ns, features, grid, guess)
        if match is None:
            self.counts["lost"] += 1
            self._velocity = None
            return OdometryStep(
                stamp_ns=stamp_ns, T_odom_base=None, covariance=np.zeros((6, 6)), num_features=len(features)
            )
        return self._keep(stamp_ns, features, grid, match)

    def _repeats(self, features: Features) -> bool:
        last = self._last
        return (
            last is not None
            and len(last) == len(features) > 0
            and np.array_equal(last.pixels, features.pixels)
            and np.array_equal(last.descriptors, features.descriptors)
        )

    def _begin(self, stamp_ns, features, grid):
        depth = np.flatnonzero(np.isfinite(features.depth))
        if len(depth) < self.settings.min_inliers:
            return OdometryStep(
                stamp_ns=stamp_ns, T_odom_base=None, covariance=np.zeros((6, 6)), num_features=len(features)
            )
        self._add_keyframe(stamp_ns, features, grid, self._T_last, np.full(len(features), -1, dtype=np.int64))
        self._last, self._last_ns = features, stamp_ns
        self._frames.append((stamp_ns, len(self._keyframe_poses) - 1, np.eye(4)))
        return self._result(stamp_ns, len(depth), len(features), True)

    def _predicted(self, stamp_ns, guess):
        if guess is not None:
            return self._T_camera_base @ se3.inverse(guess) @ self._T_base_camera @ self._T_last
        if self._velocity is None:
            return self._T_last
        return part_of(self._velocity, (stamp_ns - self._last_ns) / self._velocity_ns) @ self._T_last

    def _track(self, stamp_ns, features, grid, guess) -> FrameMatch | None:
        best = self._matcher.by_guess(self._map, features, grid, self._predicted(stamp_ns, guess))
        if best is not None and best.num_inliers >= _SURELY:
            return best
        for keyframe in self._map.keyframes[:-7:-1]:
            other = self._matcher.by_looks(self._map, features, grid, keyframe, self._number)
            if other is not None and (best is None or other.num_inliers > best.num_inliers):
                best = other
                self.counts["by looks"] += 1
            if best is not None and best.num_inliers >= _SURELY:
                break
        return best

    def _keep(self, stamp_ns, features, grid, match):
        T = match.T_camera_odom
        self._velocity, self._velocity_ns = T @ se3.inverse(self._T_last), max(stamp_ns - self._last_ns, 1)
        self._map.visible[match.visible] += 1
        rows = match.points[match.points >= 0]
        self._map.found[rows] += 1
        self._map.last_seen[rows] = self._number
        held = match.num_inliers
        s = self.settings
        key = (
            held < s.keyframe_share * len(features)
            or held < s.keyframe_inliers
            or (held < s.keyframe_kept * self._kept and stamp_ns - self._keyframe_ns >= s.keyframe_gap_ns)
        )
        if key:
            T = self._add_keyframe(stamp_ns, features, grid, T, match.points)
        reference = self._map.keyframes[-1]
        self._frames.append((stamp_ns, reference.number, T @ se3.inverse(reference.T_camera_odom)))
        self._T_last, self._last, self._last_ns = T, features, stamp_ns
        return self._result(stamp_ns, held, len(features), key)

    def _add_keyframe(self, stamp_ns, features, grid, T, points):
        m, s = self._map, self.settings
        keyframe = m.add_keyframe(features, grid, T, points)
        self._keyframe_poses.append(keyframe.T_camera_odom)
        fresh = np.flatnonzero(np.isfinite(features.depth) & (keyframe.points < 0))
        if s.most_new:
            fresh = fresh[: s.most_new]
        rows = m.add_points(keyframe, fresh, self._number)
        self._fuse(keyframe, rows)
        if s.adjust:
            adjust_newest(m, s.bundle_frames)
        self._cull()
        m.refresh()
        for k in m.keyframes:
            self._keyframe_poses[k.number] = k.T_camera_odom
        self._kept = int(np.count_nonzero(keyframe.points >= 0))
        self._keyframe_ns = stamp_ns
        self.counts["keyframes"] += 1
        return keyframe.T_camera_odom

    def _fuse(self, keyframe, rows):
        pass

    def _cull(self):
        m = self._map
        seen = np.zeros(len(m), dtype=np.bool_)
        for k in m.keyframes:
            seen[k.points[k.points >= 0]] = True
        gone = ~seen | ((m.visible >= 10) & (m.found < 0.25 * m.visible))
        if len(m) - gone.sum() > self.settings.map_size:
            window = np.zeros(len(m), dtype=np.bool_)
            for k in m.keyframes[-self.settings.bundle_frames :]:
                window[k.points[k.points >= 0]] = True
            order = np.lexsort((m.found, m.last_seen, window, ~gone))  # the first go first
            gone[order[: len(m) - self.settings.map_size]] = True
            gone &= ~window | ~seen
        m.drop(gone)
        m.keyframes = [k for k in m.keyframes if k is m.keyframes[-1] or np.count_nonzero(k.points >= 0) >= 10]

    def _result(self, stamp_ns, inliers, num, key):
        T = se3.inverse(self._pose(len(self._frames) - 1)) @ self._T_camera_base
        return OdometryStep(
            stamp_ns=stamp_ns, T_odom_base=T, covariance=np.eye(6), num_features=num, num_inliers=inliers, keyframe=key
        )

    def _pose(self, index):
        _, key, T = self._frames[index]
        return T @ self._keyframe_poses[key]

    def track(self):
        stamps = np.array([f[0] for f in self._frames])
        return stamps, np.array([se3.inverse(self._pose(i)) @ self._T_camera_base for i in range(len(self._frames))])
