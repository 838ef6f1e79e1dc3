# SPDX-License-Identifier: MIT
"""One point for what two keyframes see of the same thing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.orbslam3.visible_points import visible_points
from slamcli.vision.matching import search_by_projection

_RADIUS = 3.0
_TH_LOW = 50
_CHI2_MONO, _CHI2_STEREO = 5.99, 7.8


def fuse_around(sparse_map: SparseMap, keyframe: int, neighbours: Ids) -> None:
    """Fuse a keyframe's points with those of its neighbours, both ways (ORB-SLAM3, SearchInNeighbors)."""
    own = sparse_map.points_of(np.array([keyframe]))
    for neighbour in neighbours.tolist():
        fuse(sparse_map, neighbour, own[sparse_map.point_alive[own]])
    others = sparse_map.points_of(neighbours)
    fuse(sparse_map, keyframe, others)
    sparse_map.refresh_points(sparse_map.points_of(np.array([keyframe])))


def fuse(
    sparse_map: SparseMap,
    keyframe: int,
    ids: Ids,
    radius: float = _RADIUS,
    T_camera_map: NDArray[np.float64] | None = None,
    prefer_given: bool = False,
) -> int:
    """Look for points in a keyframe: where a feature sees another point they become one, where it sees none it sees this one.

    Parameters
    ----------
    radius
        Pixels at the finest level.
    T_camera_map
        Where the keyframe is taken to be; None: where the map says.
    prefer_given
        Whether the given point stays (loop closing) rather than the one that more keyframes see.

    Returns
    -------
    int
        How many were found.
    """
    row = sparse_map.seen[keyframe, : sparse_map.counts[keyframe]]
    known = np.zeros(sparse_map.num_points, dtype=np.bool_)
    known[row[row >= 0]] = True
    pose = sparse_map.T_camera_map[keyframe] if T_camera_map is None else T_camera_map
    seen = visible_points(sparse_map, ids[~known[ids]], pose)
    if not len(seen.ids):
        return 0
    features = sparse_map.features(keyframe)
    found = search_by_projection(
        seen.pixels, radius * sparse_map.scales[seen.octaves], seen.octaves - 1, seen.octaves, sparse_map.descriptors[seen.ids], features,
        sparse_map.grids[keyframe], np.ones(len(features), dtype=np.bool_), max_distance=_TH_LOW,
    )  # fmt: skip
    hits = np.flatnonzero(found >= 0)
    at, ids = found[hits], seen.ids[hits]
    if T_camera_map is None:
        apart = ((features.pixels[at] - seen.pixels[hits]) ** 2).sum(axis=1)
        with np.errstate(invalid="ignore"):
            across = (features.right[at] - seen.right[hits]) ** 2
        stereo = np.isfinite(across)
        chi2 = (apart + np.where(stereo, across, 0.0)) / features.sigmas[at] ** 2
        good = chi2 < np.where(stereo, _CHI2_STEREO, _CHI2_MONO)
        at, ids = at[good], ids[good]
    free = row[at] < 0
    sparse_map.see(keyframe, at[free], ids[free])
    there, given = sparse_map.seen[keyframe, at[~free]].copy(), ids[~free]
    if len(there):
        if prefer_given:
            sparse_map.merge_points(there, given)
        else:
            stays = sparse_map.count_observations(there) >= sparse_map.count_observations(given)
            sparse_map.merge_points(np.where(stays, given, there), np.where(stays, there, given))
    return len(at)
