# SPDX-License-Identifier: MIT
"""Records of ROS 1 bags, format 2.0 (http://wiki.ros.org/Bags/Format/2.0), out of bytes that may be damaged."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from slamcli.recordings.containers.runs import Entry
from slamcli.recordings.raw import Topic

MAGIC = b"#ROSBAG V2.0\n"
OP_MESSAGE, OP_BAG_HEADER, OP_INDEX, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION = 2, 3, 4, 5, 6, 7
MAX_HEADER_BYTES = 64 << 10

_U32 = struct.Struct("<I")
_U64 = struct.Struct("<Q")
_TIME = struct.Struct("<II")
# The two orders in which writers lay out the 38 byte header of a message: roscpp and rospy sort the fields by name,
# rosbags puts op first. Everything else takes the general way.
_BY_NAME = struct.Struct("<II5sII3sBI5sIII")
_OP_FIRST = struct.Struct("<II3sBI5sII5sIII")
_MESSAGE_HEADER = 38
_PREFIX = 46  # header length, header, data length


class RecordError(Exception):
    """A record is damaged."""


class Record(NamedTuple):
    """One record: its header's fields and where its data lies."""

    fields: dict[bytes, bytes]
    op: int
    begin: int
    size: int


def read_fields(buffer: bytes, position: int, end: int) -> dict[bytes, bytes]:
    """Return the fields of a header that lies at [position, end).

    Raises
    ------
    RecordError
        If a field does not fit into the header or has no name.
    """
    fields: dict[bytes, bytes] = {}
    while position < end:
        if position + 4 > end:
            raise RecordError("a header field is cut off")
        (size,) = _U32.unpack_from(buffer, position)
        position += 4
        if size > end - position:
            raise RecordError("a header field is longer than its header")
        name, equals, value = buffer[position : position + size].partition(b"=")
        if not equals:
            raise RecordError("a header field has no name")
        fields[name] = value
        position += size
    return fields


def read_record(buffer: bytes, position: int, end: int) -> Record:
    """Return the record at `position`; its data may reach beyond `end`.

    Raises
    ------
    RecordError
        If the header is damaged or cut off.
    """
    if position + 4 > end:
        raise RecordError("a record is cut off")
    (header_size,) = _U32.unpack_from(buffer, position)
    begin = position + 4 + header_size
    if header_size > MAX_HEADER_BYTES or begin + 4 > end:
        raise RecordError("a record's header is cut off")
    fields = read_fields(buffer, position + 4, begin)
    op = fields.get(b"op", b"")
    if len(op) != 1:
        raise RecordError("a record has no type")
    return Record(fields, op[0], begin + 4, _U32.unpack_from(buffer, begin)[0])


def number(fields: dict[bytes, bytes], name: bytes, size: int = 4) -> int:
    """Return an unsigned field of 4 or 8 bytes."""
    value = fields.get(name, b"")
    if len(value) != size:
        raise RecordError(f"field {name.decode()!r} is missing or has {len(value)} bytes")
    return int.from_bytes(value, "little")


def stamp(fields: dict[bytes, bytes], name: bytes) -> int:
    """Return a time field in nanoseconds."""
    value = fields.get(name, b"")
    if len(value) != 8:
        raise RecordError(f"field {name.decode()!r} is missing or has {len(value)} bytes")
    seconds, nanoseconds = _TIME.unpack(value)
    return int(seconds) * 10**9 + int(nanoseconds)


def text(fields: dict[bytes, bytes], name: bytes) -> str:
    """Return a text field; empty where it is missing."""
    return fields.get(name, b"").decode("utf-8", errors="replace")


def read_connection(record: Record, buffer: bytes) -> tuple[int, Topic]:
    """Return the number and the topic of a connection record whose data lies in `buffer`."""
    fields = read_fields(buffer, record.begin, record.begin + record.size)
    msgtype = text(fields, b"type")
    if not msgtype or not (name := text(record.fields, b"topic") or text(fields, b"topic")):
        raise RecordError("a connection has no topic or no type")
    return number(record.fields, b"conn"), Topic(
        name=name,
        msgtype=ros2_type_name(msgtype),
        count=0,
        # The header's type moved in 2011; its fields and the sums of types that hold it stayed.
        definition=text(fields, b"message_definition").replace("MSG: roslib/Header", "MSG: std_msgs/Header"),
        encoding="ros1",
        latched=text(fields, b"latching") == "1",
        digest=text(fields, b"md5sum"),
        publisher=text(fields, b"callerid"),
    )


def ros2_type_name(msgtype: str) -> str:
    """Return ``sensor_msgs/msg/LaserScan`` for ``sensor_msgs/LaserScan``."""
    package, slash, name = msgtype.partition("/")
    return f"{package}/msg/{name}" if slash and "/" not in name else msgtype


@dataclass(slots=True)
class ChunkContents:
    """What lies in a decompressed chunk."""

    entries: list[Entry]
    connections: dict[int, Topic]
    end: int
    """Where reading stopped: the chunk's size unless it is damaged."""
    num_messages: int
    """All messages found, also of connections that were not asked for."""
    error: str = ""


def read_chunk(data: bytes, channels: Mapping[int, int] | None = None) -> ChunkContents:
    """List the messages and connections of a decompressed chunk, up to the first damaged record.

    `channels` gives the channel of each connection that is wanted; without it entries hold the connection's number.
    """
    contents = ChunkContents([], {}, 0, 0)
    entries = contents.entries
    skipped = 0
    size, position = len(data), 0
    layout, by_name = _BY_NAME, True
    while position < size:
        if position + _PREFIX <= size:
            values = layout.unpack_from(data, position)
            if by_name:
                header, _, key_a, connection, _, key_b, op, _, key_c, seconds, nanoseconds, length = values
                fits = key_a == b"conn=" and key_b == b"op=" and key_c == b"time="
            else:
                header, _, key_a, op, _, key_b, connection, _, key_c, seconds, nanoseconds, length = values
                fits = key_a == b"op=" and key_b == b"conn=" and key_c == b"time="
            if fits and header == _MESSAGE_HEADER and op == OP_MESSAGE:
                begin = position + _PREFIX
                position = begin + length
                if position > size:
                    contents.error = "a message is cut off"
                    break
                channel = connection if channels is None else channels.get(connection)
                if channel is None:
                    skipped += 1
                else:
                    entries.append((seconds * 1_000_000_000 + nanoseconds, channel, begin, position, 0, None))
                contents.end = position
                continue
        try:
            record = read_record(data, position, size)
            end = record.begin + record.size
            if end > size:
                raise RecordError("a record is cut off")  # noqa: TRY301
            if record.op == OP_MESSAGE:
                time, connection = stamp(record.fields, b"time"), number(record.fields, b"conn")
                channel = connection if channels is None else channels.get(connection)
                if channel is None:
                    skipped += 1
                else:
                    entries.append((time, channel, record.begin, end, 0, None))
                layout, by_name = (_OP_FIRST, False) if by_name else (_BY_NAME, True)
            elif record.op == OP_CONNECTION:
                connection, topic = read_connection(record, data)
                contents.connections[connection] = topic
            else:
                contents.error = f"a record of type {record.op} lies among the messages"
        except RecordError as error:
            contents.error = str(error)
            break
        position = contents.end = end
    contents.num_messages = len(entries) + skipped
    return contents
