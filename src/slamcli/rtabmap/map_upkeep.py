# SPDX-License-Identifier: MIT
"""What a new keyframe sets off in the local map."""

from __future__ import annotations

import numpy as np

from slamcli.rtabmap.local_map import Floats, Ids, Keyframe, LocalMap
from slamcli.rtabmap.map_adjustment import adjust_newest
from slamcli.rtabmap.odometry_settings import OdometrySettings
from slamcli.vision.features import Features
from slamcli.vision.matching import FeatureGrid

_LEAST_VISIBLE, _LEAST_FOUND = 10, 0.25
"""A point that so many frames should have seen and fewer than this share of them did is none."""
_LEAST_SEEN = 10
"""A keyframe that sees fewer points of the map is let go."""


def insert_keyframe(
    local_map: LocalMap, features: Features, grid: FeatureGrid, T_camera_odom: Floats, points: Ids, frame: int,
    settings: OdometrySettings, T_base_camera: Floats,
) -> Keyframe:  # fmt: skip
    """Take a frame into the map with the points it sees (N,) and new ones from its depth; adjust and trim the map.

    `frame` is its number among all frames.
    """
    keyframe = local_map.add_keyframe(features, grid, T_camera_odom, points)
    fresh = np.flatnonzero(np.isfinite(features.depth) & (keyframe.points < 0))
    if settings.floor_threshold_m:
        fresh = fresh[_heights(local_map, features, fresh, T_base_camera) > settings.floor_threshold_m]
    if settings.most_new:
        fresh = fresh[: settings.most_new]
    local_map.add_points(keyframe, fresh, frame)
    if settings.adjust and settings.frame_to_map:
        adjust_newest(local_map, settings.bundle_frames, settings.most_views)
    trim(local_map, settings)
    local_map.refresh()
    return keyframe


def keep_last_keyframe(local_map: LocalMap, number: int) -> None:
    """Let all keyframes but the newest `number` go, and what only they saw."""
    local_map.keyframes = local_map.keyframes[len(local_map.keyframes) - number :] if number else []
    local_map.drop(~_seen(local_map, local_map.keyframes))


def trim(local_map: LocalMap, settings: OdometrySettings) -> None:
    """Take out what is not seen any more or seldom found, and the longest unseen points beyond the map's size.

    What the keyframes under adjustment see stays, however much that is: without it adjustment has little to hold on to.
    """
    gone = ~_seen(local_map, local_map.keyframes)
    gone |= (local_map.visible >= _LEAST_VISIBLE) & (local_map.found < _LEAST_FOUND * local_map.visible)
    too_many = len(local_map) - int(gone.sum()) - settings.map_size
    if too_many > 0:
        window = _seen(local_map, local_map.keyframes[-max(settings.bundle_frames, 1) :])
        order = np.lexsort((local_map.found, local_map.last_seen))
        order = order[~gone[order] & ~window[order]]
        gone[order[:too_many]] = True
    local_map.drop(gone)
    newest = local_map.keyframes[-1:]
    local_map.keyframes = [
        one for one in local_map.keyframes if one in newest or np.count_nonzero(one.points >= 0) >= _LEAST_SEEN
    ]


def _seen(local_map: LocalMap, keyframes: list[Keyframe]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which points (P,) some of the keyframes see."""
    seen = np.zeros(len(local_map), dtype=np.bool_)
    for keyframe in keyframes:
        seen[keyframe.points[keyframe.points >= 0]] = True
    return seen


def _heights(local_map: LocalMap, features: Features, rows: Ids, T_base_camera: Floats) -> Floats:
    """Heights (M,) of key points above the base frame, metres."""
    points = local_map.camera.back_project(features.pixels[rows], features.depth[rows])
    return points @ T_base_camera[2, :3] + T_base_camera[2, 3]
