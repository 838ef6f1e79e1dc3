# SPDX-License-Identifier: MIT
"""Poses and times of a ``.pbstream``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, FormatError
from slamcli.geometry import quaternion, se3

_EPOCH_TICKS = 719162 * 24 * 3600 * 10_000_000
"""Cartographer counts 100 ns from the year 1; this many pass until 1970."""
_TICK_NS = 100
_MOST_TICKS = (2**63 - 1) // _TICK_NS
_FARTHEST_M = 1e15
_LENGTH_TOLERANCE = 1e-3
_ROUNDS = 8


def stamp_of(ticks: int, what: str) -> int:
    """Return nanoseconds since 1970 of a time in the file.

    Raises
    ------
    FormatError
        If it is out of the range of 64 bit.
    """
    since = ticks - _EPOCH_TICKS
    if abs(since) > _MOST_TICKS:
        raise FormatError(f"{what}: the time {ticks} is not within 292 years of 1970")
    return since * _TICK_NS


def ticks_of(stamp_ns: int) -> int:
    """Return the time in the file of nanoseconds since 1970, rounded to the next 100 ns."""
    return (int(stamp_ns) + _TICK_NS // 2) // _TICK_NS + _EPOCH_TICKS


def numbers_of(rigid: Any) -> tuple[float, ...]:
    """Return x, y, z, qx, qy, qz, qw of a Rigid3 message."""
    t, r = rigid.translation, rigid.rotation
    return t.x, t.y, t.z, r.x, r.y, r.z, r.w


def check_rotations(quats_xyzw: NDArray[np.float64], what: str) -> NDArray[np.float64]:
    """Return quaternions (N, 4) as they are where they are of length one to the last digits, else normalised.

    Raises
    ------
    FormatError
        If one is not finite or far from length one.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs((quats_xyzw * quats_xyzw).sum(axis=1) - 1.0)
    if not (off < _LENGTH_TOLERANCE).all():
        raise FormatError(f"{what}: an orientation is not a unit quaternion")
    return np.where((off > 1e-12)[:, None], quaternion.normalise(quats_xyzw), quats_xyzw)


def transforms_of(numbers: Sequence[tuple[float, ...]], what: str) -> NDArray[np.float64]:
    """Return transforms (N, 4, 4) of positions and quaternions, seven numbers each.

    The rotation matrices are such that their quaternions give the same matrices again, to the last bit where rounding
    allows it: reading what was written changes nothing.

    Raises
    ------
    FormatError
        If a number is not finite or an orientation not of length one.
    """
    values = np.array(numbers, np.float64).reshape(-1, 7)
    if not (np.abs(values[:, :3]) <= _FARTHEST_M).all():
        raise FormatError(f"{what}: a position is not finite or farther away than {_FARTHEST_M:g} m")
    rotations = quaternion.to_matrix(check_rotations(values[:, 3:], what))
    for _ in range(_ROUNDS):
        again = quaternion.to_matrix(quaternion.from_matrix(rotations))
        if np.array_equal(again, rotations):
            break
        rotations = again
    return se3.from_rotation_translation(rotations, values[:, :3])


def fill(rigid: Any, T: NDArray[np.float64], what: str) -> None:
    """Write a transform (4, 4) into a Rigid3 message.

    Raises
    ------
    DataError
        If it is not finite.
    """
    if not np.isfinite(T).all():
        raise DataError(f"{what}: a pose is not finite; the state cannot be saved")
    position, quat = se3.to_position_quaternion(T)
    fill_numbers(rigid, position, quat)


def fill_numbers(rigid: Any, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]) -> None:
    """Write a position (3,) and a quaternion (4,) into a Rigid3 message."""
    t, r = rigid.translation, rigid.rotation
    t.x, t.y, t.z = position_m.tolist()
    r.x, r.y, r.z, r.w = quat_xyzw.tolist()
