# SPDX-License-Identifier: MIT
"""Packed repeated integers of protobuf (base 128 varints) from and to arrays, all at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import FormatError

_MAX_BYTES = 10  # of one varint
_INT32 = np.iinfo(np.int32)


def unpack(data: bytes, what: str) -> NDArray[np.int64]:
    """Return the numbers, int64 (N,), of a packed field of type int32 or int64.

    Raises
    ------
    FormatError
        If the bytes are no sequence of varints.
    """
    octets = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(octets < 0x80)
    if len(octets) and (not len(ends) or ends[-1] != len(octets) - 1):
        raise FormatError(f"{what}: the packed numbers are cut off")
    if len(ends) == len(octets):
        return octets.astype(np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends - starts + 1
    longest = int(lengths.max())
    if longest > _MAX_BYTES:
        raise FormatError(f"{what}: a packed number is longer than {_MAX_BYTES} bytes")
    values = (octets[starts] & 0x7F).astype(np.uint64)
    for k in range(1, longest):
        longer = np.flatnonzero(lengths > k)
        values[longer] |= (octets[starts[longer] + k] & 0x7F).astype(np.uint64) << np.uint64(7 * k)
    return values.view(np.int64)


def pack(numbers: NDArray[np.integer]) -> bytes:
    """Return numbers (N,) as a packed field of type int32; negative ones take ten bytes, as protobuf has it."""
    return b"".join(pack_parts(numbers, []))


def pack_parts(numbers: NDArray[np.integer], cuts: ArrayLike) -> list[bytes]:
    """Return numbers (N,) as one packed field of type int32 for each part between `cuts`, increasing places from 0 to N."""
    values: NDArray[np.unsignedinteger] = np.asarray(numbers).astype(np.int64).view(np.uint64)
    if len(values) and values.max() < 1 << 28:
        values = values.astype(np.uint32)  # half the time
    lengths = np.ones(len(values), np.int64)
    longest = 1
    while longest < _MAX_BYTES and (longer := values >> values.dtype.type(7 * longest) > 0).any():
        lengths += longer
        longest += 1
    octets = np.empty((len(values), longest), np.uint8)
    for k in range(longest):
        octets[:, k] = (values >> values.dtype.type(7 * k)).astype(np.uint8) & 0x7F
        octets[:, k] |= (lengths > k + 1).astype(np.uint8) << 7
    data = octets[np.arange(longest) < lengths[:, None]].tobytes()
    ends = np.concatenate([[0], np.cumsum(lengths)])[np.asarray(cuts, np.int64)].tolist()
    return [data[i:j] for i, j in zip([0, *ends], [*ends, len(data)], strict=True)]


def unpack_zigzag(data: bytes, what: str) -> NDArray[np.int64]:
    """Return the numbers, int64 (N,), of a packed field of type sint32 (small negative numbers are short).

    Raises
    ------
    FormatError
        If the bytes are no sequence of varints.
    """
    coded = unpack(data, what).view(np.uint64)
    return (coded >> np.uint64(1)).view(np.int64) ^ -(coded & np.uint64(1)).view(np.int64)


def pack_zigzag(numbers: NDArray[np.integer]) -> bytes:
    """Return numbers (N,) as a packed field of type sint32."""
    values = np.asarray(numbers).astype(np.int64)
    return pack((values << 1) ^ (values >> 63))


def unpack_uint16(data: bytes, what: str, most: int) -> NDArray[np.uint16]:
    """Return the numbers, uint16 (N,), of a packed field whose values lie between 0 and `most`.

    Raises
    ------
    FormatError
        If the bytes are no sequence of varints, or a value is out of range.
    """
    values = unpack(data, what)
    if len(values) and not (values.min() >= 0 and values.max() <= most):
        raise FormatError(f"{what}: values from {values.min()} to {values.max()}, not within 0 to {most}")
    return values.astype(np.uint16)


def check_int32(values: NDArray[np.int64], what: str) -> NDArray[np.int32]:
    """Return values as int32.

    Raises
    ------
    FormatError
        If one is out of range.
    """
    if len(values) and not (values.min() >= _INT32.min and values.max() <= _INT32.max):
        raise FormatError(f"{what}: a number is out of the range of int32")
    return values.astype(np.int32)
