# SPDX-License-Identifier: MIT
"""Which nodes of a database are measured once more, and what of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.database import Database
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.signature import NodeImages, NodeScan

_UNUSED = -9
"""Weight of nodes that are not to be used."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredNode:
    """A node as a measurement."""

    id: int
    stamp_ns: int
    T_odom_base: NDArray[np.float64] | None
    """float64 (4, 4); None where it has no odometry."""
    covariance: NDArray[np.float64] | None
    """float64 (6, 6), of the motion since the node before (m^2, rad^2; translation first); None where there is no link to it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredSession:
    """The nodes of one session of a database."""

    path: Path
    map_id: int
    database: Database
    nodes: tuple[StoredNode, ...]
    """By id."""
    images: NodeImages | None
    """Of the first node that has any; later ones must be like them."""
    num_cameras: int
    scan: NodeScan | None
    """Of the first node that has one."""
    landmarks: dict[int, list[Link]] = field(default_factory=dict)
    """Links to landmarks, by node."""
    gravity: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    """float64 (3, 3), rotation of the base in a level frame, by node."""

    @property
    def has_odometry(self) -> bool:
        """Whether any node has an odometry pose."""
        return any(node.T_odom_base is not None for node in self.nodes)


def sessions_of(
    database: Database, *, start_s: float | None = None, duration_s: float | None = None
) -> Iterator[StoredSession]:
    """Yield the sessions of a database that have images or scans, in the order of their first nodes.

    Parameters
    ----------
    start_s, duration_s
        Which part of each session to take, seconds after its first node.

    Raises
    ------
    FormatError
        If it is damaged.
    """
    table = database.nodes()
    links = database.links()
    covariances = _covariances(links)
    landmarks: dict[int, list[Link]] = {}
    for link in links:
        if link.kind == LinkKind.LANDMARK:
            landmarks.setdefault(link.from_id, []).append(link)
    gravity = {link.from_id: link.T_from_to[:3, :3] for link in links if link.kind == LinkKind.GRAVITY}
    for map_id in dict.fromkeys(table.map_ids.tolist()):
        chosen = np.flatnonzero((table.map_ids == map_id) & (table.weights != _UNUSED))
        if not len(chosen):
            continue
        first_ns = int(table.stamps_ns[chosen[0]]) + round((start_s or 0.0) * 1e9)
        last_ns = first_ns + round(duration_s * 1e9) if duration_s is not None else None
        nodes = []
        previous = 0
        for row in chosen.tolist():
            node_id, stamp_ns, T = int(table.ids[row]), int(table.stamps_ns[row]), table.T_odom_base[row]
            if stamp_ns < first_ns or (last_ns is not None and stamp_ns >= last_ns):
                continue
            nodes.append(
                StoredNode(
                    id=node_id, stamp_ns=stamp_ns, T_odom_base=T if np.isfinite(T).all() else None,
                    covariance=covariances.get((previous, node_id)),
                )
            )  # fmt: skip
            previous = node_id
        images = next((i for node in nodes if (i := database.read_images(node.id)) is not None), None)
        scan = next((s for node in nodes if (s := database.read_scan(node.id)) is not None), None)
        if images is None and scan is None:
            continue
        cameras = max((len(database.read_cameras(node.id)) for node in nodes[:1]), default=0)
        yield StoredSession(
            path=database.path, map_id=int(map_id), database=database, nodes=tuple(nodes), images=images,
            num_cameras=cameras, scan=scan, landmarks={n.id: landmarks[n.id] for n in nodes if n.id in landmarks},
            gravity={n.id: gravity[n.id] for n in nodes if n.id in gravity},
        )  # fmt: skip


def _covariances(links: list[Link]) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Return the covariance of the motion between neighbours, by (earlier, later)."""
    found: dict[tuple[int, int], NDArray[np.float64]] = {}
    for link in links:
        if link.kind in (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED) and np.linalg.det(link.information) > 0.0:
            first, last = sorted((link.from_id, link.to_id))
            found[first, last] = np.asarray(np.linalg.inv(link.information), dtype=np.float64)
    return found
