# SPDX-License-Identifier: MIT
"""Cartographer's compressed point clouds: whole millimetres, in blocks of 1.024 m.

A cloud is a list of int32: for each block the number of its points, its x, y and z in blocks, and then one number per
point with ten bits each for x (lowest), y and z in millimetres from the block's corner.

References
----------
Cartographer, ``sensor/compressed_point_cloud``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, FormatError
from slamcli.formats.pbstream import packed

_STEP_M = np.float32(0.001)
_BITS = 10
_MASK = (1 << _BITS) - 1
_FARTHEST = 1 << 23  # millimetres
_HEADER = 4


def decode(num_points: int, data: bytes, what: str) -> NDArray[np.float32]:
    """Return points, float32 (N, 3), metres, in the order of the file.

    Raises
    ------
    FormatError
        If blocks and points do not add up.
    """
    numbers = packed.check_int32(packed.unpack(data, what), what).astype(np.int64)
    starts = _blocks(numbers, what)
    counts = numbers[starts]
    if int(counts.sum()) != num_points:
        raise FormatError(f"{what}: {int(counts.sum())} points in its blocks, but it says {num_points}")
    is_point = np.ones(len(numbers), np.bool_)
    for k in range(_HEADER):
        is_point[starts + k] = False
    points = numbers[is_point]
    corners = np.stack([numbers[starts + 1 + axis] for axis in range(3)], axis=1) << _BITS
    inner = np.stack([points & _MASK, (points >> _BITS) & _MASK, points >> (2 * _BITS)], axis=1)
    steps = np.repeat(corners, counts, axis=0) + inner
    if len(steps) and np.abs(steps).max() > _FARTHEST:
        raise FormatError(f"{what}: a point is farther away than {_FARTHEST / 1000:.0f} m")
    return steps.astype(np.float32) * _STEP_M


def _blocks(numbers: NDArray[np.int64], what: str) -> NDArray[np.int64]:
    """Return where each block begins."""
    starts = []
    at, end, values = 0, len(numbers), numbers.tolist()
    while at < end:
        starts.append(at)
        count = values[at]
        at += _HEADER + count
        if count < 0 or at > end:
            raise FormatError(f"{what}: a block of points is cut off")
    return np.array(starts, np.int64)


def encode(clouds_m: Sequence[NDArray[np.float32]]) -> list[tuple[int, bytes]]:
    """Return the number of points and the packed blocks of each cloud (N, 3), metres, rounded to millimetres.

    Blocks come in the order in which the points first touch them, so what was read is written as it was. All clouds are
    encoded at once: most are small.

    Raises
    ------
    DataError
        If a point is not finite or 8.3 km away or more.
    """
    sizes = np.array([len(cloud) for cloud in clouds_m], np.int64)
    if not sizes.sum():
        return [(0, b"")] * len(clouds_m)
    points = np.concatenate([np.asarray(cloud, np.float64).reshape(-1, 3) for cloud in clouds_m])
    # Divided in double precision: half a millimetre is less than what single precision keeps beyond 4 km.
    steps = points / np.float64(_STEP_M)
    if not (np.abs(steps) < _FARTHEST - 0.5).all():
        raise DataError(
            f"a point of a cloud is not finite or farther away than {_FARTHEST / 1000:.0f} m: it cannot be saved"
        )
    whole = np.where(steps < 0, np.ceil(steps - 0.5), np.floor(steps + 0.5)).astype(np.int64)
    block, inner = whole >> _BITS, whole & _MASK
    codes = (((inner[:, 2] << _BITS) + inner[:, 1]) << _BITS) + inner[:, 0]
    number, first = _blocks_of(block, np.repeat(np.arange(len(sizes)), sizes))
    counts = np.bincount(number, minlength=len(first))
    out = np.empty(len(points) + _HEADER * len(first), np.int64)
    starts = np.cumsum(counts + _HEADER) - counts - _HEADER
    out[starts] = counts
    is_point = np.ones(len(out), np.bool_)
    is_point[starts] = False
    for axis in range(3):
        out[starts + 1 + axis] = block[first, axis]
        is_point[starts + 1 + axis] = False
    out[is_point] = codes[np.argsort(number, kind="stable")]
    before = np.searchsorted(first, np.cumsum(sizes)[:-1])  # blocks of the clouds before each
    cuts = np.cumsum(sizes)[:-1] + _HEADER * before
    return list(zip(sizes.tolist(), packed.pack_parts(out, cuts), strict=True))


def _blocks_of(block: NDArray[np.int64], cloud: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for each point the number of its cloud's block, in the order of their first points, and those points."""
    x, y, z = (block + (_FARTHEST >> _BITS)).T  # 14 bits each
    key = (((((cloud << 14) + x) << 14) + y) << 14) + z
    _, first, which = np.unique(key, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[which], np.sort(first)
