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


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """The links of one place as they were looked at last."""

    source: Sequence[Link]
    length: int
    others: list[int]
    steps: list[int]


class LinkTable:
    """Makes `PlaceLinks`; what did not change since the last time is not looked at again."""

    def __init__(self) -> None:
        self._known: dict[int, _Known] = {}

    def among(
        self,
        ids: Iterable[int],
        links_of: Callable[[int], Sequence[Link]],
        *,
        intermediate: frozenset[int] = frozenset(),
    ) -> PlaceLinks:
        """Return the links among some places.

        Parameters
        ----------
        links_of
            Gives the links of a place, whichever end it is: always the same list, which only grows, or another one. Links found by
            proximity in space do not count (they are too many to tell places from each other), nor do those to what is not
            among `ids`.
        intermediate
            Nodes that are no places of their own: leaving them along the odometry takes no step.
        """
        places = sorted(ids)
        known = {place: self._looked_at(place, links_of(place)) for place in places}
        self._known = known
        table = np.array(places, np.int64)
        counts = np.array([len(one.others) for one in known.values()], np.int64)
        others = np.array([other for one in known.values() for other in one.others], np.int64)
        steps = np.array([step for one in known.values() for step in one.steps], np.int64)
        origins = np.repeat(np.arange(len(table)), counts)
        rows = np.searchsorted(table, others)
        there = table[np.minimum(rows, len(table) - 1)] == others if len(table) else np.zeros(0, np.bool_)
        if intermediate:
            steps = np.where(np.isin(table[origins], list(intermediate)), 0, steps)
        starts = np.concatenate([[0], np.cumsum(np.bincount(origins[there], minlength=len(table)))])
        return PlaceLinks(table, starts.astype(np.int64), rows[there], steps[there])

    def _looked_at(self, place: int, links: Sequence[Link]) -> _Known:
        before = self._known.get(place)
        if before is not None and before.source is links and before.length == len(links):
            return before
        others, steps = [], []
        for link in links:
            if link.from_id != link.to_id and link.kind != _LOCAL_SPACE:
                others.append(link.to_id if link.from_id == place else link.from_id)
                steps.append(1 if link.kind in _STEPS else 0)
        return _Known(links, len(links), others, steps)
