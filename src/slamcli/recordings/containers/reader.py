# SPDX-License-Identifier: MIT
"""Opens recordings: finds the format from the content, and joins several files to one."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import zstandard

from slamcli.errors import RecordingError
from slamcli.recordings.containers.compression import DecompressionError, decompress
from slamcli.recordings.containers.damage import Damage
from slamcli.recordings.containers.decoding import Decoder
from slamcli.recordings.containers.folder import read_folder
from slamcli.recordings.containers.mcap_extras import Extra
from slamcli.recordings.containers.mcap_reader import McapVolume
from slamcli.recordings.containers.rosbag1_reader import Rosbag1Volume
from slamcli.recordings.containers.runs import Budget, Run, merge
from slamcli.recordings.containers.source import Source
from slamcli.recordings.containers.sqlite_reader import SqliteVolume
from slamcli.recordings.containers.topic_table import TopicTable
from slamcli.recordings.raw import Contents, RawMessage
from slamcli.runtime import RunLog

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_KINDS = "slamcli reads ROS 1 .bag, ROS 2 .db3, .mcap and bag folders, data-set folders, CARMEN and exp*.dat logs"


class Volume(Protocol):
    """One storage file of a recording."""

    format: str

    @property
    def compression(self) -> str: ...  # noqa: D102

    @property
    def start_ns(self) -> int | None: ...  # noqa: D102

    @property
    def end_ns(self) -> int | None: ...  # noqa: D102

    def runs(self, channels: frozenset[int] | None, start_ns: int | None, stop_ns: int | None) -> list[Run]: ...  # noqa: D102

    def close(self) -> None: ...  # noqa: D102


class JoinedReader:
    """One recording out of one or more files; implements `slamcli.recordings.raw.RawReader`."""

    def __init__(self, paths: Sequence[Path], log: RunLog) -> None:
        self._paths = tuple(paths)
        self._damage = Damage(log)
        self._table = TopicTable()
        self._budget = Budget()
        self._decoder = Decoder()
        self._volumes: list[Volume] = []
        self._stack = contextlib.ExitStack()
        self._compressed_messages = False
        self._compression = ""
        self._format = ""
        self._size = 0
        try:
            for path in paths:
                self._open(path)
            self._check_formats()
        except BaseException:
            self._stack.close()
            raise
        self._volumes.sort(key=lambda volume: volume.start_ns if volume.start_ns is not None else 2**63)

    @property
    def contents(self) -> Contents:
        """What lies in it."""
        topics = self._table.topics()
        counts = [topic.count for topic in topics]
        starts = [volume.start_ns for volume in self._volumes if volume.start_ns is not None]
        ends = [volume.end_ns for volume in self._volumes if volume.end_ns is not None]
        return Contents(
            paths=self._paths,
            format=self._format,
            size_bytes=self._size,
            topics=topics,
            start_ns=min(starts, default=None),
            end_ns=max(ends, default=None),
            num_messages=None if None in counts else sum(count for count in counts if count is not None),
            compression=self._compression or self._volumes[0].compression,
            damage=self._damage.lines(),
        )

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Yield messages in log order (see `slamcli.recordings.raw.RawReader`)."""
        channels = self._table.channels(topics)
        runs = [run for volume in self._volumes for run in volume.runs(channels, start_ns, stop_ns)]
        stream = merge(runs)
        return self._unpack(stream) if self._compressed_messages else stream

    def extras(self) -> Iterator[Extra]:
        """Yield the attachments and metadata records of MCAP files."""
        for volume in self._volumes:
            if isinstance(volume, McapVolume):
                yield from volume.extras()

    def decode(self, message: RawMessage) -> Any:
        """Return the message as rosbags' decoded object.

        Raises
        ------
        RecordingError
            If its type is unknown or its bytes are damaged.
        """
        topics = self._table.topics()
        channel = message.channel if message.channel >= 0 else self._table.names.index(message.topic)
        return self._decoder.decode(topics[channel], message.data, message.log_time_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _check_formats(self) -> None:
        formats = sorted({volume.format for volume in self._volumes})
        if len(formats) > 1:
            raise RecordingError(
                f"{', '.join(map(str, self._paths))}: files of different formats ({', '.join(formats)})"
            )

    def _open(self, path: Path) -> None:
        if path.name == "metadata.yaml" and path.is_file():
            path = path.parent
        if not path.is_dir():
            self._open_file(path, in_folder=False)
            return
        folder = read_folder(path, self._damage)
        self._compressed_messages = self._compressed_messages or folder.compressed_messages
        self._compression = self._compression or folder.compression
        for file in folder.files:
            self._open_file(file, in_folder=True)

    def _open_file(self, path: Path, *, in_folder: bool) -> None:
        if not path.exists():
            raise RecordingError(f"{path}: there is no such file")
        if not path.is_file():
            raise RecordingError(f"{path}: not a file")
        source = Source(path)
        self._stack.callback(source.close)
        self._size += source.size
        if source.read(0, 4) == _ZSTD_MAGIC:
            source = self._inflate(source)
        volume = self._open_source(source)
        self._stack.callback(volume.close)
        self._volumes.append(volume)
        name = "rosbag2-mcap" if in_folder and volume.format == "mcap" else volume.format
        self._format = self._format or name

    def _open_source(self, source: Source) -> Volume:
        head = source.read(0, 16)
        if head.startswith((b"#ROSBAG V", b"#ROSRECORD V")):
            return Rosbag1Volume(source, self._table, self._damage, self._budget)
        if head.startswith(b"\x89MCAP0\r\n"):
            return McapVolume(source, self._table, self._damage, self._budget)
        if head == b"SQLite format 3\x00":
            return SqliteVolume(source, self._table, self._damage)
        if not head:
            raise RecordingError(f"{source.path}: the file is empty; {_KINDS}")
        hint = "; it is compressed as a whole: gunzip it first" if head.startswith(b"\x1f\x8b") else ""
        raise RecordingError(f"{source.path}: not a recording (it begins with {head[:8]!r}{hint}); {_KINDS}")

    def _inflate(self, source: Source) -> Source:
        """Unpack a file that is compressed as a whole into a temporary one, because databases and indexes need seeking."""
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="slamcli-")))
        target = folder / source.path.name.removesuffix(".zstd")
        free = shutil.disk_usage(folder).free // 2
        written = 0
        with source.path.open("rb") as packed, target.open("wb") as unpacked:
            try:
                with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(
                    packed, read_across_frames=True
                ) as stream:
                    while block := stream.read(1 << 22):
                        written += len(block)
                        if written > free:
                            raise RecordingError(f"{source.path}: does not fit unpacked into {folder} ({free} bytes)")
                        unpacked.write(block)
            except (zstandard.ZstdError, MemoryError) as error:
                self._damage.add(f"{source.path}: damaged after {written} unpacked bytes ({error})")
        self._compression = self._compression or "zstd"
        inflated = Source(target)
        self._stack.callback(inflated.close)
        return inflated

    def _unpack(self, stream: Iterator[RawMessage]) -> Iterator[RawMessage]:
        lost = 0
        for message in stream:
            try:
                yield message._replace(data=decompress(bytes(message.data), "zstd", None))
            except DecompressionError as error:
                lost += 1
                if lost == 1:
                    self._damage.add(f"{self._paths[0]}: a message on {message.topic} cannot be decompressed ({error})")
        if lost > 1:
            self._damage.add(f"{self._paths[0]}: {lost} messages cannot be decompressed")


def open_raw(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], log: RunLog | None = None
) -> JoinedReader:
    """Open a recording: one file, one ROS 2 bag folder, or several files of one recording.

    The format is found from the content. Damaged files are read up to the damage; what was lost stands in
    ``contents.damage`` and in the warnings of `log` (complete after all messages were read).

    Raises
    ------
    RecordingError
        If a path is missing or is no recording.
    """
    given = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    unique = list({Path(path).resolve(): Path(path) for path in given}.values())
    if not unique:
        raise RecordingError("no recording was named")
    return JoinedReader(unique, log or RunLog())
