# SPDX-License-Identifier: MIT
"""Writes recordings in any format, whole or not at all."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import sqlite3
import sys
from collections import Counter
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import yaml

from slamcli.errors import RecordingError, UsageError
from slamcli.outputs import atomic_directory, atomic_path
from slamcli.recordings.containers import mcap_writer, rosbag1_writer, sqlite_writer
from slamcli.recordings.containers.decoding import completed_topic
from slamcli.recordings.containers.folder import STORAGE_SUFFIXES
from slamcli.recordings.containers.mcap_extras import Extra
from slamcli.recordings.containers.qos import LATCHED_QOS
from slamcli.recordings.raw import RawMessage, Topic

FORMATS = {
    "rosbag1": rosbag1_writer.COMPRESSIONS,
    "mcap": mcap_writer.COMPRESSIONS,
    "rosbag2-mcap": mcap_writer.COMPRESSIONS,
    "rosbag2-sqlite3": sqlite_writer.COMPRESSIONS,
    "sqlite3": ("none",),
}
"""Formats that can be written, with their compressions. ``sqlite3`` is a single file without metadata.yaml."""
_BY_SUFFIX = {".bag": "rosbag1", ".mcap": "mcap", ".db3": "sqlite3", "": "rosbag2-mcap"}
_METADATA_VERSION = 8


class _File(Protocol):
    def add_topic(self, topic: Topic) -> int: ...

    def write(self, number: int, message: RawMessage) -> None: ...

    def close(self) -> None: ...

    def abort(self) -> None: ...


class FileWriter:
    """Writes one recording; implements `slamcli.recordings.raw.RawWriter`."""

    def __init__(self, target: Path, format: str, compression: str) -> None:
        self.path = target
        self.format = format
        self.compression = compression
        self._stack = contextlib.ExitStack()
        self._file: _File | None = None
        self._folder: Path | None = None
        self._numbers: dict[tuple[str, int], int] = {}
        self._topics: list[Topic] = []
        self._counts: Counter[int] = Counter()
        self._start = 2**63 - 1
        self._end = 0

    @property
    def encoding(self) -> str | None:
        """The encoding that messages must have: ``ros1`` or ``cdr``; None where both are possible (plain MCAP)."""
        return {"rosbag1": "ros1", "mcap": None}.get(self.format, "cdr")

    @property
    def topics(self) -> tuple[Topic, ...]:
        """The topics so far, with the number of messages written."""
        return tuple(
            dataclasses.replace(topic, count=self._counts[self._numbers[topic.name, channel]])
            for channel, topic in enumerate(self._topics)
        )

    @property
    def times_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message, None without messages."""
        return (self._start, self._end) if self._counts else None

    def add_topic(self, topic: Topic) -> None:
        """Declare a topic before its first message."""
        if self.encoding and topic.encoding != self.encoding:
            raise RecordingError(
                f"topic {topic.name}: {self.format} holds {self.encoding} messages, these are {topic.encoding!r}"
            )
        if topic.latched and topic.encoding == "cdr" and not topic.qos:
            topic = dataclasses.replace(topic, qos=LATCHED_QOS)
        topic = completed_topic(topic)
        number = self._open().add_topic(topic)
        self._topics.append(topic)
        # A message names its topic, or its channel too, where two topics share a name.
        self._numbers.setdefault((topic.name, -1), number)
        self._numbers[topic.name, len(self._topics) - 1] = number

    def write(self, message: RawMessage) -> None:
        """Append a message that is encoded as its topic's `encoding` says; `channel` counts the added topics or is -1."""
        number = self._numbers.get((message.topic, message.channel))
        if number is None:
            raise RecordingError(f"topic {message.topic}: was not added before its first message")
        self._open().write(number, message)
        self._counts[number] += 1
        time = message.log_time_ns
        self._start = min(self._start, time)
        self._end = max(self._end, time)

    def add_extra(self, extra: Extra) -> bool:
        """Write an attachment or metadata record of an MCAP file; False where the format has no place for it."""
        file = self._open()
        if not isinstance(file, mcap_writer.McapFile):
            return False
        file.add_extra(extra)
        return True

    def __enter__(self) -> Self:
        if self.format.startswith("rosbag2"):
            self._check_folder()
            self._folder = self._stack.enter_context(atomic_directory(self.path))
            path = self._folder / self._storage_name()
        else:
            path = self._stack.enter_context(atomic_path(self.path))
        self._file = _open_file(path, self.format, self.compression)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        file, self._file = self._file, None
        if kind is not None or file is None:
            if file is not None:
                with contextlib.suppress(OSError, sqlite3.Error):
                    file.abort()
            self._stack.__exit__(kind, error, trace)
            return
        try:
            file.close()
            if self._folder is not None:
                self._write_metadata(self._folder)
        except BaseException:
            with contextlib.suppress(OSError, sqlite3.Error):
                file.abort()
            self._stack.__exit__(*sys.exc_info())
            raise
        self._stack.__exit__(None, None, None)
        if self._folder is not None:
            # Storage files of a recording that was replaced are carried over by atomic_directory.
            for path in self.path.iterdir():
                if path.name.endswith(STORAGE_SUFFIXES) and path.name != self._storage_name():
                    path.unlink()

    def _check_folder(self) -> None:
        """Refuse to replace a folder that holds anything else than a recording."""
        if not self.path.is_dir():
            return
        others = [
            p.name for p in self.path.iterdir() if p.name != "metadata.yaml" and not p.name.endswith(STORAGE_SUFFIXES)
        ]
        if others:
            raise UsageError(
                f"{self.path}: the folder holds other files ({', '.join(sorted(others)[:3])}): name a new folder"
            )

    def _open(self) -> _File:
        if self._file is None:
            raise RecordingError(f"{self.path}: the recording is not open for writing")
        return self._file

    def _storage_name(self) -> str:
        return f"{self.path.resolve().name}_0" + (".mcap" if self.format == "rosbag2-mcap" else ".db3")

    def _write_metadata(self, folder: Path) -> None:
        total = self._counts.total()
        start = self._start if total else 0
        span = {"nanoseconds": self._end - start if total else 0}
        begin = {"nanoseconds_since_epoch": start}
        name = self._storage_name()
        by_message = self.format == "rosbag2-sqlite3" and self.compression == "zstd"
        information: dict[str, Any] = {
            "version": _METADATA_VERSION,
            "storage_identifier": "mcap" if self.format == "rosbag2-mcap" else "sqlite3",
            "duration": span,
            "starting_time": begin,
            "message_count": total,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.msgtype,
                        "serialization_format": topic.encoding,
                        "offered_qos_profiles": topic.qos,
                        "type_description_hash": topic.digest,
                    },
                    "message_count": self._counts[self._numbers[topic.name, index]],
                }
                for index, topic in enumerate(self._topics)
            ],
            "compression_format": "zstd" if by_message else "",
            "compression_mode": "MESSAGE" if by_message else "",
            "relative_file_paths": [name],
            "files": [{"path": name, "starting_time": dict(begin), "duration": dict(span), "message_count": total}],
            "custom_data": None,
            "ros_distro": "",
        }
        text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False, width=1000)
        (folder / "metadata.yaml").write_text(text, encoding="utf-8", newline="\n")


def create_raw(
    path: str | os.PathLike[str], *, format: str | None = None, compression: str | None = None
) -> FileWriter:
    """Return a writer for a recording; a context manager that leaves the whole recording or none.

    Parameters
    ----------
    path
        The file or folder to write; what is there is replaced in one step.
    format
        One of `FORMATS`; None chooses by the suffix: ``.bag`` rosbag1, ``.mcap`` mcap, ``.db3`` sqlite3, a name without
        suffix rosbag2-mcap (a folder).
    compression
        One that the format knows; None is ``zstd`` for MCAP and ``none`` else.

    Raises
    ------
    UsageError
        If there is no such format or compression, or the suffix says nothing.
    """
    target = Path(path)
    chosen = format or ("rosbag2-mcap" if target.is_dir() else _BY_SUFFIX.get(target.suffix.lower()))
    if chosen is None:
        raise UsageError(
            f"{target}: cannot tell the format from {target.suffix!r}: name it .bag, .mcap, .db3, a folder without "
            f"suffix, or give one of {', '.join(FORMATS)}"
        )
    if chosen not in FORMATS:
        raise UsageError(f"{target}: no format {chosen!r}: it is one of {', '.join(FORMATS)}")
    if compression is None:
        compression = "zstd" if "mcap" in chosen else "none"
    if compression not in FORMATS[chosen]:
        raise UsageError(
            f"{target}: {chosen} knows no compression {compression!r}: it is one of {', '.join(FORMATS[chosen])}"
        )
    return FileWriter(target, chosen, compression)


def _open_file(path: Path, format: str, compression: str) -> _File:
    if format == "rosbag1":
        return rosbag1_writer.Rosbag1File(path, compression)
    if "mcap" in format:
        return mcap_writer.McapFile(path, compression)
    return sqlite_writer.SqliteFile(path, compression)
