# SPDX-License-Identifier: MIT
"""Places that are seen twice in a row count more, and need not be remembered twice.

References
----------
M. Labbé, F. Michaud, IEEE T-RO 29(3), 2013, doi:10.1109/TRO.2013.2242375, section III-C.
"""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.rtabmap.likelihood import WordBag, similarity
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.map_graph import MapGraph

_NO_CLOSURE = (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED, LinkKind.VIRTUAL_CLOSURE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rehearsal:
    """What follows from how much two nodes in a row look alike."""

    similarity: float
    weights: tuple[int, int] | None = None
    """Of the older and the newer node from now on; None: as they were."""
    merged: bool = False
    """Whether both become one node, which has the weight of the one that stays."""


def rehearse(
    old: WordBag, new: WordBag, weights: tuple[int, int], *, threshold: float, moved: bool, linked: bool, to_new: bool,
    ignored_while_moving: bool,
) -> Rehearsal:  # fmt: skip
    """Return what becomes of a node and the one before it.

    Parameters
    ----------
    weights
        Of both so far, not negative.
    threshold
        `Mem/RehearsalSimilarity`, from which they are alike; 1 and above: never.
    moved
        Whether the robot moved in between: then they are not merged, only the weight goes to one.
    linked
        Whether odometry ties them directly. If not, and the robot stands, the one that loses its weight becomes an intermediate node.
    to_new
        Whether the newer one stays (`Mem/RehearsalIdUpdatedToNewOne`).
    ignored_while_moving
        `Mem/RehearsalWeightIgnoredWhileMoving`.
    """
    alike = similarity(old, new)
    if threshold >= 1.0 or alike < threshold or (moved and ignored_while_moving):
        return Rehearsal(similarity=alike)
    merged = linked and not moved
    gained = weights[0] + weights[1] + 1
    left = 0 if moved or merged else -1
    return Rehearsal(similarity=alike, weights=(left, gained) if to_new else (gained, left), merged=merged)


def reduced_to(node: int, graph: MapGraph) -> int | None:
    """Return the oldest node that a closure ties to a newer one, which need not be kept then (`Mem/ReduceGraph`); None if there is none."""
    tied = [
        other
        for link in graph.links_of(node)
        if link.kind not in _NO_CLOSURE and 0 < (other := link.to_id if link.from_id == node else link.from_id) < node
    ]
    return min(tied, default=None)
