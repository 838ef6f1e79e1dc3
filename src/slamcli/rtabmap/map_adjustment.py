# SPDX-License-Identifier: MIT
"""Bundle adjustment of the newest keyframes of the local map."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se3
from slamcli.rtabmap.local_map import Ids, LocalMap
from slamcli.vision.bundle_adjustment import adjust_in_rounds
from slamcli.vision.bundle_problem import BundleProblem

_ROUNDS = ((5, True), (5, False))


def adjust_newest(local_map: LocalMap, most: int, most_views: int = 0) -> None:
    """Move the newest `most` keyframes and what they see; older ones that see the same hold still, and the oldest if there are none.

    Points seen once follow their keyframe. What does not fit is no longer seen. Of each point the newest `most_views` views count; 0: all.
    """
    keyframes = local_map.keyframes
    if len(keyframes) < 2:
        return
    places, features, points = local_map.sightings()
    first_free = max(len(keyframes) - most, 0) if most else 0
    free = np.arange(len(keyframes)) >= max(first_free, 1)
    by_free = np.zeros(len(local_map), dtype=np.bool_)
    by_free[points[free[places]]] = True
    often = np.bincount(points, minlength=len(local_map)) >= 2
    used = (by_free & often)[points]
    if most_views:
        used &= _age(points) < most_views
    if np.count_nonzero(used) < 10:
        return
    ids, point_index = np.unique(points[used], return_inverse=True)
    cameras, camera_index = np.unique(places[used], return_inverse=True)
    held = ~free[cameras]
    if not held.any():
        held[0] = True
    seen = [keyframes[place].features for place in cameras.tolist()]
    chosen = [features[used & (places == place)] for place in cameras.tolist()]
    problem = BundleProblem(
        T_camera_map=np.array([keyframes[place].T_camera_odom for place in cameras.tolist()]), fixed=held,
        points=local_map.positions[ids], camera_index=camera_index, point_index=point_index,
        pixels=np.concatenate([f.pixels[at] for f, at in zip(seen, chosen, strict=True)]),
        right=np.concatenate([f.right[at] for f, at in zip(seen, chosen, strict=True)]),
        sigmas=np.concatenate([f.sigmas[at] for f, at in zip(seen, chosen, strict=True)]), camera=local_map.camera,
    )  # fmt: skip
    result = adjust_in_rounds(problem, rounds=_ROUNDS)
    local_map.positions[ids] = result.points
    for row, place in enumerate(cameras.tolist()):
        keyframe = keyframes[place]
        if held[row]:
            continue
        moved = se3.inverse(result.T_camera_map[row]) @ keyframe.T_camera_odom
        alone = keyframe.points[keyframe.points >= 0]
        alone = alone[~often[alone]]
        local_map.positions[alone] = local_map.positions[alone] @ moved[:3, :3].T + moved[:3, 3]
        keyframe.T_camera_odom = result.T_camera_map[row].copy()
    out = np.flatnonzero(used)[~result.inliers]
    for place, feature in zip(places[out].tolist(), features[out].tolist(), strict=True):
        keyframes[place].points[feature] = -1


def _age(points: Ids) -> Ids:
    """How many later views each of these views (M,) of points has; they come in the order of time."""
    order = np.argsort(points, kind="stable")
    _, first, counts = np.unique(points[order], return_index=True, return_counts=True)
    ages = np.empty(len(points), dtype=np.int64)
    ages[order] = np.repeat(first + counts, counts) - 1 - np.arange(len(points))
    return ages
