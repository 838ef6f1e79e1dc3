# SPDX-License-Identifier: MIT
"""Writes MCAP files with chunks, indexes and summary, as ``ros2 bag`` and Foxglove open them."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import IO

import lz4.frame
import zstandard

from slamcli import __version__
from slamcli.recordings.containers import mcap_records as records
from slamcli.recordings.containers.mcap_extras import Extra, index_of
from slamcli.recordings.containers.mcap_records import PREFIX
from slamcli.recordings.raw import RawMessage, Topic

CHUNK_BYTES = 1 << 20
COMPRESSIONS = ("none", "lz4", "zstd")

_MESSAGE = struct.Struct("<BQHIQQ")
_INDEX_ENTRY = struct.Struct("<QQ")


class McapFile:
    """An MCAP file being written to `path`; `close` writes its index."""

    def __init__(self, path: Path, compression: str) -> None:
        self._stream: IO[bytes] = path.open("wb")
        self._compression = "" if compression == "none" else compression
        self._position = 0
        self._begun = False
        self._topics: list[Topic] = []
        self._schemas: dict[tuple[str, str], int] = {}
        self._definitions = b""  # schema and channel records, repeated in the summary
        self._pending = b""  # those that are not in a chunk yet
        self._parts: list[bytes] = []
        self._size = 0
        self._index: dict[int, list[tuple[int, int]]] = {}
        self._start = self._end = 0
        self._chunks: list[bytes] = []
        self._extras: list[tuple[int, bytes]] = []  # their index records
        self._counts: Counter[int] = Counter()
        self._times: tuple[int, int] | None = None

    def add_topic(self, topic: Topic) -> int:
        """Declare a topic and return its channel."""
        schema = self._schema(topic)
        self._topics.append(topic)
        channel = len(self._topics)
        body = (
            struct.pack("<HH", channel, schema) + _text(topic.name) + _text(topic.encoding) + _texts(_metadata(topic))
        )
        self._define(records.CHANNEL, body)
        return channel

    def write(self, channel: int, message: RawMessage) -> None:
        """Append a message."""
        time = message.log_time_ns
        if self._pending:
            self._append(self._pending)
            self._pending = b""
        if not self._index:
            self._start = self._end = time
        self._start, self._end = min(self._start, time), max(self._end, time)
        self._index.setdefault(channel, []).append((time, self._size))
        publish = time if message.publish_time_ns is None else message.publish_time_ns
        data = message.data
        self._parts.append(_MESSAGE.pack(records.MESSAGE, 22 + len(data), channel, message.sequence, time, publish))
        self._parts.append(bytes(data) if isinstance(data, memoryview) else data)
        self._size += _MESSAGE.size + len(data)
        self._counts[channel] += 1
        if self._size >= CHUNK_BYTES:
            self._flush_chunk()

    def add_extra(self, extra: Extra) -> None:
        """Write an attachment or metadata record, behind the messages so far."""
        if self._pending:
            self._append(self._pending)
            self._pending = b""
        self._flush_chunk()
        self._begin()
        position = self._position
        self._emit(extra.op, extra.body)
        self._extras.append(index_of(extra, position, self._position - position))

    def close(self) -> None:
        """Write what is left, the summary and the footer, and close the file."""
        if self._pending:
            self._append(self._pending)
        self._flush_chunk()
        self._begin()
        self._emit(records.DATA_END, b"\0\0\0\0")
        self._write_summary()
        self._stream.close()

    def abort(self) -> None:
        """Close the file as it is."""
        self._stream.close()

    def _schema(self, topic: Topic) -> int:
        key = (topic.msgtype, topic.definition)
        if key not in self._schemas:
            number = self._schemas[key] = len(self._schemas) + 1
            name, encoding = topic.msgtype, {"msg": "ros2msg", "idl": "ros2idl"}.get(topic.definition_format)
            if topic.encoding == "ros1":
                name, encoding = name.replace("/msg/", "/"), "ros1msg"
            definition = topic.definition.encode() if encoding else topic.definition.encode("latin-1")
            encoding = encoding or topic.definition_format
            body = struct.pack("<H", number) + _text(name) + _text(encoding) + struct.pack("<I", len(definition))
            self._define(records.SCHEMA, body + definition)
        return self._schemas[key]

    def _define(self, op: int, body: bytes) -> None:
        record = PREFIX.pack(op, len(body)) + body
        self._definitions += record
        self._pending += record

    def _append(self, record: bytes) -> None:
        self._parts.append(record)
        self._size += len(record)

    def _begin(self) -> None:
        """Write the header; its profile is known once the first topics are."""
        if self._begun:
            return
        self._begun = True
        self._put(records.MAGIC)
        encodings = {topic.encoding for topic in self._topics}
        profile = {frozenset({"ros1"}): "ros1", frozenset({"cdr"}): "ros2"}.get(frozenset(encodings), "")
        self._emit(records.HEADER, _text(profile) + _text(f"slamcli {__version__}"))

    def _flush_chunk(self) -> None:
        if not self._size:
            return
        self._begin()
        data = b"".join(self._parts)
        packed = _compress(data, self._compression)
        position = self._position
        head = struct.pack("<QQQI", self._start, self._end, len(data), zlib.crc32(data)) + _text(self._compression)
        self._emit(records.CHUNK, head + struct.pack("<Q", len(packed)), packed)
        length = self._position - position
        offsets: dict[int, int] = {}
        for channel in sorted(self._index):
            offsets[channel] = self._position
            entries = b"".join(_INDEX_ENTRY.pack(*entry) for entry in self._index[channel])
            self._emit(records.MESSAGE_INDEX, struct.pack("<HI", channel, len(entries)) + entries)
        body = struct.pack("<QQQQ", self._start, self._end, position, length)
        body += struct.pack("<I", 10 * len(offsets)) + b"".join(struct.pack("<HQ", *item) for item in offsets.items())
        body += struct.pack("<Q", self._position - position - length) + _text(self._compression)
        self._chunks.append(body + struct.pack("<QQ", len(packed), len(data)))
        if self._index:
            start, end = self._times or (self._start, self._end)
            self._times = (min(start, self._start), max(end, self._end))
        self._parts, self._size, self._index = [], 0, {}
        self._start = self._end = 0

    def _write_summary(self) -> None:
        start = self._position
        schemas, channels = self._split_definitions()
        groups = {
            records.SCHEMA: schemas,
            records.CHANNEL: channels,
            records.STATISTICS: _record(records.STATISTICS, self._statistics()),
            records.CHUNK_INDEX: b"".join(_record(records.CHUNK_INDEX, body) for body in self._chunks),
        }
        for kind in (records.ATTACHMENT_INDEX, records.METADATA_INDEX):
            groups[kind] = b"".join(_record(op, body) for op, body in self._extras if op == kind)
        summary, offsets = b"", b""
        for op, data in groups.items():
            if data:
                offsets += _record(records.SUMMARY_OFFSET, struct.pack("<BQQ", op, start + len(summary), len(data)))
                summary += data
        footer = PREFIX.pack(records.FOOTER, 20) + struct.pack("<QQ", start, start + len(summary))
        summary += offsets
        self._put(summary + footer + struct.pack("<I", zlib.crc32(summary + footer)) + records.MAGIC)

    def _split_definitions(self) -> tuple[bytes, bytes]:
        """Return all schema records and all channel records."""
        by_op: dict[int, list[bytes]] = {records.SCHEMA: [], records.CHANNEL: []}
        position = 0
        while position < len(self._definitions):
            op, length = PREFIX.unpack_from(self._definitions, position)
            end = position + PREFIX.size + length
            by_op[op].append(self._definitions[position:end])
            position = end
        return b"".join(by_op[records.SCHEMA]), b"".join(by_op[records.CHANNEL])

    def _statistics(self) -> bytes:
        start, end = self._times or (0, 0)
        attachments = sum(op == records.ATTACHMENT_INDEX for op, _ in self._extras)
        counts = b"".join(struct.pack("<HQ", *item) for item in sorted(self._counts.items()))
        return (
            struct.pack("<QHI", self._counts.total(), len(self._schemas), len(self._topics))
            + struct.pack(
                "<IIIQQI", attachments, len(self._extras) - attachments, len(self._chunks), start, end, len(counts)
            )
            + counts
        )

    def _emit(self, op: int, *body: bytes) -> None:
        self._put(PREFIX.pack(op, sum(map(len, body))))
        for part in body:
            self._put(part)

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._position += len(data)


def _record(op: int, body: bytes) -> bytes:
    return PREFIX.pack(op, len(body)) + body


def _compress(data: bytes, compression: str) -> bytes:
    if compression == "lz4":
        return bytes(lz4.frame.compress(data))
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=3).compress(data)
    return data


def _text(value: str) -> bytes:
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def _texts(values: dict[str, str]) -> bytes:
    data = b"".join(_text(name) + _text(value) for name, value in values.items())
    return struct.pack("<I", len(data)) + data


def _metadata(topic: Topic) -> dict[str, str]:
    if topic.encoding == "ros1":
        values = {"callerid": topic.publisher, "latching": "1" if topic.latched else "", "md5sum": topic.digest}
    else:
        values = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.digest}
    return {name: value for name, value in values.items() if value or name == "offered_qos_profiles"}
