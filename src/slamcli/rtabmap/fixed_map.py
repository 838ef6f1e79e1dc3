# SPDX-License-Identifier: MIT
"""Localisation: the nodes of a map that does not change, and the graph of the nodes that find their places in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.graph import LEAST_INFORMATION
from slamcli.rtabmap.links import Link, LinkKind

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartOfGraph:
    """What is optimised."""

    ids: list[int]
    T_map_base: Floats
    """float64 (N, 4, 4)."""
    links: list[Link]


class FixedMap:
    """Nodes and landmarks that keep their poses.

    Parameters
    ----------
    ids
        Their ids; empty: the map is not fixed.
    sigma
        Standard deviation with which they are held, metres and radians (``RGBD/LocalizationPriorError``).
    """

    def __init__(self, ids: Sequence[int], *, sigma: float) -> None:
        self.ids = frozenset(ids)
        self._information = np.eye(6) / sigma**2

    def part(self, ids: Sequence[int], T_map_base: Floats, links: Sequence[Link]) -> PartOfGraph:
        """Return the nodes that may move with those of the map that links tie them to, each held where it is.

        Parameters
        ----------
        ids
            What hangs together, with poses (N, 4, 4) in that order.
        links
            Those between nodes of the map are left out: they are what the poses come from.
        """
        own = {node_id for node_id in ids if node_id not in self.ids}
        used = [
            link for link in links if (link.from_id in own or link.to_id in own) and link.kind != LinkKind.POSE_PRIOR
        ]
        tied = {end for link in used for end in (link.from_id, link.to_id)} | own
        rows = [row for row, node_id in enumerate(ids) if node_id in tied]
        chosen = [ids[row] for row in rows]
        held = [(ids[row], T_map_base[row]) for row in rows if ids[row] in self.ids]
        used += [self._held(node_id, T) for node_id, T in held]
        used += [_hanging_together(a, b) for a, b in pairwise(held)]
        return PartOfGraph(ids=chosen, T_map_base=T_map_base[rows], links=used)

    def _held(self, node_id: int, T: Floats) -> Link:
        return Link(
            from_id=node_id, to_id=node_id, kind=LinkKind.POSE_PRIOR, T_from_to=T, information=self._information
        )


def _hanging_together(a: tuple[int, Floats], b: tuple[int, Floats]) -> Link:
    """Return a link that says next to nothing: what follows links from one node finds all others of the map."""
    return Link(
        from_id=a[0], to_id=b[0], kind=LinkKind.VIRTUAL_CLOSURE, T_from_to=se3.inverse(a[1]) @ b[1],
        information=LEAST_INFORMATION * np.eye(6),
    )  # fmt: skip
