# SPDX-License-Identifier: MIT
"""Databases of older versions (0.8 on), shown as if they had the tables of today.

For each table that lacks columns a temporary view of the same name stands before it: columns that came later are NULL, and those that
were kept otherwise are made from what there is. So nothing that reads needs to know which version it reads, but for the bytes of
calibrations and scans.

======== =======================================================================================
before   what was otherwise
======== =======================================================================================
0.18     calibrations and scan_info without their later fields (see there); no env_sensors
0.16     no empty_cells
0.14     no gps
0.13     Map_Node_Word instead of Feature; variances instead of an information matrix; no velocity
0.12     no octaves
0.11.10  no scan_info and no local grids
0.11.2   descriptors of key points only in Word
0.11.1   no ground truth
0.10     Image and Depth instead of Data, with the calibration in columns
0.8.5    no stamps and labels
0.8.4    one variance for a link
======== =======================================================================================
"""

from __future__ import annotations

import re
import sqlite3
from typing import Any

import numpy as np

from slamcli.rtabmap.database.schema import TABLES, Layout, column_names

_OLD_DATA = {
    "id": "Image.id", "image": "Image.data", "depth": "Depth.data", "scan": "Depth.data2d",
    "calibration": "slamcli_calibration(Depth.local_transform, Depth.fx, Depth.fy, Depth.cx, Depth.cy)",
}  # fmt: skip


def show_as_current(connection: sqlite3.Connection, layout: Layout) -> None:
    """Put views before the tables that lack columns."""
    connection.create_function("slamcli_calibration", 5, _calibration, deterministic=True)
    connection.create_function("slamcli_information", 2, _information, deterministic=True)
    for table in TABLES:
        source, known = _source(layout, table)
        if source == table and set(column_names(table)) <= set(known):
            continue
        columns = ", ".join(f"{known.get(name, 'NULL')} AS {name}" for name in column_names(table))
        row = "0" if not source else "Image.rowid" if source.startswith("Image") else "rowid"
        rows = f"FROM {_qualified(source)}" if source else "WHERE 0"
        connection.execute(f"CREATE TEMP VIEW {table} AS SELECT {row} AS rowid, {columns} {rows}")


def _source(layout: Layout, table: str) -> tuple[str, dict[str, str]]:
    """Return which table or tables hold what a table of today holds, and the expression of each column they have."""
    if table in layout.columns:
        known = {name: name for name in layout.columns[table]}
    elif table == "Data" and "Image" in layout.columns:
        return "Image LEFT JOIN Depth ON Depth.id = Image.id", _OLD_DATA
    elif table == "Feature" and "Map_Node_Word" in layout.columns:
        table = "Map_Node_Word"
        known = {name: name for name in layout.columns[table]}
        known.setdefault("octave", "0")
        if "descriptor" not in known:
            known["descriptor_size"] = "(SELECT Word.descriptor_size FROM main.Word WHERE Word.id = word_id)"
            known["descriptor"] = "(SELECT Word.descriptor FROM main.Word WHERE Word.id = word_id)"
    else:
        return "", {}
    if table == "Link" and "information_matrix" not in known:
        one = "variance" in known
        known["information_matrix"] = (
            f"slamcli_information({'variance, variance' if one else 'rot_variance, trans_variance'})"
        )
    return table, known


def _qualified(source: str) -> str:
    return re.sub(r"^(\w+)", r"main.\1", re.sub(r"JOIN (\w+)", r"JOIN main.\1", source))


def _calibration(pose: bytes | None, fx: Any, fy: Any, cx: Any, cy: Any) -> bytes | None:
    """Return the four columns and the pose as 0.10 kept them; an `fy` below 1 is the baseline of a pair."""
    if not fx:
        return None
    numbers = [fx, fx, cx, cy, fy] if fy < 1.0 else [fx, fy, cx, cy]
    placed = pose if pose and len(pose) == 48 else np.eye(3, 4, dtype="<f4").tobytes()
    return np.array(numbers, dtype="<f4").tobytes() + placed


def _information(rotation: Any, translation: Any) -> bytes:
    """Return the inverse of variances, rad^2 and m^2; those of 0 or less tell nothing and count as 1."""
    variances = [value if value and value > 0.0 else 1.0 for value in (translation, rotation)]
    return np.diag([1.0 / variances[0]] * 3 + [1.0 / variances[1]] * 3).astype("<f8").tobytes()
