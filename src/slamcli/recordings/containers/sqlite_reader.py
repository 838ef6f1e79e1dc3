# SPDX-License-Identifier: MIT
"""ROS 2 bags in SQLite (``.db3``), also cut off or malformed ones."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from slamcli.errors import RecordingError
from slamcli.recordings.containers.damage import Damage, at_time
from slamcli.recordings.containers.qos import is_latched
from slamcli.recordings.containers.runs import Run
from slamcli.recordings.containers.source import Source
from slamcli.recordings.containers.topic_table import MAX_TOPICS, TopicTable
from slamcli.recordings.raw import RawMessage, Topic

# A damaged schema may come back in an error message that is no UTF-8.
_ERRORS = (sqlite3.Error, OverflowError, UnicodeError)
_BLOCK_BYTES = 4 << 20
_BLOCK_ROWS = 4096
_MAX_GAPS = 64


@dataclass(slots=True)
class _Block:
    """Neighbouring rows of the table of messages."""

    first: int
    last: int
    start_ns: int
    end_ns: int
    topics: frozenset[int]
    in_order: bool


class SqliteVolume:
    """One ``.db3`` file.

    Rows are listed once, without their payload, in blocks of some megabytes; so neither an index nor its soundness
    is needed, and a malformed page costs only the rows on it.

    Raises
    ------
    RecordingError
        If it is a database but no bag.
    """

    format = "rosbag2-sqlite3"
    compression = "none"

    def __init__(self, source: Source, table: TopicTable, damage: Damage) -> None:
        self._source = source
        self._path = source.path
        self._table = table
        self._damage = damage
        self._channels: dict[int, int] = {}
        self._blocks: list[_Block] = []
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self._check_size()
        self._connection = self._connect()
        try:
            self._open()
        except BaseException:
            self._connection.close()
            raise

    def runs(self, channels: frozenset[int] | None, start_ns: int | None, stop_ns: int | None) -> list[Run]:
        """Return the blocks of rows that may hold messages of these channels and times."""
        wanted = {number for number, channel in self._channels.items() if channels is None or channel in channels}
        return [
            Run(block.start_ns, lambda block=block: self._stream(block, wanted, start_ns, stop_ns))  # type: ignore[misc]
            for block in self._blocks
            if (start_ns is None or block.end_ns >= start_ns)
            and (stop_ns is None or block.start_ns < stop_ns)
            and not wanted.isdisjoint(block.topics)
        ]

    def close(self) -> None:
        """Close the database."""
        self._connection.close()
        self._source.close()

    def _check_size(self) -> None:
        """Tell if the file is shorter than its head says."""
        head = self._source.read(0, 100)
        page = int.from_bytes(head[16:18], "big")
        declared = (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")
        if head[24:28] == head[92:96] and declared > self._source.size:
            lost = declared - self._source.size
            self._damage.add(f"{self._path}: cut off: the last {lost} of {declared} bytes are missing")

    def _connect(self) -> sqlite3.Connection:
        # Immutable: no lock, and nothing is written beside the bag; but then a write-ahead log of a recording that was
        # not closed would be ignored.
        wal = self._path.with_name(self._path.name + "-wal")
        mode = "mode=ro" if wal.is_file() and wal.stat().st_size else "mode=ro&immutable=1"
        try:
            connection = sqlite3.connect(f"file:{quote(str(self._path.absolute()))}?{mode}", uri=True)
        except _ERRORS as error:
            raise RecordingError(f"{self._path}: cannot be opened as a database ({error})") from error
        connection.text_factory = lambda raw: raw.decode("utf-8", errors="replace")
        connection.isolation_level = None
        return connection

    def _open(self) -> None:
        try:
            tables = {row[0] for row in self._connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}
        except _ERRORS as error:
            raise RecordingError(f"{self._path}: damaged at its beginning, nothing can be read ({error})") from error
        if not {"topics", "messages"} <= tables:
            if {"Node", "Link", "Admin"} <= tables:
                raise RecordingError(
                    f"{self._path}: a database of RTAB-Map, not a recording: slamcli map --algo rtabmap maps from it, slamcli info shows it"
                )
            known = ", ".join(sorted(map(str, tables))) or "none"
            raise RecordingError(
                f"{self._path}: a database but no ROS 2 bag: it has no tables 'topics' and 'messages', nor those of RTAB-Map (tables: {known})"
            )
        topics = self._read_topics("message_definitions" in tables)
        counts = self._list_rows(set(topics))
        for number, topic in topics.items():
            self._channels[number] = self._table.add(_counted(topic, counts[number]))
        self.start_ns = min((block.start_ns for block in self._blocks), default=None)
        self.end_ns = max((block.end_ns for block in self._blocks), default=None)

    def _read_topics(self, has_definitions: bool) -> dict[int, Topic]:
        definitions: dict[str, tuple[str, str]] = {}
        topics: dict[int, Topic] = {}
        try:
            if has_definitions:
                query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions ORDER BY id"
                for msgtype, encoding, definition in self._connection.execute(query):
                    definitions[str(msgtype)] = ("idl" if encoding == "ros2idl" else "msg", str(definition or ""))
            cursor = self._connection.execute("SELECT * FROM topics ORDER BY id")
            columns = [column[0] for column in cursor.description]
            for values in cursor:
                row = dict(zip(columns, values, strict=True))
                number, name, msgtype = row.get("id"), row.get("name"), row.get("type")
                if not isinstance(number, int) or not isinstance(name, str) or not isinstance(msgtype, str):
                    self._damage.add(f"{self._path}: a row of its topics is damaged")
                    continue
                language, definition = definitions.get(msgtype, ("msg", ""))
                qos = str(row.get("offered_qos_profiles") or "")
                topics[number] = Topic(
                    name=name,
                    msgtype=msgtype,
                    count=0,
                    definition=definition,
                    encoding=str(row.get("serialization_format") or "cdr"),
                    latched=is_latched(qos),
                    qos=qos,
                    definition_format=language,
                    digest=str(row.get("type_description_hash") or ""),
                )
                if len(topics) >= MAX_TOPICS:
                    break
        except _ERRORS as error:
            self._damage.add(f"{self._path}: its topics are damaged ({error}); {len(topics)} of them were read")
        return topics

    def _list_rows(self, topics: set[int]) -> Counter[int]:
        """List all rows that can be reached, in blocks; step over malformed places."""
        counts: Counter[int] = Counter()
        position, gaps, bad_rows = -(2**63), 0, 0
        last_ns: int | None = None
        step = 1
        while True:
            builder = _BlockBuilder(self._blocks)
            error_text = ""
            try:
                cursor = self._connection.execute(
                    "SELECT id, topic_id, timestamp, length(data) FROM messages WHERE id >= ? ORDER BY id", (position,)
                )
                for number, topic, time, size in cursor:
                    if number < position:
                        error_text = "rows are out of order"
                        break
                    position, step = number + 1, 1
                    if topic in topics and type(time) is int and type(size) is int and time >= 0:
                        builder.add(number, topic, time, size)
                        counts[topic] += 1
                        last_ns = time
                    else:
                        bad_rows += 1
            except _ERRORS as error:
                error_text = str(error)
            builder.flush()
            if not error_text:
                break
            gaps += 1
            if gaps == 1:
                self._damage.add(f"{self._path}: malformed after row {position - 1} ({error_text}; {at_time(last_ns)})")
            if gaps > _MAX_GAPS or step > 1 << 40:
                break
            position = max(position, 0) + step
            step *= 2
        if bad_rows:
            self._damage.add(f"{self._path}: {bad_rows} rows are damaged or belong to no topic")
        return counts

    def _stream(
        self, block: _Block, wanted: set[int], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        rows = self._rows(block, wanted & block.topics)
        if not block.in_order:
            rows = iter(sorted(rows, key=lambda row: row[2]))
        names, channels = self._table.names, self._channels
        for _, topic, time, data in rows:
            if start_ns is not None and time < start_ns:
                continue
            if stop_ns is not None and time >= stop_ns:
                return
            channel = channels[topic]
            yield RawMessage(names[channel], time, data, channel)

    def _rows(self, block: _Block, wanted: frozenset[int] | set[int]) -> Iterator[tuple[int, int, int, bytes]]:
        position, lost = block.first, 0
        chosen = "" if len(wanted) == len(block.topics) else f"AND topic_id IN ({','.join(map(str, sorted(wanted)))}) "
        while position <= block.last:
            try:
                cursor = self._connection.execute(
                    f"SELECT id, topic_id, timestamp, data FROM messages WHERE id BETWEEN ? AND ? {chosen}ORDER BY id",  # noqa: S608 (numbers)
                    (position, block.last),
                )
                for row in cursor:
                    if row[0] < position:
                        break
                    position = row[0] + 1
                    if type(row[3]) is bytes and type(row[2]) is int and row[1] in wanted:
                        yield row
            except _ERRORS:
                lost += 1
                position += 1
                if lost > _MAX_GAPS:
                    break
            else:
                break
        if lost:
            self._damage.add(
                f"{self._path}: at least {lost} messages between row {block.first} and {block.last} are lost"
            )


class _BlockBuilder:
    def __init__(self, blocks: list[_Block]) -> None:
        self._blocks = blocks
        self._reset()

    def _reset(self) -> None:
        self._rows = self._bytes = 0
        self._first = self._last = self._start = self._end = 0
        self._topics: set[int] = set()
        self._in_order = True

    def add(self, number: int, topic: int, time: int, size: int) -> None:
        if not self._rows:
            self._first, self._start, self._end = number, time, time
        if time < self._end:
            self._in_order = False
            self._start = min(self._start, time)
        else:
            self._end = time
        self._last = number
        self._topics.add(topic)
        self._rows += 1
        self._bytes += size
        if self._rows >= _BLOCK_ROWS or self._bytes >= _BLOCK_BYTES:
            self.flush()

    def flush(self) -> None:
        if self._rows:
            topics = frozenset(self._topics)
            self._blocks.append(_Block(self._first, self._last, self._start, self._end, topics, self._in_order))
        self._reset()


def _counted(topic: Topic, count: int) -> Topic:
    values: dict[str, Any] = {name: getattr(topic, name) for name in topic.__slots__}
    return Topic(**{**values, "count": count})
