# SPDX-License-Identifier: MIT
"""Relations files: true relative poses between pairs of times (Kümmerle et al. 2009), read and written without loss.

One relation per line, ``t_i t_j x y z roll pitch yaw``: the pose at t_j seen from the pose at t_i, in seconds, metres and
radians.

References
----------
R. Kümmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27(4), 2009,
doi:10.1007/s10514-009-9155-6.
"""

from __future__ import annotations

import os

import numpy as np

from slamcli.errors import FormatError
from slamcli.evaluation import Relations
from slamcli.formats import text_tables
from slamcli.outputs import atomic_file
from slamcli.runtime import RunLog

_WHAT = "a relations file"


def read_relations(path: str | os.PathLike[str], *, log: RunLog | None = None, unit: str = "auto") -> Relations:
    """Return the relations of a file.

    Parameters
    ----------
    path
        The file.
    log
        Takes a note where stamps are not seconds.
    unit
        Unit of the stamps: ``auto``, ``s``, ``ms``, ``us`` or ``ns``.

    Raises
    ------
    FormatError
        If a line does not have eight finite numbers, or there is none.
    """
    rows = list(text_tables.read_rows(path, _WHAT))
    for row in rows:
        if len(row.fields) != 8:
            count = len(row.fields)
            raise FormatError(
                f"{path}, line {row.line}: {count} column{'' if count == 1 else 's'}, not the 8 of a relation"
                " (t_i t_j x y z roll pitch yaw)"
            )
    if not rows:
        raise FormatError(f"{path}: no relations in it")
    if unit == "auto":
        unit = text_tables.find_time_unit([row.fields[0] for row in rows], path, log)
    lines = [row.line for row in rows]
    first, second = (
        np.array(text_tables.parse_stamps_ns([row.fields[column] for row in rows], lines, path, unit), dtype=np.int64)
        for column in (0, 1)
    )
    values = np.array([text_tables.parse_numbers(row.fields[2:], path, row.line) for row in rows])
    return Relations(first, second, values[:, :3].copy(), values[:, 3:].copy(), source=str(path))


def looks_like_relations(path: str | os.PathLike[str]) -> bool:
    """Return whether a file holds relations: eight columns of which the first two are stamps of one clock.

    A TUM trajectory has eight columns too; its second one is a position in metres. The first two columns of relations
    are times of one recording, so their ranges overlap; the last four columns of a TUM file are of length one.
    """
    first, second, tails = [], [], []
    for row in text_tables.read_rows(path, _WHAT):
        if len(row.fields) != 8:
            return False
        values = text_tables.parse_numbers(row.fields, path, row.line)
        first.append(values[0])
        second.append(values[1])
        tails.append(values[4:])
        if len(first) >= 200:
            break
    if not first:
        return False
    norms = np.linalg.norm(np.clip(tails, -1e9, 1e9), axis=1)
    if np.abs(norms - 1.0).max() < 1e-2:
        return False
    return min(second) <= max(first) and min(first) <= max(second)


def write_relations(path: str | os.PathLike[str], relations: Relations) -> None:
    """Write a relations file: seconds with nine decimals, poses at full precision.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    poses = np.column_stack([relations.translations_m, relations.angles_rad]).tolist()
    stamps = zip(relations.first_ns.tolist(), relations.second_ns.tolist(), strict=True)
    with atomic_file(path) as stream:
        for (first, second), row in zip(stamps, poses, strict=True):
            times = f"{text_tables.format_stamp_s(first)} {text_tables.format_stamp_s(second)}"
            stream.write(f"{times} {' '.join(map(repr, row))}\n")
