# SPDX-License-Identifier: MIT
"""Readings of an IMU from EuRoC's table: ``timestamp [ns], w_x, w_y, w_z [rad/s], a_x, a_y, a_z [m/s^2]``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats import text_tables
from slamcli.recordings.containers.damage import Damage
from slamcli.recordings.folders.listings import FIRST_STAMP_NS
from slamcli.recordings.folders.streams import ImuRows

_NUM_COLUMNS = 7


def read_imu_rows(path: Path, topic: str, frame_id: str, damage: Damage) -> ImuRows | None:
    """Return the readings, sorted by stamp; lines that cannot be understood are left out and told. None if there are none."""
    if not path.is_file():
        damage.add(f"{path} is missing: no readings of the IMU")
        return None
    try:
        stamps, values = _fast(path)
    except (OSError, ValueError, OverflowError):
        stamps, values = _line_by_line(path, damage)
    if not len(stamps):
        damage.add(f"{path}: no readings of the IMU in it")
        return None
    backward = int(np.count_nonzero(np.diff(stamps) < 0))
    if backward:
        damage.add(f"{path}: {backward} of {len(stamps)} stamps run backwards; the readings are taken in their order")
        order = np.argsort(stamps, kind="stable")
        stamps, values = stamps[order], values[order]
    return ImuRows(
        topic=topic,
        frame_id=frame_id,
        stamps_ns=np.where(stamps == 0, FIRST_STAMP_NS, stamps),
        angular_rad_s=np.ascontiguousarray(values[:, :3]),
        acceleration_m_s2=np.ascontiguousarray(values[:, 3:]),
    )


def _fast(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return stamps and values of a table without faults (raises ValueError where there is one)."""
    layout = np.dtype([("stamp", np.int64), ("values", np.float64, (6,))])
    with path.open(encoding="utf-8") as stream:
        if not any(line.strip() and not line.startswith("#") for line in stream):
            return np.zeros(0, dtype=np.int64), np.zeros((0, 6))
    table = np.loadtxt(path, dtype=layout, delimiter=",", usecols=range(_NUM_COLUMNS), ndmin=1)
    if not np.isfinite(table["values"]).all() or (table["stamp"] < 10**12).any():
        raise ValueError
    return table["stamp"].copy(), table["values"].copy()


def _line_by_line(path: Path, damage: Damage) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    rows, wrong = [], []
    try:
        for row in text_tables.read_rows(path, "readings of an IMU"):
            if len(row.fields) >= _NUM_COLUMNS:
                rows.append(row)
            else:
                wrong.append(f"line {row.line}: {len(row.fields)} columns, not {_NUM_COLUMNS}")
    except FormatError as error:
        wrong.append(str(error))
    unit = text_tables.find_time_unit([row.fields[0] for row in rows], path)
    stamps: list[int] = []
    values: list[list[float]] = []
    for row in rows:
        try:
            numbers = text_tables.parse_numbers(row.fields[1:_NUM_COLUMNS], path, row.line)
            stamps += text_tables.parse_stamps_ns([row.fields[0]], [row.line], path, unit)
            values.append(numbers)
        except FormatError as error:
            wrong.append(str(error).removeprefix(f"{path}, "))
    if wrong:
        damage.add(f"{path}: {len(wrong)} lines cannot be understood and are left out (first: {wrong[0]})")
    return np.array(stamps, dtype=np.int64), np.array(values, dtype=np.float64).reshape(-1, 6)
