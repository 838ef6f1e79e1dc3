# SPDX-License-Identifier: MIT
"""What a report shows of a map's keyframes: some pictures, and both sides of its loops."""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.pictures import KeyframeView, PlaceView

_MOST_KEYFRAMES, _MOST_LOOPS = 12, 6
_LEAST_MATCHES = 8
"""Fewer points that both sides see are no picture of a match."""


def keyframe_views(sparse_map: SparseMap) -> tuple[KeyframeView, ...]:
    """Return at most a dozen living keyframes that have pictures, spread over the map's time."""
    with_picture = [k for k in sparse_map.living_keyframes.tolist() if sparse_map.pictures[k] is not None]
    chosen = [with_picture[i] for i in _spread(len(with_picture), _MOST_KEYFRAMES)]
    found = (_view(sparse_map, k, np.flatnonzero(sparse_map.seen[k] >= 0)) for k in chosen)
    return tuple(view for view in found if view is not None)


def place_views(sparse_map: SparseMap, joins: Collection[tuple[int, int]]) -> tuple[PlaceView, ...]:
    """Return both sides of at most six loops, with the points that both see in the final map.

    Parameters
    ----------
    joins
        Stamps (older, newer) of the keyframes that joined two maps, so that they are not called loops.
    """
    found = []
    for a, b in sorted({(min(a, b), max(a, b)) for a, b in sparse_map.loop_edges}):
        edge = sparse_map.stamp_ns[[a, b]].tolist()
        kind: Literal["loop", "join"] = "join" if tuple(sorted(edge)) in joins else "loop"
        a, b = _living(sparse_map, a), _living(sparse_map, b)
        at_a, at_b = _common(sparse_map.seen[a], sparse_map.seen[b])
        older, newer = _view(sparse_map, a, at_a), _view(sparse_map, b, at_b)
        if a != b and len(at_a) >= _LEAST_MATCHES and older is not None and newer is not None:
            first, second = sorted((older, newer), key=lambda view: view.stamp_ns)
            found.append(PlaceView(older=first, newer=second, kind=kind))
    return tuple(found[i] for i in _spread(len(found), _MOST_LOOPS))


def _spread(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` rows, first and last among them."""
    if count <= most:
        return list(range(count))
    rows: list[int] = np.rint(np.linspace(0, count - 1, most)).astype(np.int64).tolist()
    return rows


def _living(sparse_map: SparseMap, keyframe: int) -> int:
    """Return a keyframe, or what it hangs on if it was culled."""
    while not sparse_map.keyframe_alive[keyframe]:
        keyframe = int(sparse_map.parent[keyframe])
    return keyframe


def _common(seen_a: Ids, seen_b: Ids) -> tuple[Ids, Ids]:
    """Return the features (M,) of both that see the same points."""
    rows_a, rows_b = np.flatnonzero(seen_a >= 0), np.flatnonzero(seen_b >= 0)
    _, at_a, at_b = np.intersect1d(seen_a[rows_a], seen_b[rows_b], return_indices=True)
    return rows_a[at_a], rows_b[at_b]


def _view(sparse_map: SparseMap, keyframe: int, features: NDArray[np.int64]) -> KeyframeView | None:
    picture = sparse_map.pictures[keyframe]
    if picture is None:
        return None
    return KeyframeView(
        stamp_ns=int(sparse_map.stamp_ns[keyframe]), picture=picture,
        places=picture.places(sparse_map.raw_pixels[keyframe, features]), num_features=sparse_map.counts[keyframe],
    )  # fmt: skip
