# SPDX-License-Identifier: MIT
"""The topics of a recording while its files are being opened."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from slamcli.recordings.raw import Topic

MAX_TOPICS = 100_000


class TopicTable:
    """Numbers topics: the same name, type and definition in several files or connections is one."""

    def __init__(self) -> None:
        self._topics: list[Topic] = []
        self._index: dict[tuple[str, str, str, str], int] = {}
        self.names: list[str] = []
        """Name of each channel, to be read while messages stream."""

    def add(self, topic: Topic) -> int:
        """Return the channel of a topic; the count of a known one is added to it."""
        key = (topic.name, topic.msgtype, topic.encoding, topic.digest or topic.definition)
        channel = self._index.get(key)
        if channel is None:
            channel = self._index[key] = len(self._topics)
            self._topics.append(topic)
            self.names.append(topic.name)
            return channel
        known = self._topics[channel]
        count = None if known.count is None or topic.count is None else known.count + topic.count
        self._topics[channel] = dataclasses.replace(
            known,
            count=count,
            latched=known.latched or topic.latched,
            qos=known.qos or topic.qos,
            publisher=known.publisher if known.publisher == topic.publisher else "",
        )
        return channel

    def topics(self) -> tuple[Topic, ...]:
        """Return all topics, by channel."""
        return tuple(self._topics)

    def channels(self, names: Collection[str] | None) -> frozenset[int] | None:
        """Return the channels of the named topics, None for all."""
        if names is None:
            return None
        wanted = frozenset(names)
        return frozenset(channel for channel, name in enumerate(self.names) if name in wanted)
