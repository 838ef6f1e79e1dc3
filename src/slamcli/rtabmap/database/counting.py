# SPDX-License-Identifier: MIT
"""How much a database holds, counted without reading it all."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """Numbers of rows."""

    with_images: int
    """Nodes, as of the next three."""
    with_second_images: int
    """Depth, or of a right camera."""
    with_scans: int
    with_local_grids: int
    key_points: int
    words: int
    statistics: int
    """Nodes with figures of their update."""
    infos: int
    """Rows of Info: sessions that began or ended."""


def read_counts(connection: sqlite3.Connection) -> Counts:
    """Return the numbers; tables that an older version has not count nothing."""
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}
    data = {row[1] for row in connection.execute("PRAGMA table_info(Data)")}
    columns = [column if column in data else "NULL" for column in ("image", "depth", "scan")]
    # Cells of any kind: a node may have seen obstacles alone.
    cells = [f"length({name}) > 0" for name in ("ground_cells", "obstacle_cells", "empty_cells") if name in data]
    sums = [*(f"SUM(length({column}) > 0)" for column in columns), f"SUM({' OR '.join(cells) or 'NULL'})"]
    found = connection.execute(f"SELECT {', '.join(sums)} FROM Data").fetchone()  # noqa: S608
    images, second, scans, grids = (int(value or 0) for value in found)

    def rows(table: str) -> int:
        if table not in tables:
            return 0
        return int(connection.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0])  # noqa: S608

    return Counts(
        with_images=images, with_second_images=second, with_scans=scans, with_local_grids=grids,
        key_points=rows("Feature") or rows("Map_Node_Word"), words=rows("Word"), statistics=rows("Statistics"),
        infos=rows("Info"),
    )  # fmt: skip
