# SPDX-License-Identifier: MIT
"""Poses and times of a ``.pbstream``."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
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
_REACHES = (1, 2, 3)
"""Last digits by which each number of a quaternion is tried around the computed one."""
_CANDIDATES = 100_000


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

    Raises
    ------
    FormatError
        If a number is not finite or an orientation not of length one.
    """
    values = np.array(numbers, np.float64).reshape(-1, 7)
    if not (np.abs(values[:, :3]) <= _FARTHEST_M).all():
        raise FormatError(f"{what}: a position is not finite or farther away than {_FARTHEST_M:g} m")
    rotations = quaternion.to_matrix(check_rotations(values[:, 3:], what))
    return se3.from_rotation_translation(rotations, values[:, :3])


def numbers_from(transforms: Iterable[NDArray[np.float64]], what: str) -> list[list[float]]:
    """Return x, y, z, qx, qy, qz, qw of each transform (4, 4).

    Quaternions are chosen, among those that differ from the computed ones in the last digits only, so that they give
    the same rotation matrix again to the last bit: always for rotations about z, and for all but a few in a hundred
    others (which are off by 2e-16 then). Writing and reading a state again changes nothing.

    Raises
    ------
    DataError
        If a transform is not finite.
    """
    T = np.array(list(transforms), np.float64).reshape(-1, 4, 4)
    if not np.isfinite(T).all():
        raise DataError(
            f"{what} {int(np.argmin(np.isfinite(T).all(axis=(1, 2))))} has a pose that is not finite: the state cannot be saved"
        )
    return np.concatenate([T[:, :3, 3], _quaternions_from(T[:, :3, :3])], axis=1).tolist()


def _quaternions_from(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    quats = quaternion.from_matrix(rotations)
    for reach in _REACHES:
        left = np.flatnonzero((quaternion.to_matrix(quats) != rotations).any(axis=(1, 2)))
        tries = range(-reach, reach + 1)
        planar = (0,) if not quats[left, :2].any() else tries
        steps = np.array(list(itertools.product(planar, planar, tries, tries)), np.float64)
        chunk = max(1, _CANDIDATES // len(steps))
        for chosen in (left[i : i + chunk] for i in range(0, len(left), chunk)):
            base = quats[chosen][:, None]
            tried = base + np.spacing(np.abs(base)) * steps
            errors = np.abs(quaternion.to_matrix(tried) - rotations[chosen][:, None]).sum(axis=(2, 3))
            quats[chosen] = tried[np.arange(len(chosen)), errors.argmin(axis=1)]
    return quats


def fill(rigid: Any, numbers: Sequence[float]) -> None:
    """Write x, y, z, qx, qy, qz, qw into a Rigid3 message."""
    t, r = rigid.translation, rigid.rotation
    t.x, t.y, t.z, r.x, r.y, r.z, r.w = numbers
