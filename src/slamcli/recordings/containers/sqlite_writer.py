# SPDX-License-Identifier: MIT
"""Writes the database of a ROS 2 bag, as rosbag2 of ROS Iron and later lays it out."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import zstandard

from slamcli.errors import RecordingError
from slamcli.recordings.raw import RawMessage, Topic

COMPRESSIONS = ("none", "zstd")

_BATCH = 1000
_TABLES = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL,
  offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
"""


class SqliteFile:
    """A ``.db3`` file being written to `path`; with ``zstd`` every message is compressed by itself."""

    def __init__(self, path: Path, compression: str) -> None:
        self._compressor = zstandard.ZstdCompressor(level=1) if compression == "zstd" else None
        self._rows: list[tuple[int, int, bytes | memoryview]] = []
        self._types: set[str] = set()
        self._num_topics = 0
        path.unlink(missing_ok=True)
        self._connection = sqlite3.connect(path, isolation_level=None)
        self._connection.executescript("PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF;" + _TABLES)
        self._connection.execute("INSERT INTO schema VALUES (4, 'slamcli')")
        self._connection.execute("BEGIN")

    def add_topic(self, topic: Topic) -> int:
        """Declare a topic and return its number."""
        if topic.encoding == "ros1":
            raise RecordingError(f"topic {topic.name}: a ROS 2 bag holds no ros1 messages")
        self._num_topics += 1
        if topic.msgtype not in self._types:
            self._types.add(topic.msgtype)
            encoding = "ros2idl" if topic.definition_format == "idl" else "ros2msg"
            self._connection.execute(
                "INSERT INTO message_definitions VALUES (NULL, ?, ?, ?, ?)",
                (topic.msgtype, encoding, topic.definition, topic.digest),
            )
        self._connection.execute(
            "INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)",
            (self._num_topics, topic.name, topic.msgtype, topic.encoding, topic.qos, topic.digest),
        )
        return self._num_topics

    def write(self, number: int, message: RawMessage) -> None:
        """Append a message."""
        data = message.data if self._compressor is None else self._compressor.compress(message.data)
        self._rows.append((number, message.log_time_ns, data))
        if len(self._rows) >= _BATCH or len(data) > 1 << 20:
            self._flush()

    def close(self) -> None:
        """Write what is left and the index, and close the file."""
        self._flush()
        self._connection.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        self._connection.execute("COMMIT")
        self._connection.close()

    def abort(self) -> None:
        """Close the file as it is."""
        self._connection.close()

    def _flush(self) -> None:
        self._connection.executemany("INSERT INTO messages VALUES (NULL, ?, ?, ?)", self._rows)
        self._rows.clear()
