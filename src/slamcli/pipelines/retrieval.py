# SPDX-License-Identifier: MIT
"""Which nodes come back from long-term memory, and which are kept from going there.

References
----------
M. Labbé, F. Michaud, IEEE T-RO 29(3), 2013, doi:10.1109/TRO.2013.2242375, section III-F.
M. Labbé, F. Michaud, "Long-term online multi-session graph-based SPLAM with memory management", Autonomous Robots 42, 2018,
doi:10.1007/s10514-017-9682-5, section 3.2.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.map_graph import MapGraph

Floats = NDArray[np.float64]

_ODOMETRY = (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED)


def around(
    graph: MapGraph, node_id: int, depth: int, *, in_time: bool, held: Callable[[int], bool], most_outside: int
) -> list[int]:
    """Return nodes that a few links lead to, a node itself first: by number of links, then the newest first.

    Parameters
    ----------
    depth
        Links to go at most, less one.
    in_time
        Whether only odometry is followed; else closures too.
    held
        Whether a node is in memory.
    most_outside
        Nodes outside of memory that are looked at.
    """
    found: list[int] = []
    seen, level, outside = {node_id}, [node_id], 0
    for _ in range(depth):
        following: list[int] = []
        for node in sorted(level, reverse=True):
            if not held(node):
                if outside >= most_outside:
                    continue
                outside += 1
            found.append(node)
            for link in graph.links_of(node):
                other = link.to_id if link.from_id == node else link.from_id
                if other in graph.nodes and other not in seen and (not in_time or link.kind in _ODOMETRY):
                    seen.add(other)
                    following.append(other)
        level = following
    return found


@dataclass(frozen=True, slots=True)
class LocalNodes:
    """What is around the robot."""

    near: list[int]
    """In working memory and within the radius, the nearest first."""
    immune: list[int]
    """In working memory, not to be transferred: on the way from the nearest one, then the nearest."""
    absent: list[int]
    """Tied to what is near, and not in memory."""


def local_nodes(
    graph: MapGraph, here: int, held: Collection[int], working: Collection[int], *, radius_m: float, most_immune: int,
    most_absent: int,
) -> LocalNodes:  # fmt: skip
    """Return what is around the newest node, as far as links among the nodes in memory lead there.

    Parameters
    ----------
    held
        Nodes in memory; `working`: those of them in working memory.
    radius_m
        `RGBD/LocalRadius`; 0: everything is near.
    """
    local = [node for node in graph.component(here, among=held) if node in held]
    near = nearest_first(here, local, graph.T_map_base, radius_m)
    near_working = [node for node in near if node in working]
    way = shortest_path(graph, near_working[0], here, held) if near_working and most_immune else []
    immune = [node for node in dict.fromkeys([*way, *near]) if node in working][:most_immune]
    absent = outside_beside(graph, [here, *near], held.__contains__, most_absent)
    return LocalNodes(near=near_working, immune=immune, absent=absent)


def nearest_first(
    node_id: int, others: Collection[int], T_map_base: Mapping[int, Floats], radius_m: float
) -> list[int]:
    """Return nodes within a radius (0: any) of a node, the nearest first, of equally near ones the oldest."""
    ids = np.array(sorted(other for other in others if other != node_id), np.int64)
    if not len(ids):
        return []
    places = np.array([T_map_base[other][:3, 3] for other in ids.tolist()])
    distances = np.linalg.norm(places - T_map_base[node_id][:3, 3], axis=1)
    order = np.argsort(distances, kind="stable")
    if radius_m > 0.0:
        order = order[distances[order] < radius_m]
    return [int(node) for node in ids[order]]


def shortest_path(graph: MapGraph, start: int, goal: int, among: Collection[int]) -> list[int]:
    """Return the nodes on the shortest way (metres) along links from one node to another, both included; none if there is no way."""
    waiting: list[tuple[float, int, int]] = [(0.0, start, start)]
    before: dict[int, int] = {}
    while waiting:
        length, node, came_from = heapq.heappop(waiting)
        if node in before:
            continue
        before[node] = came_from
        if node == goal:
            break
        here = graph.T_map_base[node][:3, 3]
        for other in graph.neighbours(node):
            if other in among and other not in before:
                step = float(np.linalg.norm(graph.T_map_base[other][:3, 3] - here))
                heapq.heappush(waiting, (length + step, other, node))
    if goal not in before:
        return []
    path = [goal]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path[::-1]


def outside_beside(graph: MapGraph, near: list[int], held: Callable[[int], bool], most: int) -> list[int]:
    """Return nodes outside of memory that a link ties to one of some nodes, the nearest node's first, of one node's the newest.

    Where those are fewer than `most`, their own neighbours outside of memory follow.
    """
    found: dict[int, None] = {}
    for node in near:
        for other in sorted(graph.neighbours(node), reverse=True):
            if len(found) < most and other in graph.nodes and not held(other):
                found[other] = None
        if len(found) >= most:
            return list(found)
    for node in list(found):
        for other in sorted(graph.neighbours(node), reverse=True):
            if len(found) < most and other in graph.nodes and not held(other):
                found[other] = None
    return list(found)
