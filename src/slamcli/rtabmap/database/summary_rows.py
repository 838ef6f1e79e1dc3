# SPDX-License-Identifier: MIT
"""Rows of the tables Info, Statistics and Admin."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.database.blobs import (
    INT8,
    INT32,
    pack_matrix,
    pack_pose,
    pack_text,
    unpack_matrix,
    unpack_pose,
    unpack_poses,
    unpack_text,
)
from slamcli.rtabmap.database.node_rows import nanoseconds, seconds
from slamcli.rtabmap.database.records import NodeStatistics, OptimisedPoses, StoredGrid

_MEASURED = ("Timing/", "TimingMem/", "Memory/RAM_", "Memory/Database_memory")


def insert_info(
    connection: sqlite3.Connection, parameters_text: str, *, stm_size: int = 0, last_id: int = 0, num_words: int = 0
) -> None:
    """Write a row of Info: one where a session begins, one where it ends. Memory figures, which differ from run to run, are 0."""
    connection.execute(
        "INSERT INTO Info(STM_size, last_sign_added, process_mem_used, database_mem_used, dictionary_size, parameters) VALUES(?,?,0,0,?,?)",
        (stm_size, last_id, num_words, parameters_text),
    )


def set_entered(connection: sqlite3.Connection, ids: Sequence[int], now: str) -> None:
    """Mark nodes and their words as those that were in working memory last.

    RTAB-Map takes them for that when they entered no earlier than the last Info.
    """
    connection.executemany("UPDATE Node SET time_enter=? WHERE id=?", [(now, int(node)) for node in ids])
    words = "SELECT word_id FROM Feature WHERE node_id=? AND word_id > 0"
    used = sorted({row[0] for node in ids for row in connection.execute(words, (int(node),))})
    connection.executemany("UPDATE Word SET time_enter=? WHERE id=?", [(now, word) for word in used])


def read_last_working(connection: sqlite3.Connection) -> NDArray[np.int64]:
    """Return the ids of nodes that were in working memory when the last session ended."""
    rows = connection.execute(
        "SELECT id FROM Node WHERE time_enter >= (SELECT MAX(time_enter) FROM Info) ORDER BY id"
    ).fetchall()
    return np.array([row[0] for row in rows], dtype=np.int64)


def read_parameters(connection: sqlite3.Connection) -> dict[str, str]:
    """Return native names and values of the last session that told any."""
    row = connection.execute(
        "SELECT parameters FROM Info WHERE length(parameters) > 0 ORDER BY rowid DESC LIMIT 1"
    ).fetchone()
    pairs = [entry.partition(":") for entry in str(row[0]).split(";")] if row else []
    return {name: value for name, colon, value in pairs if colon and "/" in name}


def insert_statistics(
    connection: sqlite3.Connection,
    node_id: int,
    stamp_ns: int,
    values: Mapping[str, float],
    working: Sequence[int] | None,
) -> None:
    """Write the figures of one update, by name; times and memory figures, which differ from run to run, are left out."""
    kept = {name: values[name] for name in sorted(values) if not (name.startswith(_MEASURED) or name.endswith("/ms"))}
    text = ";".join(f"{name}:{_shown(value)}" for name, value in kept.items())
    state = pack_matrix(np.array([list(working)], dtype="<i4"), INT32) if working else None
    row = (node_id, seconds(stamp_ns), pack_text(text), state)
    connection.execute("INSERT OR REPLACE INTO Statistics(id, stamp, data, wm_state) VALUES(?,?,?,?)", row)


def read_statistics(connection: sqlite3.Connection) -> list[NodeStatistics]:
    """Return the figures of all updates, by node."""
    rows = connection.execute("SELECT id, stamp, data FROM Statistics WHERE data IS NOT NULL ORDER BY id").fetchall()
    return [
        NodeStatistics(node_id=int(node), stamp_ns=nanoseconds(stamp), values=_parsed(unpack_text(data)))
        for node, stamp, data in rows
    ]


def set_optimised(
    connection: sqlite3.Connection,
    ids: NDArray[np.int64],
    T_map_base: NDArray[np.float64],
    T_map_last: NDArray[np.float64] | None,
) -> None:
    """Write the optimised graph into Admin."""
    poses = np.ascontiguousarray(T_map_base[:, :3], dtype="<f4").reshape(1, -1)
    row = (
        (pack_matrix(ids.astype("<i4")[None], INT32), pack_matrix(poses), pack_pose(T_map_last))
        if len(ids)
        else (None, None, None)
    )
    connection.execute("UPDATE Admin SET opt_ids=?, opt_poses=?, opt_last_localization=?", row)


def read_optimised(connection: sqlite3.Connection) -> OptimisedPoses | None:
    """Return the optimised graph, or None where there is none."""
    ids, poses, last = connection.execute("SELECT opt_ids, opt_poses, opt_last_localization FROM Admin").fetchone()
    if not ids or not poses:
        return None
    numbers = unpack_matrix(ids).reshape(-1).astype(np.int64)
    upper = unpack_matrix(poses).astype("<f4").reshape(-1, 12)
    count = min(len(numbers), len(upper))
    T_map_base = unpack_poses([row.tobytes() for row in upper[:count]])
    return OptimisedPoses(ids=numbers[:count], T_map_base=T_map_base, T_map_last=unpack_pose(last))


def set_grid(connection: sqlite3.Connection, grid: StoredGrid) -> None:
    """Write the assembled map into Admin."""
    row = (pack_matrix(grid.cells, INT8), grid.x_min_m, grid.y_min_m, grid.resolution_m)
    connection.execute("UPDATE Admin SET opt_map=?, opt_map_x_min=?, opt_map_y_min=?, opt_map_resolution=?", row)


def read_grid(connection: sqlite3.Connection) -> StoredGrid | None:
    """Return the assembled map, or None where there is none."""
    cells, x_min_m, y_min_m, resolution_m = connection.execute(
        "SELECT opt_map, opt_map_x_min, opt_map_y_min, opt_map_resolution FROM Admin"
    ).fetchone()
    if not cells:
        return None
    return StoredGrid(
        cells=unpack_matrix(cells).astype(np.int8),
        x_min_m=float(x_min_m),
        y_min_m=float(y_min_m),
        resolution_m=float(resolution_m),
    )


def _shown(value: float) -> str:
    return f"{value:.9g}" if math.isfinite(value) else "0"


def _parsed(text: str) -> dict[str, float]:
    values = {}
    for entry in text.split(";"):
        name, colon, value = entry.rpartition(":")
        if colon:
            try:
                values[name] = float(value)
            except ValueError:
                continue
    return values
