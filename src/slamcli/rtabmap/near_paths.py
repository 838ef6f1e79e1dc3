# SPDX-License-Identifier: MIT
"""Where the robot came by before: paths through nodes near it (Labbé and Michaud, JFR 2019, section 3.3.3, proximity)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.parameters import RgbdGroup

Floats = NDArray[np.float64]
ALONG = (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED)


def near_paths(
    node_id: int, T_map_base: Mapping[int, Floats], links: Sequence[Link], settings: RgbdGroup,
    *, among: Collection[int] | None = None, last_closure: int = 0,
) -> list[list[int]]:  # fmt: skip
    """Return the paths that pass near a node, the one whose nearest node is newest first; each by increasing ids.

    A path is a set of nodes near by that odometry ties together. All are returned: callers stop after they compared
    ``RGBD/ProximityMaxPaths`` of them.

    Parameters
    ----------
    node_id
        Where the robot is.
    T_map_base
        float64 (4, 4) by id, as optimised.
    links
        Of the graph.
    settings
        ``LocalRadius`` (m) and ``ProximityMaxGraphDepth`` (links from the node or the last closure, closures being links too;
        0: any).
    among
        Nodes that may be on paths: those of working memory, without short-term memory. None: all.
    last_closure
        Node that the robot was last found at; 0: none.
    """
    allowed = T_map_base.keys() if among is None else among
    ids = np.array(sorted(i for i in allowed if i > 0 and i != node_id and i in T_map_base), np.int64)
    if not len(ids):
        return []
    places = np.array([T_map_base[i][:3, 3] for i in ids.tolist()])
    distances = np.linalg.norm(places - T_map_base[node_id][:3, 3], axis=1)
    near = {i: d for i, d in zip(ids.tolist(), distances.tolist(), strict=True) if d <= settings.local_radius}
    if settings.proximity_max_graph_depth > 0:
        reached = _within(links, {node_id, last_closure} - {0}, settings.proximity_max_graph_depth)
        near = {i: d for i, d in near.items() if i in reached}
    paths = _chains(near, links)
    return sorted(paths, key=lambda path: -min(path, key=lambda i: (near[i], -i)))


def nearest_on_path(
    path: Sequence[int], node_id: int, T_map_base: Mapping[int, Floats], settings: RgbdGroup
) -> int | None:
    """Return the node of a path that is nearest and looks the same way, None if there is none within the filtering radius.

    ``RGBD/ProximityAngle`` bounds the angle between both poses, ``RGBD/ProximityPathFilteringRadius`` their distance (0: any).
    """
    poses = np.array([T_map_base[i] for i in path])
    here = T_map_base[node_id]
    cosines = (np.einsum("nij,ij->n", poses[:, :3, :3], here[:3, :3]) - 1.0) / 2.0
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    distances = np.linalg.norm(poses[:, :3, 3] - here[:3, 3], axis=1)
    distances[angles > settings.proximity_angle] = np.inf
    row = int(np.lexsort((-np.asarray(path), distances))[0])
    limit = settings.proximity_path_filtering_radius or np.inf
    return path[row] if distances[row] <= limit and np.isfinite(distances[row]) else None


def _within(links: Sequence[Link], sources: Collection[int], depth: int) -> set[int]:
    """Return the nodes at most so many links from any of the sources."""
    linked: dict[int, list[int]] = {}
    for link in links:
        if link.from_id > 0 and link.to_id > 0:
            linked.setdefault(link.from_id, []).append(link.to_id)
            linked.setdefault(link.to_id, []).append(link.from_id)
    reached, front = set(sources), set(sources)
    for _ in range(depth):
        front = {other for node in front for other in linked.get(node, ())} - reached
        if not front:
            break
        reached |= front
    return reached


def _chains(near: Collection[int], links: Sequence[Link]) -> list[list[int]]:
    """Return the nodes in sets that odometry ties together."""
    root = {i: i for i in near}

    def find(i: int) -> int:
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        return i

    for link in links:
        if link.kind in ALONG and link.from_id in root and link.to_id in root:
            root[find(link.from_id)] = find(link.to_id)
    chains: dict[int, list[int]] = {}
    for i in sorted(near):
        chains.setdefault(find(i), []).append(i)
    return list(chains.values())
