# SPDX-License-Identifier: MIT
"""The graph of all sessions: poses of every node, also of those that the memory forgot, and the links between them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.links import Link, LinkKind

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraphNode:
    """A node without what it saw."""

    id: int
    map_id: int
    stamp_ns: int
    T_odom_base: Floats
    """float64 (4, 4)."""


class MapGraph:
    """Nodes by id, in the order of time, and links in the order in which they came.

    Poses are those of the last optimisation; nodes of sessions that no closure joined have poses in a frame of their own.
    """

    def __init__(self) -> None:
        self.nodes: dict[int, GraphNode] = {}
        self.T_map_base: dict[int, Floats] = {}
        self.links: list[Link] = []
        self._linked: dict[int, list[Link]] = {}

    def add_node(self, node: GraphNode, T_map_base: Floats) -> None:
        """Take a node with where it seems to be."""
        self.nodes[node.id] = node
        self.T_map_base[node.id] = T_map_base
        self._linked.setdefault(node.id, [])

    def add_link(self, link: Link) -> None:
        """Take a link; nothing moves by it yet."""
        self.links.append(link)
        for end in {link.from_id, link.to_id}:
            self._linked.setdefault(end, []).append(link)

    def remove_links(self, unwanted: Iterable[Link]) -> None:
        """Forget links."""
        gone = {id(link) for link in unwanted}
        self.links = [link for link in self.links if id(link) not in gone]
        for end, links in self._linked.items():
            self._linked[end] = [link for link in links if id(link) not in gone]

    def merge(self, gone: int, kept: int) -> None:
        """Take a node out of the graph whose place another one holds; its links lead there now (RTAB-Map: neighbour merged)."""
        T_gone_kept = se3.inverse(self.T_map_base[gone]) @ self.T_map_base[kept]
        direct = [link for link in self._linked[gone] if kept in (link.from_id, link.to_id)]
        if direct:
            first = direct[0]
            T_gone_kept = first.T_from_to if first.from_id == gone else se3.inverse(first.T_from_to)
        old = self._linked[gone]
        self.remove_links(old)
        for link in old:
            if kept not in (link.from_id, link.to_id):
                self.add_link(_led_to(link, gone, kept, T_gone_kept))
        del self.nodes[gone], self.T_map_base[gone], self._linked[gone]

    def links_of(self, node_id: int) -> Sequence[Link]:
        """Return the links of a node, whichever end it is, in the order in which they came; none of an unknown node."""
        return self._linked.get(node_id, ())

    def neighbours(self, node_id: int) -> list[int]:
        """Return what is linked to a node, landmarks too, in the order of the links."""
        others = (link.to_id if link.from_id == node_id else link.from_id for link in self._linked.get(node_id, ()))
        return list(dict.fromkeys(other for other in others if other != node_id))

    def are_linked(self, a: int, b: int) -> bool:
        """Return whether a link ties two nodes directly."""
        return any(b in (link.from_id, link.to_id) for link in self._linked.get(a, ()) if a != b)

    def component(self, node_id: int, among: Collection[int] | None = None) -> list[int]:
        """Return the ids, increasing, of all nodes that links tie to a node, itself among them; landmarks (negative) first.

        With `among` no link leads over other nodes; landmarks count as among them.
        """
        found, waiting = {node_id}, [node_id]
        while waiting:
            for other in self.neighbours(waiting.pop()):
                if other not in found and (among is None or other < 0 or other in among):
                    found.add(other)
                    waiting.append(other)
        return sorted(found)

    def links_among(self, ids: Sequence[int]) -> list[Link]:
        """Return the links whose ends are both among some nodes, in their order."""
        wanted = set(ids)
        return [link for link in self.links if link.from_id in wanted and link.to_id in wanted]

    def place(self, ids: Sequence[int], T_map_base: Floats) -> None:
        """Set the poses (N, 4, 4) of some nodes."""
        for row, node_id in enumerate(ids):
            self.T_map_base[node_id] = T_map_base[row]


def _led_to(link: Link, gone: int, kept: int, T_gone_kept: Floats) -> Link:
    """Return a link of a node that is gone as one of the node that holds its place."""
    kind = LinkKind.NEIGHBOR_MERGED if link.kind == LinkKind.NEIGHBOR else link.kind
    if link.from_id == gone:
        return replace(link, from_id=kept, kind=kind, T_from_to=se3.inverse(T_gone_kept) @ link.T_from_to)
    return replace(link, to_id=kept, kind=kind, T_from_to=link.T_from_to @ T_gone_kept)
