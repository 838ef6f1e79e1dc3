# SPDX-License-Identifier: MIT
"""What is seen in two regions that turned out to be one becomes one."""

from __future__ import annotations

import numpy as np

from slamcli.orbslam3.fusion import fuse
from slamcli.orbslam3.place_recognition import PlaceMatch
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.region_matching import region_around
from slamcli.orbslam3.sparse_map import Ids, SparseMap

_RADIUS = 4.0
"""Pixels at the finest level."""


def fuse_region(sparse_map: SparseMap, match: PlaceMatch, connected: Ids, settings: PlaceSettings) -> int:
    """Join what the connected keyframes see with the region's points; return how many points became one."""
    alive = int(np.count_nonzero(sparse_map.point_alive))
    keyframe = match.keyframe
    features = np.flatnonzero(match.points >= 0)
    features = features[~np.isin(match.points[features], sparse_map.seen[keyframe])]
    own, given = sparse_map.seen[keyframe, features].copy(), match.points[features]
    region = sparse_map.points_of(region_around(sparse_map, match.place.keyframe, 2 * settings.region_size))
    sparse_map.see(keyframe, features[own < 0], given[own < 0])
    sparse_map.merge_points(own[own >= 0], given[own >= 0])
    for k in connected.tolist():
        region = np.unique(sparse_map.resolved(region))
        region = region[region >= 0]
        fuse(sparse_map, k, region, _RADIUS, T_camera_map=sparse_map.T_camera_map[k], prefer_given=True)
    return alive - int(np.count_nonzero(sparse_map.point_alive))
