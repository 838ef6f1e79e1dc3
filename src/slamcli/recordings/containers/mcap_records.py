# SPDX-License-Identifier: MIT
"""Records of MCAP files (https://mcap.dev/spec) out of bytes that may be damaged."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from slamcli.recordings.containers.qos import is_latched
from slamcli.recordings.containers.rosbag1_records import ros2_type_name
from slamcli.recordings.containers.runs import Entry
from slamcli.recordings.raw import Topic

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = 1, 2, 3, 4, 5, 6, 7, 8
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 9, 10, 11, 12, 13, 14, 15
PREFIX = struct.Struct("<BQ")
FOOTER_BYTES = PREFIX.size + 20 + len(MAGIC)

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_FIELDS = _MESSAGE.size - PREFIX.size
_CHUNK_FIELDS = struct.Struct("<QQQI")
_MAX_TIME = 2**63 - 1
FIRST_PRIVATE = 0x80
_ENCODINGS = {"ros1msg": ("msg", "ros1"), "ros2msg": ("msg", "cdr"), "ros2idl": ("idl", "cdr")}


class RecordError(Exception):
    """A record is damaged."""


class Fields:
    """Reads a record's fields one after the other; RecordError where one does not fit."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._position = 0

    def number(self, size: int) -> int:
        """Return an unsigned integer of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def take(self, size: int) -> bytes:
        """Return the next `size` bytes."""
        end = self._position + size
        if end > len(self._data):
            raise RecordError("a field is longer than its record")
        part = self._data[self._position : end]
        self._position = end
        return part

    def text(self) -> str:
        """Return a string."""
        return self.take(self.number(4)).decode("utf-8", errors="replace")

    def pairs(self, key: int, value: int) -> list[tuple[int, int]]:
        """Return a map or array of integers of `key` and `value` bytes."""
        inner = Fields(self.take(self.number(4)))
        result = []
        while not inner.done:
            first = inner.number(key)
            result.append((first, inner.number(value)))
        return result

    def texts(self) -> dict[str, str]:
        """Return a map of strings."""
        inner = Fields(self.take(self.number(4)))
        result: dict[str, str] = {}
        while not inner.done:
            name = inner.text()
            result[name] = inner.text()
        return result

    @property
    def done(self) -> bool:
        """Whether everything is read."""
        return self._position >= len(self._data)


class Schema(NamedTuple):
    """A message definition."""

    name: str
    encoding: str
    definition: str


class Channel(NamedTuple):
    """A topic of the file."""

    schema: int
    topic: str
    encoding: str
    metadata: dict[str, str]


class ChunkIndex(NamedTuple):
    """Where a chunk lies and what is in it."""

    start_ns: int
    end_ns: int
    position: int
    size: int
    channels: frozenset[int]
    index_size: int
    compression: str


class ChunkHeader(NamedTuple):
    """What precedes the records of a chunk."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    begin: int
    packed: int


@dataclass(slots=True)
class Catalogue:
    """Schemas and channels by their numbers."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def add(self, op: int, data: bytes) -> None:
        """Take in a schema or channel record; the first of a number counts."""
        fields = Fields(data)
        number = fields.number(2)
        if op == SCHEMA:
            name, encoding = fields.text(), fields.text()
            data = fields.take(fields.number(4))
            # Others than ROS's (protobuf, json) may be binary; they pass through conversions as they are.
            definition = data.decode("utf-8", errors="replace") if encoding in _ENCODINGS else data.decode("latin-1")
            self.schemas.setdefault(number, Schema(name, encoding, definition))
        elif op == CHANNEL:
            schema = fields.number(2)
            self.channels.setdefault(number, Channel(schema, fields.text(), fields.text(), fields.texts()))

    def topic(self, number: int, count: int | None) -> Topic:
        """Return a channel as a topic."""
        channel = self.channels[number]
        schema = self.schemas.get(channel.schema, Schema("", "", ""))
        language, encoding = _ENCODINGS.get(schema.encoding, (schema.encoding, channel.encoding))
        qos = channel.metadata.get("offered_qos_profiles", "")
        return Topic(
            name=channel.topic,
            msgtype=ros2_type_name(schema.name),
            count=count,
            definition=schema.definition,
            encoding=channel.encoding or encoding,
            latched=channel.metadata.get("latching", "") in ("1", "true") or is_latched(qos),
            qos=qos,
            definition_format=language,
            digest=channel.metadata.get("topic_type_hash", "") or channel.metadata.get("md5sum", ""),
            publisher=channel.metadata.get("callerid", ""),
        )


def read_chunk_header(data: bytes, position: int) -> ChunkHeader:
    """Return a chunk's header; `data` begins with the content of its record, which lies at `position`."""
    fields = Fields(data)
    start, end, size, crc = _CHUNK_FIELDS.unpack(fields.take(_CHUNK_FIELDS.size))
    name = fields.text()
    packed = fields.number(8)
    return ChunkHeader(start, end, size, crc, name, position + _CHUNK_FIELDS.size + 4 + len(name.encode()) + 8, packed)


def read_chunk_index(data: bytes) -> ChunkIndex:
    """Return a chunk index record."""
    fields = Fields(data)
    start, end, position, size = (fields.number(8) for _ in range(4))
    channels = frozenset(number for number, _ in fields.pairs(2, 8))
    index_size = fields.number(8)
    return ChunkIndex(start, end, position, size, channels, index_size, fields.text())


class Statistics(NamedTuple):
    """Totals of a file."""

    num_messages: int
    num_channels: int
    num_chunks: int
    start_ns: int
    end_ns: int
    counts: dict[int, int]


def read_statistics(data: bytes) -> Statistics:
    """Return a statistics record."""
    fields = Fields(data)
    num_messages = fields.number(8)
    fields.number(2)
    num_channels = fields.number(4)
    fields.take(8)
    num_chunks, start, end = fields.number(4), fields.number(8), fields.number(8)
    return Statistics(num_messages, num_channels, num_chunks, start, end, dict(fields.pairs(2, 8)))


@dataclass(slots=True)
class Segment:
    """What lies in a stretch of records."""

    entries: list[Entry]
    num_messages: int = 0
    end: int = 0
    """Where reading stopped: the stretch's size unless it is damaged."""
    error: str = ""


def read_segment(data: bytes, channels: Mapping[int, int] | None, catalogue: Catalogue | None = None) -> Segment:
    """List the messages in a stretch of records, up to the first damaged one.

    `channels` gives the channel of each number that is wanted; without it entries hold the file's numbers.
    Schemas and channels on the way are added to `catalogue`.
    """
    segment = Segment([])
    entries = segment.entries
    size, position, skipped = len(data), 0, 0
    while position < size:
        if position + 9 > size:
            segment.error = "a record is cut off"
            break
        op, length = PREFIX.unpack_from(data, position)
        begin = position + 9
        end = begin + length
        if end > size:
            segment.error = "a record is cut off"
            break
        if op == MESSAGE:
            if length < _MESSAGE_FIELDS:
                segment.error = "a message is shorter than its header"
                break
            _, _, number, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, position)
            if log_time > _MAX_TIME:
                segment.error = "a message has an impossible log time"
                break
            channel = number if channels is None else channels.get(number)
            if channel is None:
                skipped += 1
            else:
                entries.append((log_time, channel, begin + _MESSAGE_FIELDS, end, sequence, publish_time))
        elif op in (SCHEMA, CHANNEL) and catalogue is not None:
            try:
                catalogue.add(op, data[begin:end])
            except RecordError as error:
                segment.error = str(error)
                break
        elif op < FIRST_PRIVATE and op not in (SCHEMA, CHANNEL):
            segment.error = f"a record of type {op} lies among the messages"
        position = segment.end = end
    segment.num_messages = len(entries) + skipped
    return segment
