# SPDX-License-Identifier: MIT
"""Where an MCAP file can be read on behind damage: the next chunk, or the next message outside of chunks."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from slamcli.recordings.containers import mcap_records as records
from slamcli.recordings.containers.mcap_records import PREFIX
from slamcli.recordings.containers.source import Source

_FIRST_WINDOW, _LARGEST_WINDOW = 64 << 10, 4 << 20
_MARGIN = 64
"""Bytes behind a window that a candidate at its end needs; fewer at the end of a file hold no chunk."""
_MAX_CANDIDATES = 100_000
_COMPRESSIONS = {0: b"", 3: b"lz4", 4: b"zstd"}
_NAME = 37  # where the length of a chunk's compression name stands, from the record's begin
_TIME = PREFIX.size + 6  # where a message's log time stands


def next_record(source: Source, position: int, channels: Collection[int], last_ns: int | None) -> int:
    """Return where the next plausible chunk or message begins, from `position` on; the file's size if there is none.

    A chunk's lengths must agree with each other; a message must be of a known channel, of within about three days of
    `last_ns`, and be followed by a record.
    """
    candidates, window = 0, _FIRST_WINDOW
    while position < source.size and candidates < _MAX_CANDIDATES:
        data = source.read(position, window + _MARGIN)
        for offset in _candidates(np.frombuffer(data, dtype=np.uint8), last_ns).tolist():
            candidates += 1
            begin = position + offset
            if data[offset] == records.CHUNK and _is_chunk(data, offset, source.size - begin):
                return begin
            if data[offset] == records.MESSAGE and _is_message(source, data, offset, begin, channels):
                return begin
            if candidates >= _MAX_CANDIDATES:
                break
        position += window
        window = min(4 * window, _LARGEST_WINDOW)
    return source.size


def _candidates(data: NDArray[np.uint8], last_ns: int | None) -> NDArray[np.int64]:
    """Return offsets, ascending, at which the bytes that are the same in every such record are right."""
    count = len(data) - _MARGIN
    if count <= 0:
        return np.zeros(0, dtype=np.int64)

    def at(offset: int) -> NDArray[np.uint8]:
        return data[offset : offset + count]

    short = (at(6) == 0) & (at(7) == 0) & (at(8) == 0)  # the record has less than 1 TB
    name = at(_NAME)
    chunk = (at(0) == records.CHUNK) & ((name == 0) | (name == 3) | (name == 4))
    chunk &= (at(_NAME + 1) == 0) & (at(_NAME + 2) == 0) & (at(_NAME + 3) == 0)
    found = short & chunk
    if last_ns is not None:
        high, low = (last_ns >> 56) & 0xFF, (last_ns >> 48) & 0xFF
        found |= short & (at(0) == records.MESSAGE) & (at(_TIME + 7) == high) & (at(_TIME + 6) == low)
    return np.flatnonzero(found)


def _is_chunk(data: bytes, offset: int, left: int) -> bool:
    _, length = PREFIX.unpack_from(data, offset)
    name = _COMPRESSIONS[data[offset + _NAME]]
    begin = offset + _NAME + 4
    if data[begin : begin + len(name)] != name:
        return False
    packed = int.from_bytes(data[begin + len(name) : begin + len(name) + 8], "little")
    return bool(length == 40 + len(name) + packed and PREFIX.size + length <= left)


def _is_message(source: Source, data: bytes, offset: int, begin: int, channels: Collection[int]) -> bool:
    _, length = PREFIX.unpack_from(data, offset)
    channel = int.from_bytes(data[offset + PREFIX.size : offset + PREFIX.size + 2], "little")
    end = begin + PREFIX.size + length
    if channel not in channels or length < 22 or end >= source.size:
        return False
    following, at = source.peek(end, PREFIX.size)
    if len(following) - at < PREFIX.size:
        return False
    op, size = PREFIX.unpack_from(following, at)
    return bool(records.HEADER < op <= records.DATA_END and end + PREFIX.size + size <= source.size)
