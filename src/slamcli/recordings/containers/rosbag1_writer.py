# SPDX-License-Identifier: MIT
"""Writes ROS 1 bags, format 2.0."""

from __future__ import annotations

import bz2
import struct
from pathlib import Path
from typing import IO

import lz4.frame

from slamcli.errors import RecordingError
from slamcli.recordings.containers import rosbag1_records as records
from slamcli.recordings.raw import RawMessage, Topic

CHUNK_BYTES = 768 << 10
COMPRESSIONS = ("none", "bz2", "lz4")

_HEADER_BYTES = 4096
_MESSAGE = struct.Struct("<II5sII4sI5sIII")
_INDEX_ENTRY = struct.Struct("<III")
_MAX_SECONDS = 2**32


class Rosbag1File:
    """A ``.bag`` file being written to `path`; `close` writes its index."""

    def __init__(self, path: Path, compression: str) -> None:
        self._stream: IO[bytes] = path.open("w+b")
        self._compression = compression
        self._connections: list[bytes] = []
        self._infos: list[bytes] = []
        self._parts: list[bytes] = []
        self._size = 0
        self._index: dict[int, list[tuple[int, int, int]]] = {}
        self._stream.write(records.MAGIC + _bag_header(0, 0, 0))
        self._position = self._stream.tell()

    def add_topic(self, topic: Topic) -> int:
        """Declare a topic and return its connection number."""
        if topic.encoding != "ros1":
            raise RecordingError(f"topic {topic.name}: a ROS 1 bag holds ros1 messages, not {topic.encoding!r}")
        number = len(self._connections)
        name = topic.name.encode()
        fields = {
            b"topic": name,
            b"type": topic.msgtype.replace("/msg/", "/").encode(),
            b"md5sum": topic.digest.encode(),
            b"message_definition": topic.definition.encode(),
        }
        if topic.publisher:
            fields[b"callerid"] = topic.publisher.encode()
        if topic.latched:
            fields[b"latching"] = b"1"
        head = {b"conn": struct.pack("<I", number), b"topic": name}
        record = _record(records.OP_CONNECTION, head, _fields(fields))
        self._connections.append(record)
        self._parts.append(record)
        self._size += len(record)
        return number

    def write(self, connection: int, message: RawMessage) -> None:
        """Append a message."""
        seconds, nanoseconds = divmod(message.log_time_ns, 1_000_000_000)
        if not 0 <= seconds < _MAX_SECONDS:
            raise RecordingError(f"topic {message.topic}: log time {message.log_time_ns} ns does not fit a ROS 1 bag")
        data = message.data
        self._index.setdefault(connection, []).append((seconds, nanoseconds, self._size))
        head = _MESSAGE.pack(38, 9, b"conn=", connection, 4, b"op=\x02", 13, b"time=", seconds, nanoseconds, len(data))
        self._parts.append(head)
        self._parts.append(bytes(data) if isinstance(data, memoryview) else data)
        self._size += len(head) + len(data)
        if self._size >= CHUNK_BYTES:
            self._flush_chunk()

    def close(self) -> None:
        """Write what is left and the index, and close the file."""
        self._flush_chunk()
        index = self._position
        for record in (*self._connections, *self._infos):
            self._put(record)
        self._stream.seek(len(records.MAGIC))
        self._stream.write(_bag_header(index, len(self._connections), len(self._infos)))
        self._stream.close()

    def abort(self) -> None:
        """Close the file as it is."""
        self._stream.close()

    def _flush_chunk(self) -> None:
        if not self._size:
            return
        data = b"".join(self._parts)
        position = self._position
        fields = {b"compression": self._compression.encode(), b"size": struct.pack("<I", len(data))}
        self._put(_record(records.OP_CHUNK, fields, _compress(data, self._compression)))
        for connection, entries in self._index.items():
            fields = {
                b"conn": struct.pack("<I", connection),
                b"count": struct.pack("<I", len(entries)),
                b"ver": struct.pack("<I", 1),
            }
            self._put(_record(records.OP_INDEX, fields, b"".join(_INDEX_ENTRY.pack(*entry) for entry in entries)))
        if self._index:
            times = [entry[:2] for entries in self._index.values() for entry in entries]
            fields = {
                b"chunk_pos": struct.pack("<Q", position),
                b"count": struct.pack("<I", len(self._index)),
                b"end_time": struct.pack("<II", *max(times)),
                b"start_time": struct.pack("<II", *min(times)),
                b"ver": struct.pack("<I", 1),
            }
            counts = b"".join(struct.pack("<II", number, len(entries)) for number, entries in self._index.items())
            self._infos.append(_record(records.OP_CHUNK_INFO, fields, counts))
        self._parts, self._size, self._index = [], 0, {}

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._position += len(data)


def _fields(values: dict[bytes, bytes]) -> bytes:
    return b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value for name, value in values.items()
    )


def _record(op: int, values: dict[bytes, bytes], data: bytes) -> bytes:
    header = _fields(dict(sorted({**values, b"op": bytes([op])}.items())))
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def _bag_header(index: int, connections: int, chunks: int) -> bytes:
    fields = {
        b"chunk_count": struct.pack("<I", chunks),
        b"conn_count": struct.pack("<I", connections),
        b"index_pos": struct.pack("<Q", index),
    }
    padding = _HEADER_BYTES - len(_record(records.OP_BAG_HEADER, fields, b""))
    return _record(records.OP_BAG_HEADER, fields, b" " * padding)


def _compress(data: bytes, compression: str) -> bytes:
    if compression == "bz2":
        return bz2.compress(data)
    if compression == "lz4":
        return bytes(lz4.frame.compress(data))
    return data
