# SPDX-License-Identifier: MIT
"""How places in memory are tied, as arrays for compiled loops."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.links import Link, LinkKind

Ids = NDArray[np.int64]

_STEPS = (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED)
_LOCAL_SPACE = LinkKind.LOCAL_SPACE_CLOSURE


@dataclass(frozen=True, slots=True, eq=False)
class PlaceLinks:
    """Each link in both directions, sorted by where it leads from."""

    ids: Ids
    """int64 (K,), increasing: the places."""
    starts: Ids
    """int64 (K + 1,): links of place k are those from starts[k] to starts[k + 1]."""
    others: Ids
    """int64 (L,), rows of `ids`."""
    steps: Ids
    """int64 (L,): 1 for odometry; 0 for a closure, which says that both are the same place, and for odometry from an intermediate
    node."""

    def rows(self, ids: Ids) -> Ids:
        """Return the rows of places that are there."""
        return np.searchsorted(self.ids, ids)


def place_links(
    ids: Iterable[int],
    links_of: Callable[[int], Sequence[Link]],
    *,
    intermediate: frozenset[int] = frozenset(),
) -> PlaceLinks:
    """Return the links among some places.

    Parameters
    ----------
    links_of
        Gives the links of a place, whichever end it is. Links found by proximity in space do not count (they are too many to tell
        places from each other), nor do those to what is not among `ids`.
    intermediate
        Nodes that are no places of their own: leaving them along the odometry takes no step.
    """
    places = np.array(sorted(ids), np.int64)
    row_of = {place: row for row, place in enumerate(places.tolist())}
    counts, others, steps = np.zeros(len(places) + 1, np.int64), [], []
    for place, row in row_of.items():
        for link in links_of(place):
            if link.from_id == link.to_id or link.kind == _LOCAL_SPACE:
                continue
            other = row_of.get(link.to_id if link.from_id == place else link.from_id)
            if other is not None:
                counts[row + 1] += 1
                others.append(other)
                steps.append(1 if link.kind in _STEPS and place not in intermediate else 0)
    return PlaceLinks(places, np.cumsum(counts), np.array(others, np.int64), np.array(steps, np.int64))
