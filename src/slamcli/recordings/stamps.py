# SPDX-License-Identifier: MIT
"""Header stamps of undecoded messages, and messages of several topics merged by them."""

from __future__ import annotations

import heapq
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from slamcli.recordings.raw import RawMessage

LOOK_AHEAD_S = 1.0
"""Log time that is buffered to put messages of several topics into the order of their header stamps."""

StampReader = Callable[["bytes | memoryview"], int]

_ROS1_STAMP = struct.Struct("<II")
_CDR_LITTLE, _CDR_BIG = struct.Struct("<iI"), struct.Struct(">iI")


def stamp_reader(stamp_path: str, encoding: str) -> StampReader:
    """Return a function from a message's bytes to its header stamp in ns, 0 where it has none or it is unset.

    Parameters
    ----------
    stamp_path
        ``header`` where the message begins with a header, ``first`` where it begins with a list of messages that do,
        ``none`` where it has none.
    encoding
        ``ros1`` or ``cdr``.
    """
    if stamp_path == "none":
        return lambda data: 0  # noqa: ARG005
    # Before the stamp: the CDR encapsulation (4 bytes) or ROS 1's sequence number (4), and the list's length (4).
    offset = 4 if stamp_path == "header" else 8
    ros1 = encoding == "ros1"

    def read(data: bytes | memoryview) -> int:
        if len(data) < offset + 8:
            return 0
        layout = _ROS1_STAMP if ros1 else _CDR_LITTLE if data[1] & 1 else _CDR_BIG
        seconds, nanoseconds = layout.unpack_from(data, offset)
        return int(seconds) * 1_000_000_000 + int(nanoseconds)

    return read


@dataclass(slots=True)
class StampCheck:
    """What is wrong with the stamps of one topic, in recorded order."""

    num: int = 0
    num_backward: int = 0
    num_duplicate: int = 0
    num_unset: int = 0
    largest_backward_ns: int = 0
    first_backward_ns: int | None = None
    """The first stamp that lies before its predecessor."""
    _last_ns: int | None = None

    def take(self, stamp_ns: int) -> None:
        """Look at the next stamp."""
        last = self._last_ns
        if last is not None and stamp_ns <= last:
            if stamp_ns == last:
                self.num_duplicate += 1
            else:
                self.num_backward += 1
                self.largest_backward_ns = max(self.largest_backward_ns, last - stamp_ns)
                if self.first_backward_ns is None:
                    self.first_backward_ns = stamp_ns
        self.num += 1
        self._last_ns = stamp_ns


def merge_by_stamp(
    messages: Iterable[tuple[int, RawMessage]], look_ahead_s: float = LOOK_AHEAD_S
) -> Iterator[tuple[int, RawMessage]]:
    """Yield (stamp, message) of several topics in the order of stamps; the recorded order is kept within a topic.

    `messages` come in log order. A message is held back while the buffer spans less than `look_ahead_s` of log time, so
    memory is bounded whatever the stamps are, and topics are ordered among each other as long as their delays (log time
    minus stamp) differ by less than that.
    """
    look_ahead_ns = round(look_ahead_s * 1e9)
    queues: dict[str, deque[tuple[int, int, RawMessage]]] = {}
    fronts: list[tuple[int, int, str]] = []  # heap of the first message of each queue: stamp, number, topic
    oldest: deque[tuple[int, int]] = deque()  # number and log time of what is buffered, in log order
    done: set[int] = set()

    def pop() -> tuple[int, RawMessage]:
        stamp, number, topic = heapq.heappop(fronts)
        queue = queues[topic]
        _, _, message = queue.popleft()
        if queue:
            heapq.heappush(fronts, (queue[0][0], queue[0][1], topic))
        done.add(number)
        while oldest and oldest[0][0] in done:
            done.discard(oldest.popleft()[0])
        return stamp, message

    for number, (stamp, message) in enumerate(messages):
        queue = queues.setdefault(message.topic, deque())
        queue.append((stamp, number, message))
        if len(queue) == 1:
            heapq.heappush(fronts, (stamp, number, message.topic))
        oldest.append((number, message.log_time_ns))
        while oldest and message.log_time_ns - oldest[0][1] > look_ahead_ns:
            yield pop()
    while fronts:
        yield pop()
