# SPDX-License-Identifier: MIT
"""What a report shows of nodes: some pictures of what the camera saw, and both sides of closures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.database import Database
from slamcli.rtabmap.sights import Sight, Sights
from slamcli.vision.pictures import KeyframeView, Picture, PlaceView
from slamcli.vision.reduction import reduced_picture

_MOST_NODES, _MOST_CLOSURES, _MOST_REFUSED = 12, 6, 4


def node_views(database: Database, ids: Sequence[int], stamps_ns: NDArray[np.int64]) -> tuple[KeyframeView, ...]:
    """Return at most a dozen nodes that have pictures, spread over those given, with the key points whose place is known."""
    found = []
    for row in _spread(len(ids), _MOST_NODES):
        picture = _picture(database, ids[row])
        if picture is None:
            continue
        signature = database.read_signature(ids[row])
        known = np.isfinite(signature.points).all(axis=1)
        found.append(
            KeyframeView(
                stamp_ns=int(stamps_ns[row]), picture=picture, places=picture.places(signature.features.pixels[known]),
                num_features=len(signature.features), name=f"node {ids[row]}",
            )
        )  # fmt: skip
    return tuple(found)


def place_views(database: Database, sights: Sights, stamp_of: dict[int, int], first_own: int) -> tuple[PlaceView, ...]:
    """Return both sides of at most six closures, loops before those that were near, and of four that were refused.

    Parameters
    ----------
    stamp_of
        Of every node, nanoseconds.
    first_own
        Id of the first node of this run.
    """
    loops, near = sights.of("loop"), sights.of("near")
    room = _MOST_CLOSURES - min(len(near), _MOST_CLOSURES // 3)
    chosen = _some(loops, max(room, _MOST_CLOSURES - len(near)))
    chosen += _some(near, _MOST_CLOSURES - len(chosen))
    chosen += _some(sights.of("refused"), _MOST_REFUSED)
    found = (_place(database, sight, stamp_of, first_own) for sight in chosen)
    return tuple(place for place in found if place is not None)


def _place(database: Database, sight: Sight, stamp_of: dict[int, int], first_own: int) -> PlaceView | None:
    sides = []
    for node_id, pixels in ((sight.older, sight.pixels_older), (sight.newer, sight.pixels_newer)):
        picture = _picture(database, node_id)
        if picture is None or node_id not in stamp_of:
            return None
        sides.append(
            KeyframeView(
                stamp_ns=stamp_of[node_id], picture=picture, places=picture.places(pixels.astype(np.float64)),
                num_features=len(pixels), name=f"node {node_id}", of_this_run=node_id >= first_own,
            )
        )  # fmt: skip
    return PlaceView(older=sides[0], newer=sides[1], kind=sight.kind, reason=sight.reason)


def _picture(database: Database, node_id: int) -> Picture | None:
    images = database.read_images(node_id)
    return None if images is None else reduced_picture(images.colour)


def _some(sights: list[Sight], most: int) -> list[Sight]:
    return [sights[row] for row in _spread(len(sights), most)]


def _spread(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` rows, first and last among them."""
    if count <= most:
        return list(range(count))
    rows: list[int] = np.rint(np.linspace(0, count - 1, most)).astype(np.int64).tolist()
    return rows
