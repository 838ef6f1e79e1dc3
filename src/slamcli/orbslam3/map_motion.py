# SPDX-License-Identifier: MIT
"""Keyframes move, and points and culled keyframes go along."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.similarities import apply, inverse, rigid_of, scale_of
from slamcli.orbslam3.sparse_map import Ids, SparseMap

Floats = NDArray[np.float64]


def propagate(sparse_map: SparseMap, keyframe: int, connected: Ids, S_camera_map: Floats) -> Floats:
    """Move the connected keyframes and their points rigidly to where the similarity of one puts them; return all S (K, 4, 4)."""
    S = sparse_map.T_camera_map.copy()
    correction = inverse(sparse_map.T_camera_map[keyframe]) @ S_camera_map  # S_before_after of the map
    S[connected] = sparse_map.T_camera_map[connected] @ correction
    ids = sparse_map.points_of(connected)
    sparse_map.positions[ids] = apply(inverse(correction), sparse_map.positions[ids])
    # they go along with the connected keyframe that sees them, not with one far away that saw them first
    owner = np.full(sparse_map.num_points, -1, dtype=np.int64)
    for k in connected[::-1].tolist():
        seen = sparse_map.seen[k]
        owner[seen[seen >= 0]] = k
    sparse_map.reference[ids] = owner[ids]
    sparse_map.T_camera_map[connected] = rigid_of(S[connected])
    return S


def carry_along(sparse_map: SparseMap, S_start: Floats, S_after: Floats) -> None:
    """Move living keyframes from S_start to S_after (K, 4, 4), points along with the keyframe they refer to."""
    alive = np.flatnonzero(sparse_map.point_alive)
    owner = anchors(sparse_map)[sparse_map.reference[alive]]
    change = inverse(S_after) @ S_start  # of the map around each keyframe
    sparse_map.positions[alive] = apply(change[owner], sparse_map.positions[alive])
    living = sparse_map.living_keyframes
    sparse_map.T_camera_map[living] = rigid_of(S_after[living])
    rescale_culled(sparse_map, 1.0 / scale_of(S_after))
    sparse_map.refresh_points(alive)


def anchors(sparse_map: SparseMap) -> Ids:
    """Return for each keyframe (K,) the living one that it hangs on: itself, or the nearest above it."""
    found = np.arange(sparse_map.num_keyframes)
    for k in np.flatnonzero(~sparse_map.keyframe_alive).tolist():
        above = int(sparse_map.parent[k])
        while not sparse_map.keyframe_alive[above]:
            above = int(sparse_map.parent[above])
        found[k] = above
    return found


def rescale_culled(sparse_map: SparseMap, factors: Floats) -> None:
    """Let culled keyframes hang on their parents in new units: lengths around keyframe k were multiplied by factors[k]."""
    culled = np.flatnonzero(~sparse_map.keyframe_alive)
    sparse_map.T_camera_parent[culled, :3, 3] *= factors[anchors(sparse_map)[culled]][:, None]
