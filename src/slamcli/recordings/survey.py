# SPDX-License-Identifier: MIT
"""One pass over a recording that notes when each topic's messages were stamped and logged."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.recordings.adapters import Adapter, DecodeContext, adapter_for
from slamcli.recordings.raw import RawMessage, Topic
from slamcli.recordings.recording import Recording
from slamcli.recordings.stamps import stamp_reader
from slamcli.recordings.topic_decoder import DECODING_ERRORS, channels_of

Listener = Callable[[Any, Any], None]
"""What wants to see a topic's messages: called with the message and its first measurement."""


class Watcher(Protocol):
    """What looks at every message of a topic and wants to see some of them decoded."""

    def glance(self, raw: RawMessage, message: Any) -> bool:
        """Look at a message; return whether its measurement is to be seen."""

    def see(self, message: Any, measurement: Any) -> None:
        """See a message and its first measurement."""


@dataclass(slots=True)
class TopicSurvey:
    """What one pass showed of a topic."""

    topic: Topic
    adapter: Adapter | None
    first: Any = None
    """Its first measurement, None where nothing was decoded."""
    num_unset: int = 0
    """Header stamps of 0."""
    num_other: int = 0
    """Messages of another type under the same name."""
    num_garbage: int = 0
    garbage: str = ""
    """Why the first of them could not be decoded."""
    num_bytes: int = 0
    _stamps: array[int] = field(default_factory=lambda: array("q"))
    _log_times: array[int] = field(default_factory=lambda: array("q"))

    @property
    def num(self) -> int:
        """Messages that were seen."""
        return len(self._log_times)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """int64 (N,), header stamps with the topic's offset in recorded order (log times where they are unset)."""
        return np.array(self._stamps, dtype=np.int64)

    @property
    def log_times_ns(self) -> NDArray[np.int64]:
        """int64 (N,), log times in recorded order."""
        return np.array(self._log_times, dtype=np.int64)

    @property
    def has_header(self) -> bool:
        """Whether its messages carry stamps of their own."""
        return self.adapter is not None and self.adapter.stamp_path == "header"

    def see(self, stamp_ns: int, message: RawMessage) -> None:
        """Note a message."""
        self._stamps.append(max(min(stamp_ns, 2**63 - 1), -(2**63)))
        self._log_times.append(message.log_time_ns)
        self.num_bytes += len(message.data)


def survey(
    recording: Recording,
    *,
    topics: Collection[str] | None = None,
    start_ns: int | None = None,
    stop_ns: int | None = None,
    listeners: dict[type, Callable[[Topic], Listener | None]] | None = None,
    watchers: Mapping[type, Callable[[Topic], Watcher]] | None = None,
) -> dict[str, TopicSurvey]:
    """Return what a pass over a recording shows, by topic.

    Parameters
    ----------
    topics
        Only these; None for all.
    start_ns, stop_ns
        Only this part, in log time.
    listeners
        By measurement type: makes a listener for a topic of that type. Every message of such a topic is decoded; of
        other topics only the first one is.
    watchers
        By measurement type, like `listeners`, for topics of which only some messages are worth decoding.
    """
    wanted = [topic for topic in recording.contents.topics if topics is None or topic.name in topics]
    found: dict[str, _Reader] = {}
    for topic in wanted:
        found.setdefault(topic.name, _Reader(topic, recording, listeners or {}, watchers or {}))
    if not found:
        return {}
    for number, message in enumerate(recording.raw.messages(tuple(found), start_ns, stop_ns)):
        found[message.topic].take(message)
        if number % 1000 == 0:
            recording.log.progress.update((message.log_time_ns - recording.start_ns) / 1e9)
    return {name: reader.result for name, reader in found.items()}


class _Reader:
    """Notes and, where someone listens, decodes the messages of one topic."""

    def __init__(
        self,
        topic: Topic,
        recording: Recording,
        listeners: Mapping[type, Callable[[Topic], Listener | None]],
        watchers: Mapping[type, Callable[[Topic], Watcher]],
    ) -> None:
        adapter = adapter_for(topic.msgtype)
        self.result = TopicSurvey(topic, adapter)
        self._raw = recording.raw
        self._context = DecodeContext(topic.name, recording.mends, recording.log)
        self._stamp = stamp_reader(adapter.stamp_path if adapter else "none", topic.encoding)
        make = listeners.get(adapter.produces) if adapter else None
        self._listener = make(topic) if make else None
        watch = watchers.get(adapter.produces) if adapter else None
        self._watcher = watch(topic) if watch else None
        self._channels = channels_of(topic, recording.contents)

    def take(self, message: RawMessage) -> None:
        result = self.result
        if message.channel not in self._channels:
            result.num_other += 1
            return
        stamp = self._stamp(message.data)
        if stamp == 0:
            result.num_unset += 1
            stamp = message.log_time_ns
        stamp += self._context.offset_ns
        result.see(stamp, message)
        idle = self._listener is None and self._watcher is None
        if result.adapter is None or (idle and (result.first is not None or result.num_garbage > 3)):
            return
        try:
            decoded = self._raw.decode(message)
            if self._watcher is not None and not self._watcher.glance(message, decoded):
                return
            measurements = result.adapter.decode(decoded, stamp, self._context)
            if measurements:
                result.first = result.first if result.first is not None else measurements[0]
                for see in (self._listener, None if self._watcher is None else self._watcher.see):
                    if see is not None:
                        see(decoded, measurements[0])
        except DECODING_ERRORS as error:
            result.num_garbage += 1
            result.garbage = result.garbage or str(error)
