# SPDX-License-Identifier: MIT
"""New points of a keyframe: from depth, and from two keyframes that see the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.matching import match_epipolar
from slamcli.vision.triangulation import triangulate

_LEAST_CLOSE = 100
"""Points that a keyframe with depth gets at least, the closest first, however far they are (ORB-SLAM2)."""
_LEAST_BASELINE = 0.01
"""Of the distance between two cameras to the median depth of a scene without depth sensor."""


def points_from_depth(
    sparse_map: SparseMap,
    keyframe: int,
    close_m: float,
    colours: NDArray[np.uint8] | None = None,
    farthest_m: float = np.inf,
) -> Ids:
    """Add the points of a keyframe's features with depth that see none yet: all close ones, and at least the 100 closest."""
    n = sparse_map.counts[keyframe]
    depth, seen = sparse_map.depth[keyframe, :n], sparse_map.seen[keyframe, :n]
    order = np.flatnonzero(depth < farthest_m)  # NaN: unknown
    order = order[np.lexsort((order, depth[order]))]
    taken = (depth[order] < close_m) | (np.arange(len(order)) < _LEAST_CLOSE)
    fresh = order[taken & (seen[order] < 0)]
    camera = sparse_map.camera.back_project(sparse_map.pixels[keyframe, fresh], depth[fresh])
    T_map_camera = np.linalg.inv(sparse_map.T_camera_map[keyframe])
    positions = camera @ T_map_camera[:3, :3].T + T_map_camera[:3, 3]
    ids = sparse_map.add_points(positions, keyframe, fresh, None if colours is None else colours[fresh])
    sparse_map.refresh_points(ids)
    return ids


def points_from_neighbours(
    sparse_map: SparseMap,
    keyframe: int,
    neighbours: Ids,
    colours: NDArray[np.uint8] | None = None,
    farthest_m: float = np.inf,
) -> Ids:
    """Add points that a keyframe's free features see together with free features of its neighbours."""
    made = []
    for neighbour in neighbours.tolist():
        ids = _between(sparse_map, keyframe, neighbour, colours, farthest_m)
        made.append(ids)
    created = np.concatenate(made) if made else np.empty(0, dtype=np.int64)
    sparse_map.refresh_points(created)
    return created


def _between(sparse_map: SparseMap, a: int, b: int, colours: NDArray[np.uint8] | None, farthest_m: float) -> Ids:
    """Add the points that keyframes `a` and `b` see together."""
    none = np.empty(0, dtype=np.int64)
    T_a, T_b = sparse_map.T_camera_map[a], sparse_map.T_camera_map[b]
    T_b_a = T_b @ np.linalg.inv(T_a)
    if not _wide_enough(sparse_map, b, float(np.linalg.norm(T_b_a[:3, 3]))):
        return none
    seen_a, seen_b = sparse_map.seen[a, : sparse_map.counts[a]], sparse_map.seen[b, : sparse_map.counts[b]]
    nodes_a, nodes_b = nodes_of(sparse_map, a), nodes_of(sparse_map, b)
    matched = match_epipolar(
        sparse_map.features(a), seen_a < 0, nodes_a, sparse_map.features(b), seen_b < 0, nodes_b, T_b_a, sparse_map.camera,
    )  # fmt: skip
    at_a = np.flatnonzero(matched >= 0)
    if not len(at_a):
        return none
    at_b = matched[at_a]
    one, other = sparse_map.features(a), sparse_map.features(b)
    made = triangulate(
        T_a, T_b, one.pixels[at_a], other.pixels[at_b], sparse_map.camera, sigmas_a=one.sigmas[at_a], sigmas_b=other.sigmas[at_b],
        right_a=one.right[at_a], right_b=other.right[at_b], scale_factor=_factor(sparse_map),
    )  # fmt: skip
    positions = made.points
    with np.errstate(invalid="ignore"):
        good = made.ok & (positions @ T_a[2, :3] + T_a[2, 3] < farthest_m)
    at_a, at_b = at_a[good], at_b[good]
    ids = sparse_map.add_points(positions[good], a, at_a, None if colours is None else colours[at_a])
    sparse_map.see(b, at_b, ids)
    return ids


def nodes_of(sparse_map: SparseMap, keyframe: int) -> Ids | None:
    """Return the node of the vocabulary that each feature of a keyframe belongs to; None without a vocabulary."""
    words = sparse_map.words[keyframe]
    return None if words is None else words.nodes


def _factor(sparse_map: SparseMap) -> float:
    return float(sparse_map.scales[1]) if len(sparse_map.scales) > 1 else 1.2


def _wide_enough(sparse_map: SparseMap, neighbour: int, baseline_m: float) -> bool:
    """Return whether two cameras are far enough apart to triangulate: by a stereo baseline, or a share of the median depth."""
    if sparse_map.camera.baseline_m > 0:
        return baseline_m > sparse_map.camera.baseline_m
    ids = sparse_map.points_of(np.array([neighbour]))
    if not len(ids):
        return False
    T = sparse_map.T_camera_map[neighbour]
    depths = sparse_map.positions[ids] @ T[2, :3] + T[2, 3]
    return baseline_m / float(np.median(depths)) >= _LEAST_BASELINE
