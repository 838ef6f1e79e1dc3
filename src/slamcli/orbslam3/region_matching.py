# SPDX-License-Identifier: MIT
"""What a keyframe sees of a region of a map that it does not know to be the same: by descriptors, then by projection."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.similarities import rigid_of
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.orbslam3.visible_points import visible_points
from slamcli.vision.matching import match_brute_force, match_by_words, search_by_projection

_TH_LOW = 50
_RATIO = 0.9


class RegionMatch(NamedTuple):
    """Features of a keyframe and the points of another region that look like them, as columns; no point twice."""

    best: int
    """Keyframe of the region that most of the matches came from."""
    features: Ids
    """(N,), rows of the keyframe; each sees a point of its own."""
    points: Ids
    """(N,), of the region's map."""
    sigmas: NDArray[np.float64]
    """(N,), of the feature that shows the point in the region, pixels."""


def region_around(sparse_map: SparseMap, keyframe: int, size: int) -> Ids:
    """Return a keyframe and the `size` ones that share most points with it, itself first."""
    neighbours, _ = sparse_map.covisible(keyframe)
    return np.concatenate([[keyframe], neighbours[:size]]).astype(np.int64)


def match_region(sparse_map: SparseMap, keyframe: int, other: SparseMap, region: Ids) -> RegionMatch:
    """Return which points of a region (keyframes of `other`) a keyframe's features look like.

    Only features that see a point are compared, under the same word where there is a vocabulary; matches must agree on how
    far the image turned. The region's first keyframe has the first word.
    """
    own = sparse_map.seen[keyframe, : sparse_map.counts[keyframe]]
    found = np.full(len(own), -1, dtype=np.int64)
    sigmas = np.ones(len(own))
    taken = np.zeros(other.num_points, dtype=np.bool_)
    best, most = int(region[0]), -1
    for k in region.tolist():
        matched = _match(sparse_map, keyframe, other, k)
        rows = np.flatnonzero(matched >= 0)
        if len(rows) > most:
            best, most = k, len(rows)
        ids = other.seen[k, matched[rows]]
        fresh = (found[rows] < 0) & ~taken[ids]
        if sparse_map is other:
            fresh &= ids != own[rows]
        rows, ids = rows[fresh], ids[fresh]
        found[rows], sigmas[rows] = ids, other.sigmas[k, matched[rows]]
        taken[ids] = True
    features = np.flatnonzero(found >= 0)
    return RegionMatch(best, features, found[features], sigmas[features])


def _match(sparse_map: SparseMap, keyframe: int, other: SparseMap, k: int) -> Ids:
    """Return the feature of keyframe k of `other` for each feature of a keyframe (F,), or -1; both see points."""
    n, m = sparse_map.counts[keyframe], other.counts[k]
    a, b = sparse_map.seen[keyframe, :n] >= 0, other.seen[k, :m] >= 0
    words_a, words_b = sparse_map.words[keyframe], other.words[k]
    if words_a is not None and words_b is not None:
        return match_by_words(
            sparse_map.key_descriptors[keyframe, :n], words_a.nodes, other.key_descriptors[k, :m], words_b.nodes,
            max_distance=_TH_LOW, ratio=_RATIO, angles_a=sparse_map.angles[keyframe, :n], angles_b=other.angles[k, :m],
            free_a=a, free_b=b,
        )  # fmt: skip
    rows_a, rows_b = np.flatnonzero(a), np.flatnonzero(b)
    out = np.full(n, -1, dtype=np.int64)
    if not len(rows_a) or not len(rows_b):
        return out
    matched = match_brute_force(
        sparse_map.key_descriptors[keyframe, rows_a], other.key_descriptors[k, rows_b], max_distance=_TH_LOW, ratio=_RATIO,
        angles_a=sparse_map.angles[keyframe, rows_a], angles_b=other.angles[k, rows_b],
    )  # fmt: skip
    hits = matched >= 0
    out[rows_a[hits]] = rows_b[matched[hits]]
    return out


def project_region(
    sparse_map: SparseMap,
    keyframe: int,
    other: SparseMap,
    ids: Ids,
    S_camera_other: NDArray[np.float64],
    *,
    radius: float,
    max_distance: int,
) -> Ids:
    """Return the point of `ids`, of `other`, that each feature of a keyframe shows, (F,) or -1.

    Parameters
    ----------
    S_camera_other
        float64 (4, 4), similarity that takes points of `other` to the keyframe's camera.
    radius
        Pixels at the finest level around where a point should be.
    max_distance
        Bits.
    """
    features = sparse_map.features(keyframe)
    found = np.full(len(features), -1, dtype=np.int64)
    seen = visible_points(other, ids, rigid_of(S_camera_other))
    if not len(seen.ids):
        return found
    matched = search_by_projection(
        seen.pixels, radius * other.scales[seen.octaves], seen.octaves - 1, seen.octaves, other.descriptors[seen.ids], features,
        sparse_map.grids[keyframe], np.ones(len(features), dtype=np.bool_), max_distance=max_distance,
    )  # fmt: skip
    hits = np.flatnonzero(matched >= 0)
    found[matched[hits]] = seen.ids[hits]
    if sparse_map is other:  # what it sees already is no news
        own = sparse_map.seen[keyframe, : len(features)]
        found[(found >= 0) & (found == own)] = -1
    return found
