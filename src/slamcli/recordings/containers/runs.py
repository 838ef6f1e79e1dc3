# SPDX-License-Identifier: MIT
"""Messages in log order out of chunks whose times overlap, with bounded memory.

A run is a part of a file (a chunk, a segment, a table) whose messages can be listed in log order. `merge` begins a run
when the messages before its first one are out, so that neighbours in time are open together and nothing else. Where
many long runs overlap, `Budget` lets go of the buffers of those that wait; they are read again when their turn comes.
"""

from __future__ import annotations

import heapq
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

from slamcli.recordings.raw import RawMessage

BUDGET_BYTES = 256 << 20


class Run(NamedTuple):
    """A part of a container; `stream` lists its messages in log order."""

    start_ns: int
    """Log time of its first message, or any time before that."""
    stream: Callable[[], Iterator[RawMessage]]


Entry = tuple[int, int, int, int, int, int | None]
"""Where one message lies in its chunk: log time, channel, begin, end, sequence, publish time."""


class Budget:
    """The decompressed chunks that are held, at most `limit` bytes of them beside the newest."""

    def __init__(self, limit: int = BUDGET_BYTES) -> None:
        self._limit = limit
        self._held: OrderedDict[Buffer, int] = OrderedDict()
        self._total = 0

    def hold(self, buffer: Buffer, size: int) -> None:
        """Count a buffer that was just read; let go of the oldest ones beyond the limit."""
        self.release(buffer)
        self._held[buffer] = size
        self._total += size
        while self._total > self._limit and len(self._held) > 1:
            oldest = next(iter(self._held))
            self.release(oldest)
            oldest.data = None

    def release(self, buffer: Buffer) -> None:
        """Forget a buffer."""
        self._total -= self._held.pop(buffer, 0)


class Buffer:
    """A chunk's bytes while they are needed; read again if the budget took them."""

    __slots__ = ("_budget", "_read", "data")

    def __init__(self, read: Callable[[], bytes], budget: Budget) -> None:
        self._read = read
        self._budget = budget
        self.data: bytes | None = None

    def load(self) -> bytes:
        """Return the bytes."""
        data = self.data
        if data is None:
            data = self.data = self._read()
            self._budget.hold(self, len(data))
        return data

    def drop(self) -> None:
        """Let go of the bytes."""
        self.data = None
        self._budget.release(self)


def stream_entries(
    buffer: Buffer, entries: Iterable[Entry], names: Sequence[str], start_ns: int | None, stop_ns: int | None
) -> Iterator[RawMessage]:
    """Yield a chunk's messages in log order, stable, within [start_ns, stop_ns)."""
    ordered = sorted(entries, key=lambda entry: entry[0])
    try:
        for time, channel, begin, end, sequence, publish in ordered:
            if start_ns is not None and time < start_ns:
                continue
            if stop_ns is not None and time >= stop_ns:
                return
            data = buffer.data or buffer.load()
            yield RawMessage(names[channel], time, data[begin:end], channel, sequence, publish)
    finally:
        buffer.drop()


def merge(runs: Sequence[Run]) -> Iterator[RawMessage]:
    """Yield the messages of all runs in log order; equal times in the order of `runs`."""
    order = sorted(range(len(runs)), key=lambda index: runs[index].start_ns)
    position = 0
    heap: list[tuple[int, int, RawMessage, Iterator[RawMessage]]] = []
    while heap or position < len(order):
        while position < len(order) and (not heap or runs[order[position]].start_ns <= heap[0][0]):
            index = order[position]
            position += 1
            stream = runs[index].stream()
            first = next(stream, None)
            if first is not None:
                heapq.heappush(heap, (first.log_time_ns, index, first, stream))
        if not heap:
            continue
        _, index, message, stream = heap[0]
        if len(heap) == 1:
            # Alone: no heap needed until the next run begins.
            limit = runs[order[position]].start_ns if position < len(order) else None
            yield message
            for message in stream:
                if limit is not None and message.log_time_ns >= limit:
                    heap[0] = (message.log_time_ns, index, message, stream)
                    break
                yield message
            else:
                heap.clear()
            continue
        yield message
        following = next(stream, None)
        if following is None:
            heapq.heappop(heap)
        else:
            heapq.heapreplace(heap, (following.log_time_ns, index, following, stream))
