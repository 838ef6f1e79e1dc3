# SPDX-License-Identifier: MIT
"""Which nodes go to long-term memory when working memory is full.

References
----------
M. Labbé, F. Michaud, IEEE T-RO 29(3), 2013, doi:10.1109/TRO.2013.2242375, section III-G.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping


def nodes_to_transfer(
    working: Mapping[int, int],
    weights: Mapping[int, int],
    count: int,
    *,
    kept: Collection[int] = (),
    last_closure: int = 0,
    recent_ratio: float = 0.2,
    by_number: bool = False,
) -> list[int]:
    """Return the nodes that go: the least weight first, of equal weight the one that was used longest ago, then the oldest.

    Parameters
    ----------
    working
        Nodes in working memory, and when each was used last (larger: later).
    weights
        Of the nodes.
    count
        Nodes that should go; fewer do when all others are kept.
    kept
        Nodes that must stay.
    last_closure
        Newest node of the last loop closure, 0 without: it stays, and of the nodes after it so many that they fill `recent_ratio` of
        working memory.
    by_number
        Whether the use does not matter (`Mem/TransferSortingByWeightId`).
    """
    most_recent = int(recent_ratio * len(working))
    recent = sum(node >= last_closure for node in working) if last_closure in working else 0
    immune = 1 < recent < most_recent
    candidates = [
        node for node in working if node not in kept and node != last_closure and not (immune and node > last_closure)
    ]
    candidates.sort(key=lambda node: (weights[node], 0 if by_number else working[node], node))
    gone: list[int] = []
    for node in candidates:
        if len(gone) >= count:
            break
        newer = last_closure > 0 and node > last_closure
        if newer and immune:
            continue
        gone.append(node)
        if newer:
            recent -= 1
            immune = recent < most_recent
    return gone
