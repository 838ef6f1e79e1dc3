# SPDX-License-Identifier: MIT
"""Rows of the table Link.

RTAB-Map keeps each link between two nodes twice, from either end, with the same information; priors, gravity and landmarks once.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.geometry import se3
from slamcli.rtabmap.database.blobs import pack_pose, unpack_poses
from slamcli.rtabmap.links import Link, LinkKind

_INSERT = "INSERT INTO Link(from_id, to_id, type, information_matrix, transform) VALUES(?,?,?,?,?)"


def insert_links(connection: sqlite3.Connection, links: Iterable[Link]) -> None:
    """Write links; virtual ones, which no sensor measured, are not kept, as in RTAB-Map."""
    rows = []
    for link in links:
        if link.kind == LinkKind.VIRTUAL_CLOSURE:
            continue
        information = np.ascontiguousarray(link.information, dtype="<f8").tobytes()
        rows.append((link.from_id, link.to_id, int(link.kind), information, pack_pose(link.T_from_to)))
        if link.to_id > 0 and link.to_id != link.from_id:
            rows.append((link.to_id, link.from_id, int(link.kind), information, pack_pose(se3.inverse(link.T_from_to))))
    connection.executemany(_INSERT, rows)


def delete_links(connection: sqlite3.Connection, pairs: Iterable[tuple[int, int]]) -> None:
    """Remove all links between pairs of nodes, in both directions."""
    both = [pair for a, b in pairs for pair in ((a, b), (b, a))]
    connection.executemany("DELETE FROM Link WHERE from_id=? AND to_id=?", both)


def read_links(connection: sqlite3.Connection, node_id: int | None = None) -> list[Link]:
    """Return the links in the order they were written, each once; those of one node only, if told.

    Links without a transform (RTAB-Map's null) are left out.
    """
    near = "from_id IN (SELECT to_id FROM Link WHERE from_id=?1) AND to_id=?1"  # by the index, which only from_id has
    where, values = ("", ()) if node_id is None else (f"WHERE from_id=?1 OR ({near})", (node_id,))
    query = f"SELECT from_id, to_id, type, transform, information_matrix FROM Link {where} ORDER BY rowid"  # noqa: S608
    rows = connection.execute(query, values).fetchall()
    poses = unpack_poses([row[3] for row in rows])
    links, seen = [], set()
    for row, T_from_to in zip(rows, poses, strict=True):
        from_id, to_id, kind = int(row[0]), int(row[1]), int(row[2])
        key = (min(from_id, to_id), max(from_id, to_id), kind)
        known = kind in LinkKind._value2member_map_
        if key in seen or not known or not np.isfinite(T_from_to).all():
            continue
        seen.add(key)
        links.append(
            Link(
                from_id=from_id,
                to_id=to_id,
                kind=LinkKind(kind),
                T_from_to=T_from_to,
                information=_information(row[4]),
            )
        )
    return links


def _information(blob: bytes | None) -> NDArray[np.float64]:
    if blob is None or len(blob) != 288:
        raise FormatError(f"a link's information of {len(blob or b'')} bytes: damaged")
    return np.frombuffer(blob, dtype="<f8").reshape(6, 6).copy()
