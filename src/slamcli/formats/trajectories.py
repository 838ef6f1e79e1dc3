# SPDX-License-Identifier: MIT
"""Trajectory files: TUM, KITTI and EuRoC, read and written without loss.

======  ======================================================================================================
TUM     ``timestamp tx ty tz qx qy qz qw``, seconds and metres, separated by blanks
KITTI   twelve numbers a line, the upper three rows of ``T_frame_child``; no stamps (a times file may go with it)
EuRoC   ``timestamp,px,py,pz,qw,qx,qy,qz[,...]``, nanoseconds, commas; further columns are left aside
======  ======================================================================================================

Stamps are parsed from their decimal text, never through floating point; numbers are written with as many digits as it
takes to read the same number back.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError, UsageError
from slamcli.formats import text_tables
from slamcli.formats.pbstream.container import is_pbstream
from slamcli.formats.text_tables import Row
from slamcli.geometry import quaternion
from slamcli.outputs import atomic_file
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

PathLike = str | os.PathLike[str]

_TUM_ORDER = (4, 5, 6, 7)
_EUROC_ORDER = (5, 6, 7, 4)
_UNIT_TOLERANCE = 0.01
_EUROC_HEADER = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []"
_FRAME_NS = 1_000_000_000


def read_trajectory(path: PathLike, *, log: RunLog | None = None, unit: str = "auto") -> Trajectory:
    """Return the trajectory of a TUM, KITTI or EuRoC file, or of a saved state; text formats are told by their first line.

    Parameters
    ----------
    path
        The file: eight columns are TUM, twelve KITTI, eight or more separated by commas EuRoC; a ``.pbstream`` with one
        trajectory has the optimised poses of its nodes.
    log
        Takes notes on what was found: units of stamps, orientations that are missing or not of length one.
    unit
        Unit of the stamps: ``auto`` (see `slamcli.formats.text_tables.find_time_unit`), ``s``, ``ms``, ``us``, ``ns``.

    Raises
    ------
    FormatError
        If it is none of these formats, or a line is wrong; the message names file and line.
    UsageError
        If a state has several trajectories.
    """
    if is_pbstream(path):
        from slamcli.formats.pbstream.node_poses import read_node_poses  # brings numba, which text files do not need

        return read_node_poses(path, log=log)
    kind = find_format(path)
    if kind == "kitti":
        return read_kitti(path, log=log)
    reader = read_euroc if kind == "euroc" else read_tum
    return reader(path, log=log, unit=unit)


def find_format(path: PathLike) -> str:
    """Return ``tum``, ``kitti`` or ``euroc`` from the first line of data.

    Raises
    ------
    FormatError
        If the first line of data is in none of these formats, or there is none.
    """
    for row in text_tables.read_rows(path, "a trajectory file"):
        if _is_header(row):
            return "euroc"
        if len(row.fields) == 12 and not row.commas:
            return "kitti"
        if len(row.fields) >= 8 and row.commas:
            return "euroc"
        if len(row.fields) == 8:
            return "tum"
        raise FormatError(
            f"{path}, line {row.line}: {_columns(len(row.fields))}: a TUM trajectory has 8, KITTI has 12,"
            " EuRoC has 8 or more separated by commas"
        )
    raise FormatError(f"{path}: no poses in it")


def read_tum(path: PathLike, *, log: RunLog | None = None, unit: str = "auto") -> Trajectory:
    """Return the trajectory of a TUM file, in the order of its lines.

    Raises
    ------
    FormatError
        If a line does not have eight finite numbers, or there is none.
    """
    rows = []
    for row in text_tables.read_rows(path, "a TUM trajectory"):
        if len(row.fields) != 8:
            raise FormatError(
                f"{path}, line {row.line}: {_columns(len(row.fields))}, not the 8 of a TUM trajectory"
                " (timestamp tx ty tz qx qy qz qw)"
            )
        rows.append(row)
    return _stamped(path, rows, _TUM_ORDER, unit, log)


def read_euroc(path: PathLike, *, log: RunLog | None = None, unit: str = "auto") -> Trajectory:
    """Return the trajectory of an EuRoC CSV file, in the order of its lines.

    A header line says in which order the orientation stands; without one it is w, x, y, z.

    Raises
    ------
    FormatError
        If a line does not have at least eight finite numbers, or there is none.
    """
    rows: list[Row] = []
    order: tuple[int, ...] = _EUROC_ORDER
    for row in text_tables.read_rows(path, "an EuRoC trajectory", comments=True):
        if row.comment or (not rows and _is_header(row)):
            order = order if rows else _order_of_header(row.fields)
            continue
        if len(row.fields) < 8:
            raise FormatError(
                f"{path}, line {row.line}: {_columns(len(row.fields))}, less than the 8 of an EuRoC trajectory"
                " (timestamp,px,py,pz,qw,qx,qy,qz)"
            )
        if rows and len(row.fields) != len(rows[0].fields):
            raise FormatError(
                f"{path}, line {row.line}: {_columns(len(row.fields))}, but line {rows[0].line} has {len(rows[0].fields)}"
            )
        rows.append(row)
    return _stamped(path, rows, order, unit, log)


def read_kitti(path: PathLike, *, times: PathLike | None = None, log: RunLog | None = None) -> Trajectory:
    """Return the trajectory of a KITTI pose file.

    Parameters
    ----------
    path
        The pose file.
    times
        A file with one stamp in seconds per pose. Without it the stamps count frames from 0 and the trajectory's
        `timed` is False.
    log
        Takes notes on units of stamps.

    Raises
    ------
    FormatError
        If a line does not have twelve finite numbers, a matrix is no rotation, or the numbers of lines differ.
    """
    values: list[list[float]] = []
    lines: list[int] = []
    for row in text_tables.read_rows(path, "a KITTI trajectory"):
        if len(row.fields) != 12:
            raise FormatError(f"{path}, line {row.line}: {_columns(len(row.fields))}, not the 12 of a KITTI pose")
        values.append(text_tables.parse_numbers(row.fields, path, row.line))
        lines.append(row.line)
    if not values:
        raise FormatError(f"{path}: no poses in it")
    transforms = np.zeros((len(values), 4, 4))
    transforms[:, :3, :] = np.array(values).reshape(-1, 3, 4)
    transforms[:, 3, 3] = 1.0
    rotations = np.clip(transforms[:, :3, :3], -10.0, 10.0)  # whose squares do not overflow
    deviation = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((deviation > _UNIT_TOLERANCE) | (np.linalg.det(rotations) <= 0))
    if wrong.size:
        raise FormatError(f"{path}, line {lines[wrong[0]]}: the left 3 x 3 numbers are not a rotation")
    stamps = np.arange(len(values), dtype=np.int64) * _FRAME_NS if times is None else read_times(times, log=log)
    if len(stamps) != len(values):
        raise FormatError(f"{times}: {len(stamps)} stamps, but {path} has {len(values)} poses")
    quats = quaternion.from_matrix(rotations)
    return Trajectory(
        stamps, transforms[:, :3, 3].copy(), quats, matrices=transforms, timed=times is not None, source=str(path)
    )


def read_times(path: PathLike, *, log: RunLog | None = None, unit: str = "auto") -> NDArray[np.int64]:
    """Return stamps in nanoseconds, int64 (N,), of a file with one stamp per line.

    Raises
    ------
    FormatError
        If a line does not hold one number.
    """
    rows = list(text_tables.read_rows(path, "a file of time stamps"))
    for row in rows:
        if len(row.fields) != 1:
            raise FormatError(f"{path}, line {row.line}: {_columns(len(row.fields))}, not one stamp")
    return _stamps(path, rows, unit, log)


def write_tum(path: PathLike, trajectory: Trajectory) -> None:
    """Write a TUM file: seconds with nine decimals, then position and orientation at full precision.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    with atomic_file(path) as stream:
        columns = np.column_stack([trajectory.positions_m, trajectory.quats_xyzw]).tolist()
        for stamp, row in zip(trajectory.stamps_ns.tolist(), columns, strict=True):
            stream.write(f"{text_tables.format_stamp_s(stamp)} {' '.join(map(repr, row))}\n")


def write_kitti(path: PathLike, trajectory: Trajectory) -> None:
    """Write a KITTI pose file at full precision; stamps are not kept by this format.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    with atomic_file(path) as stream:
        for row in trajectory.transforms[:, :3, :].reshape(-1, 12).tolist():
            stream.write(" ".join(map(repr, row)) + "\n")


def write_euroc(path: PathLike, trajectory: Trajectory) -> None:
    """Write an EuRoC CSV file: nanoseconds, position and orientation (w first) at full precision.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    with atomic_file(path) as stream:
        stream.write(_EUROC_HEADER + "\n")
        columns = np.column_stack([trajectory.positions_m, trajectory.quats_xyzw[:, [3, 0, 1, 2]]]).tolist()
        for stamp, row in zip(trajectory.stamps_ns.tolist(), columns, strict=True):
            stream.write(f"{stamp},{','.join(map(repr, row))}\n")


WRITERS: dict[str, Callable[[PathLike, Trajectory], None]] = {
    "tum": write_tum,
    "kitti": write_kitti,
    "euroc": write_euroc,
}


def write_trajectory(path: PathLike, trajectory: Trajectory, format: str = "tum") -> None:
    """Write a trajectory in one of the formats ``tum``, ``kitti``, ``euroc``.

    Raises
    ------
    UsageError
        If there is no such format, or the file cannot be written.
    """
    if format not in WRITERS:
        raise UsageError(f"no trajectory format {format!r}: there are {', '.join(WRITERS)}")
    WRITERS[format](path, trajectory)


def _stamped(path: PathLike, rows: Sequence[Row], order: tuple[int, ...], unit: str, log: RunLog | None) -> Trajectory:
    if not rows:
        raise FormatError(f"{path}: no poses in it")
    stamps = _stamps(path, rows, unit, log)
    parsed = (text_tables.parse_numbers(row.fields[1:8], path, row.line) for row in rows)
    values = np.fromiter(chain.from_iterable(parsed), dtype=np.float64, count=7 * len(rows)).reshape(-1, 7)
    quats = _unit_quaternions(path, values[:, [column - 1 for column in order]], log)
    return Trajectory(stamps, values[:, :3].copy(), quats, source=str(path))


def _stamps(path: PathLike, rows: Sequence[Row], unit: str, log: RunLog | None) -> NDArray[np.int64]:
    texts = [row.fields[0] for row in rows]
    if unit == "auto":
        unit = text_tables.find_time_unit(texts, path, log)
    elif unit not in text_tables.TIME_UNITS:
        raise UsageError(f"no time unit {unit!r}: there are {', '.join(text_tables.TIME_UNITS)}")
    return np.array(text_tables.parse_stamps_ns(texts, [row.line for row in rows], path, unit), dtype=np.int64)


def _unit_quaternions(path: PathLike, quats: NDArray[np.float64], log: RunLog | None) -> NDArray[np.float64]:
    """Keep orientations as they are written where they are of length one to the written digits, mend the others."""
    norms = np.linalg.norm(np.clip(quats, -1e9, 1e9), axis=1)
    unset, odd = norms < 1e-9, np.abs(norms - 1.0) > _UNIT_TOLERANCE
    if log is not None and unset.any():
        log.warn(
            f"{path}: {int(unset.sum())} of {len(quats)} orientations are all zero, taken as no rotation:"
            " figures on rotation mean nothing there"
        )
    if log is not None and (odd & ~unset).any():
        log.warn(f"{path}: {int((odd & ~unset).sum())} of {len(quats)} orientations are not of length one, normalised")
    return np.where(odd[:, None], quaternion.normalise(quats), quats)


def _is_header(row: Row) -> bool:
    """Whether a line names columns: its first field starts with a letter (``nan`` and ``inf`` name none)."""
    first = row.fields[0]
    return len(row.fields) >= 8 and first[:1].isalpha() and first.lower() not in {"nan", "inf", "infinity"}


def _order_of_header(names: Sequence[str]) -> tuple[int, ...]:
    """Return the columns of x, y, z, w of the orientation, from names such as ``q_RS_w []`` or ``qx``."""
    found: dict[str, int] = {}
    for column, name in enumerate(names):
        match = re.fullmatch(r"(?:q|quat|orientation|rotation).*?([xyzw])", re.sub(r"\[.*|\s", "", name).lower())
        if match and match[1] not in found:
            found[match[1]] = column
    if len(found) == 4 and all(4 <= column < 8 for column in found.values()):
        return tuple(found[axis] for axis in "xyzw")
    return _EUROC_ORDER


def _columns(count: int) -> str:
    return f"{count} column{'' if count == 1 else 's'}"
