# SPDX-License-Identifier: MIT
"""Files of planning requests: ``start_x,start_y,goal_x,goal_y`` per line."""

from __future__ import annotations

import csv
import math
import os
from pathlib import Path

from slamcli.errors import FormatError

_COLUMNS = ("start_x", "start_y", "goal_x", "goal_y")
_MAX_BYTES = 1 << 28


def read_pairs(path: str | os.PathLike[str]) -> list[tuple[float, float, float, float]]:
    """Return start x, start y, goal x, goal y (metres) of each line.

    A first line of names is optional; with names the columns may stand in any order and among others. Blank lines and
    lines that begin with # are left out.

    Raises
    ------
    FormatError
        If there is no such file, no request in it, or a line is wrong; the message names file and line.
    """
    path = Path(path)
    if not path.is_file():
        raise FormatError(f"{path}: no such file of pairs")
    if path.stat().st_size > _MAX_BYTES:
        raise FormatError(f"{path}: too large for a file of pairs")
    try:
        lines = path.read_bytes().decode("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: not a text file") from error
    pairs: list[tuple[float, float, float, float]] = []
    columns: list[int] | None = None
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        fields = _fields(line, path, number)
        if columns is None:
            columns = _header(fields, path, number)
            if columns is not None:
                continue
            columns = [0, 1, 2, 3]
        pairs.append(_pair(fields, columns, path, number))
    if not pairs:
        raise FormatError(f"{path}: no pairs; write start_x,start_y,goal_x,goal_y per line")
    return pairs


def _fields(line: str, path: Path, number: int) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line]))]
    except (csv.Error, StopIteration) as error:
        raise FormatError(f"{path}:{number}: not a line of CSV") from error


def _header(fields: list[str], path: Path, number: int) -> list[int] | None:
    names = [field.lower() for field in fields]
    if not any(any(c.isalpha() for c in name) and name not in ("nan", "inf", "-inf") for name in names[:4]):
        return None
    if any(_is_number(name) for name in names):
        return None
    missing = [column for column in _COLUMNS if column not in names]
    if missing:
        raise FormatError(f"{path}:{number}: columns are {', '.join(fields)[:80]}; missing: {', '.join(missing)}")
    return [names.index(column) for column in _COLUMNS]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _pair(fields: list[str], columns: list[int], path: Path, number: int) -> tuple[float, float, float, float]:
    try:
        a, b, c, d = (float(fields[column]) for column in columns)
    except (ValueError, IndexError) as error:
        raise FormatError(
            f"{path}:{number}: expected four numbers start_x,start_y,goal_x,goal_y, found {','.join(fields)[:60]!r}"
        ) from error
    if not all(math.isfinite(v) and abs(v) < 1e9 for v in (a, b, c, d)):
        raise FormatError(f"{path}:{number}: a coordinate is not finite")
    return a, b, c, d
