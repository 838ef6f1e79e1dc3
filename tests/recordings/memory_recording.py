# SPDX-License-Identifier: MIT
"""A container in memory: what the tests of decoding and merging read and write without any file."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from rosbags.serde import SerdeError

from slamcli.errors import RecordingError
from slamcli.recordings.adapters import message_factory
from slamcli.recordings.mends import Mends
from slamcli.recordings.raw import Contents, RawMessage, Topic
from slamcli.recordings.recording import Recording
from slamcli.recordings.writing import RecordingWriter
from slamcli.runtime import RunLog


class MemoryContainer:
    """Reader and writer at once."""

    def __init__(self, encoding: str = "cdr") -> None:
        self.encoding = encoding
        self.topics: dict[str, Topic] = {}
        self.stored: list[RawMessage] = []

    def add_topic(self, topic: Topic) -> None:
        self.topics[topic.name] = topic

    def write(self, message: RawMessage) -> None:
        self.stored.append(message)

    @property
    def contents(self) -> Contents:
        counts = dict.fromkeys(self.topics, 0)
        for message in self.stored:
            counts[message.topic] += 1
        times = [message.log_time_ns for message in self.stored]
        return Contents(
            paths=(Path("memory.mcap"),),
            format="mcap",
            size_bytes=sum(len(message.data) for message in self.stored),
            topics=tuple(replace(topic, count=counts[name]) for name, topic in self.topics.items()),
            start_ns=min(times, default=None),
            end_ns=max(times, default=None),
            num_messages=len(self.stored),
        )

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        for message in sorted(self.stored, key=lambda m: m.log_time_ns):
            inside = (start_ns is None or message.log_time_ns >= start_ns) and (
                stop_ns is None or message.log_time_ns < stop_ns
            )
            if inside and (topics is None or message.topic in topics):
                yield message

    def decode(self, message: RawMessage) -> Any:
        try:
            return message_factory(self.encoding).deserialise(message.data, self.topics[message.topic].msgtype)
        except SerdeError as error:
            raise RecordingError(str(error)) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def writer(self) -> RecordingWriter:
        return RecordingWriter(self, self.encoding)

    def recording(self, mends: Mends | None = None, log: RunLog | None = None) -> Recording:
        return Recording(self, mends=mends or Mends(), log=log or RunLog())
