# SPDX-License-Identifier: MIT
"""How far off one node may be seen from another, by the best way through the links between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from slamcli.rtabmap.links import Link, LinkKind

Floats = NDArray[np.float64]

_ARM_M2 = 100.0
"""Squared lever arm by which a variance of heading counts when ways are compared."""
_NO_TIES = (LinkKind.POSE_PRIOR, LinkKind.GRAVITY, LinkKind.LANDMARK)


class WaysFromNode:
    """The best ways from one node to all others (Dijkstra 1959), and what adds up along them.

    Parameters
    ----------
    source : id of the node.
    T_map_base : poses (4, 4) by node id.
    links : of the graph.
    """

    def __init__(
        self, source: int, T_map_base: Mapping[int, Floats], links: Sequence[Link], variances: LinkVariances
    ) -> None:
        self._ids = np.array(sorted(node for node in T_map_base if node > 0), np.int64)
        self._positions = np.array([T_map_base[int(node)][:3, 3] for node in self._ids])
        self._row = {int(node): row for row, node in enumerate(self._ids)}
        first, second, moved, turned = variances.table(links)
        a, b = self._rows(first), self._rows(second)
        known = (a >= 0) & (b >= 0)
        a, b, moved, turned = a[known], b[known], moved[known], turned[known]
        count = len(self._ids)
        cost = moved + _ARM_M2 * turned + 1e-12
        order = np.lexsort(
            (cost, np.maximum(a, b), np.minimum(a, b))
        )  # of several links between two nodes the best counts
        low, high = np.minimum(a, b)[order], np.maximum(a, b)[order]
        best = np.ones(len(order), np.bool_)
        best[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
        keep = order[best]
        self._edges = {(int(x), int(y)): int(k) for x, y, k in zip(low[best], high[best], keep, strict=True)}
        self._moved, self._turned = moved, turned
        graph = coo_matrix((cost[keep], (low[best], high[best])), shape=(count, count)).tocsr()
        self._cost, self._before = dijkstra(graph, directed=False, indices=self._row[source], return_predecessors=True)

    def variances(self, node: int) -> tuple[float, float]:
        """Return variances of the position (m^2) and the heading (rad^2) of a node seen from the source; infinite without a way.

        An error of heading made on the way moves the node sideways by its distance from where it was made.
        """
        row = self._row[node]
        if not np.isfinite(self._cost[row]):
            return float("inf"), float("inf")
        end = self._positions[row]
        moved, turned = 0.0, 0.0
        while self._before[row] >= 0:
            other = int(self._before[row])
            edge = self._edges[min(row, other), max(row, other)]
            arm = float(((end - self._positions[row]) ** 2).sum())
            moved += self._moved[edge] + self._turned[edge] * arm
            turned += self._turned[edge]
            row = other
        return moved, turned

    def _rows(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        places = np.searchsorted(self._ids, ids)
        places = np.minimum(places, len(self._ids) - 1)
        return np.where(self._ids[places] == ids, places, -1).astype(np.int64)


class LinkVariances:
    """Variances of links, told once for each of them: links are many, and never change."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Link, float, float]] = {}

    def table(self, links: Sequence[Link]) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
        """Return ends int64 (N,) each and variances of position and heading, float64 (N,) each, of links that tie two nodes."""
        rows = [self._of(link) for link in links if link.kind not in _NO_TIES]
        return (
            np.array([link.from_id for link, _, _ in rows], np.int64), np.array([link.to_id for link, _, _ in rows], np.int64),
            np.array([moved for _, moved, _ in rows]), np.array([turned for _, _, turned in rows]),
        )  # fmt: skip

    def _of(self, link: Link) -> tuple[Link, float, float]:
        known = self._known.get(id(link))
        if known is not None and known[0] is link:
            return known
        covariance = np.linalg.inv(link.information + 1e-9 * np.eye(6))
        fresh = (link, float(np.linalg.eigvalsh(covariance[:3, :3])[-1]), float(covariance[5, 5]))
        self._known[id(link)] = fresh
        return fresh
