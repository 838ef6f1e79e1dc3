# SPDX-License-Identifier: MIT
"""Stamps and decodes the messages of one topic."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from slamcli.errors import RecordingError, SlamcliError
from slamcli.measurements import FrameTransform
from slamcli.recordings.adapters import Adapter, DecodeContext, adapter_for
from slamcli.recordings.mends import Mends
from slamcli.recordings.raw import Contents, RawMessage, RawReader, Topic
from slamcli.recordings.stamps import StampCheck, stamp_reader
from slamcli.runtime import RunLog

# What decoding bytes that are not what their type says can raise.
DECODING_ERRORS = (
    SlamcliError,
    ValueError,
    struct.error,
    IndexError,
    KeyError,
    TypeError,
    AttributeError,
    OverflowError,
)


class TopicDecoder:
    """Stamps and decodes the messages of one topic, and keeps book of what was wrong with them."""

    def __init__(self, topic: Topic, raw: RawReader, mends: Mends, log: RunLog) -> None:
        adapter = adapter_for(topic.msgtype)
        if adapter is None:
            raise RecordingError(f"topic {topic.name}: {short_type(topic.msgtype)} is not decoded")
        self._adapter: Adapter = adapter
        self._decode_raw = raw.decode
        self._read_stamp = stamp_reader(adapter.stamp_path, topic.encoding)
        self._context = DecodeContext(topic.name, mends, log)
        self._check = StampCheck()
        self._topic = topic
        self._log = log
        self._channels = channels_of(topic, raw.contents)
        self._num_other = 0
        self._num_garbage = 0
        self._first_garbage = ""
        # Several nodes write to /tf, each in its own order: stamps that interleave there are no fault.
        self._checked = adapter.produces is not FrameTransform

    def accepts(self, message: RawMessage) -> bool:
        """Return whether a message is of the topic's type: two publishers may have used one name for two types."""
        if message.channel in self._channels:
            return True
        self._num_other += 1
        return False

    def stamp_ns(self, message: RawMessage) -> int:
        """Return the header stamp with the topic's offset, or the log time where it is unset."""
        stamp = self._read_stamp(message.data)
        if stamp == 0:
            self._check.num_unset += 1
            stamp = message.log_time_ns
        stamp += self._context.offset_ns
        if self._checked:
            self._check.take(stamp)
        return stamp

    def decode(self, message: RawMessage, stamp_ns: int) -> Sequence[Any]:
        """Return the measurements in a message; what cannot be decoded is counted and left out."""
        try:
            return self._adapter.decode(self._decode_raw(message), stamp_ns, self._context)
        except DECODING_ERRORS as error:
            if not self._num_garbage:
                self._first_garbage = f"{stamp_ns / 1e9:.6f} s: {error}"
            self._num_garbage += 1
            return ()

    def tell(self) -> None:
        """Write what was wrong into the log."""
        check, name, counts = self._check, self._topic.name, self._log.counts

        def count(what: str, number: int) -> None:
            if number:
                counts[f"{name}: {what}"] = max(counts[f"{name}: {what}"], number)

        count("stamps that run backwards", check.num_backward)
        count("stamps that repeat", check.num_duplicate)
        count("messages that cannot be decoded", self._num_garbage)
        count("messages of another type", self._num_other)
        if self._num_other:
            self._log.warn(
                f"{name}: {self._num_other} messages are not {short_type(self._topic.msgtype)} and are left out"
            )
        if check.num_backward:
            self._log.warn(
                f"{name}: {check.num_backward} of {check.num} stamps run backwards, by up to "
                f"{check.largest_backward_ns / 1e9:.3f} s; the recorded order is kept"
            )
        if check.num_unset and self._adapter.stamp_path == "header":
            count("header stamps that are unset", check.num_unset)
            self._log.warn(f"{name}: {check.num_unset} header stamps are unset (0): the log time is used instead")
        if self._num_garbage:
            self._log.warn(
                f"{name}: {self._num_garbage} messages cannot be decoded and are left out, the first at "
                f"{self._first_garbage}"
            )


def channels_of(topic: Topic, contents: Contents) -> frozenset[int]:
    """Return the channels that messages of a topic and of its type carry (-1 where a container tells none)."""
    same = (
        number
        for number, other in enumerate(contents.topics)
        if other.name == topic.name and other.msgtype == topic.msgtype and other.encoding == topic.encoding
    )
    return frozenset((-1, *same))


def short_type(msgtype: str) -> str:
    """Return a message type as people write it: ``sensor_msgs/LaserScan``."""
    return msgtype.replace("/msg/", "/")
