# SPDX-License-Identifier: MIT
"""Recordings and classic logs to recordings of any format."""

from __future__ import annotations

import dataclasses
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from slamcli.errors import RecordingError, UsageError
from slamcli.pipelines.conversion import Conversion, Selection
from slamcli.pipelines.output_record import write_output_record
from slamcli.recordings.breezy import BreezyOptions, read_breezy
from slamcli.recordings.carmen import CarmenOptions, read_carmen
from slamcli.recordings.classic_log import classic_kind
from slamcli.recordings.containers import create_raw, open_raw
from slamcli.recordings.containers.reader import JoinedReader
from slamcli.recordings.containers.transcoding import Transcoder, TranscodingError
from slamcli.recordings.containers.writer import FileWriter
from slamcli.recordings.folders import FolderReader, open_folder
from slamcli.recordings.log_record import LogRecord
from slamcli.recordings.raw import Contents, RawMessage, Topic
from slamcli.recordings.writing import RecordingWriter
from slamcli.runtime import RunLog

_PROGRESS_EVERY = 1000


def convert(
    sources: Sequence[str | os.PathLike[str]],
    target: str | os.PathLike[str],
    *,
    format: str | None = None,
    compression: str | None = None,
    encoding: str | None = None,
    selection: Selection | None = None,
    carmen: CarmenOptions | None = None,
    breezy: BreezyOptions | None = None,
    depth_units_per_m: float | None = None,
    log: RunLog | None = None,
) -> Conversion:
    """Convert a recording, a data-set folder or a classic log to a recording; what was at `target` is replaced in one step.

    Parameters
    ----------
    sources
        One recording (several files if it was split), one data-set folder (see `slamcli.recordings.folders`), or one
        CARMEN or BreezySLAM log; told apart by content.
    target
        File or folder to write; `format` and `compression` as in `slamcli.recordings.containers.create_raw`.
    encoding
        ``ros1`` or ``cdr`` for plain MCAP, which holds both; None is ``cdr``.
    depth_units_per_m
        Value of one metre in the depth images of a data-set folder; None for the data set's own.
    log
        Gets warnings on damage and what was left out.

    Raises
    ------
    UsageError
        If target and source are the same, or the options do not fit.
    RecordingError
        If the source is no recording, nothing can be read of it, or its messages cannot be expressed in the target.
    """
    log = log or RunLog()
    selection = selection or Selection()
    paths = [Path(source) for source in sources]
    check_target(paths, Path(target))
    writer = create_raw(target, format=format, compression=compression)
    if encoding is not None and writer.encoding not in (None, encoding):
        raise UsageError(f"{writer.format} holds {writer.encoding} messages; --encoding is for plain MCAP files")
    encoding = writer.encoding or encoding or "cdr"
    classic = classic_kind(paths, breezy)
    if classic == "":
        copy = _Copy(writer, encoding, selection, log)
        with open_folder(paths, log, depth_units_per_m=depth_units_per_m) or open_raw(paths, log) as reader, writer:
            copy.run(reader)
            contents = reader.contents
    else:
        records = read_carmen(paths[0], log, carmen) if classic == "carmen" else read_breezy(paths[0], log, breezy)
        with writer:
            contents = _write_records(records, writer, encoding, selection, log)
        contents = dataclasses.replace(contents, paths=tuple(paths), format=classic)
    made = _conversion(contents, writer, copy.num_lost if classic == "" else 0)
    given = {"format": format, "compression": compression, "encoding": encoding, **dataclasses.asdict(selection)}
    if depth_units_per_m is not None:
        given["depth_scale"] = depth_units_per_m
    given |= dataclasses.asdict(carmen or CarmenOptions()) if classic == "carmen" else {}
    given |= dataclasses.asdict(breezy or BreezyOptions()) if classic == "breezy" else {}
    _write_record(made, given, log)
    return made


def _write_record(made: Conversion, given: dict[str, Any], log: RunLog) -> None:
    span_s = ((made.end_ns or 0) - (made.start_ns or 0)) / 1e9
    write_output_record(
        [made.target],
        command="convert",
        inputs=made.sources,
        parameters=given | {"format": made.format, "compression": made.compression},
        changed={name: value for name, value in given.items() if value not in (None, ())},
        summary={
            "source_format": made.source_format,
            "num_messages": made.num_messages,
            "num_lost": made.num_lost,
            "damage": made.damage,
        },
        topics={topic.name: topic.count for topic in made.topics},
        duration_s=span_s,
        log=log,
    )


def write_conversion_record(made: Conversion, given: dict[str, Any], selection: Selection, log: RunLog) -> None:
    """Write what was converted beside the target."""
    _write_record(made, given | dataclasses.asdict(selection), log)


def _conversion(contents: Contents, writer: FileWriter, num_lost: int) -> Conversion:
    start_ns, end_ns = writer.times_ns or (None, None)
    return Conversion(
        record=writer.path.with_name(f"{writer.path.name}.run.json"),
        sources=contents.paths,
        source_format=contents.format,
        target=writer.path,
        format=writer.format,
        compression=writer.compression,
        size_bytes=sum(p.stat().st_size for p in writer.path.rglob("*"))
        if writer.path.is_dir()
        else writer.path.stat().st_size,
        topics=writer.topics,
        num_messages=sum(topic.count or 0 for topic in writer.topics),
        start_ns=start_ns,
        end_ns=end_ns,
        num_lost=num_lost,
        damage=contents.damage,
    )


def check_target(sources: Sequence[Path], target: Path) -> None:
    """Raise UsageError if writing the target would touch a source."""
    resolved = target.resolve()
    for source in sources:
        if source.resolve() == resolved:
            raise UsageError(f"{target}: source and target are the same")
        if source.resolve().is_relative_to(resolved):
            raise UsageError(f"{target}: the source {source} lies in the target, which would be replaced")
        if source.is_dir() and resolved.is_relative_to(source.resolve()):
            raise UsageError(f"{target}: the target lies in the source {source}: write it somewhere else")


class _Copy:
    """Copies messages from a container to another, changing their encoding where needed."""

    def __init__(self, writer: FileWriter, encoding: str, selection: Selection, log: RunLog) -> None:
        self._writer = writer
        self._encoding = encoding
        self._selection = selection
        self._log = log
        self._transcoders: dict[int, Transcoder] = {}
        self._lost: Counter[str] = Counter()
        self._first_loss: dict[str, str] = {}

    @property
    def num_lost(self) -> int:
        """Messages that could not be converted."""
        return self._lost.total()

    def run(self, reader: JoinedReader | FolderReader) -> None:
        contents = reader.contents
        names = [topic.name for topic in contents.topics]
        self._selection.check(names)
        channels = self._add_topics(contents)
        if contents.damage and not contents.num_messages:
            raise RecordingError(f"{contents.damage[0]}; no message of it can be read")
        first_ns = contents.start_ns or 0
        length_s = ((contents.end_ns or first_ns) - first_ns) / 1e9
        start_ns, stop_ns = self._selection.window_ns(first_ns, length_s)
        wanted = None if len(channels) == len(names) else {names[channel] for channel in channels}
        with self._log.stage("convert", length_s):
            for number, message in enumerate(reader.messages(wanted, start_ns, stop_ns)):
                if number % _PROGRESS_EVERY == 0:
                    self._log.progress.update((message.log_time_ns - first_ns) / 1e9)
                if message.channel in channels:
                    self._copy(message, channels)
        self._copy_extras(reader)
        for topic, count in self._lost.items():
            self._log.warn(
                f"{topic}: {count} messages are not what their type says and are left out ({self._first_loss[topic]})"
            )

    def _copy_extras(self, reader: JoinedReader | FolderReader) -> None:
        """Carry attachments and metadata of MCAP files over."""
        left_out = [extra.name for extra in reader.extras() if not self._writer.add_extra(extra)]
        if left_out:
            self._log.warn(
                f"{len(left_out)} attachments and metadata records are left out ({', '.join(left_out[:5])}): "
                f"{self._writer.format} has no place for them"
            )

    def _add_topics(self, contents: Contents) -> dict[int, int]:
        """Declare the chosen topics; return the target's channel of each source channel."""
        channels: dict[int, int] = {}
        for channel, topic in enumerate(contents.topics):
            if not self._selection.chooses(topic.name):
                continue
            if topic.encoding != self._encoding and self._must_transcode(topic):
                transcoder = self._transcoder(topic)
                if transcoder is None:
                    continue
                self._transcoders[channel] = transcoder
                topic = transcoder.topic
            channels[channel] = len(channels)
            self._writer.add_topic(topic)
        return channels

    def _transcoder(self, topic: Topic) -> Transcoder | None:
        """Return what changes the topic's encoding; None for a topic that cannot be changed, but is empty."""
        try:
            transcoder = Transcoder(topic, self._encoding)
        except RecordingError as error:
            if topic.count == 0:
                self._log.warn(f"{error}; it is empty and left out")
                return None
            raise RecordingError(f"{error}; leave it out with --exclude-topics {topic.name}") from error
        if transcoder.migrates:
            self._log.warn(
                f"{topic.name}: {topic.msgtype} differs between ROS 1 and ROS 2; fields of the same name are kept"
            )
        return transcoder

    def _must_transcode(self, topic: Topic) -> bool:
        # Plain MCAP holds any encoding: json and protobuf pass as they are.
        return self._writer.encoding is not None or topic.encoding in ("ros1", "cdr")

    def _copy(self, message: RawMessage, channels: dict[int, int]) -> None:
        transcoder = self._transcoders.get(message.channel)
        name = message.topic
        if transcoder is not None:
            try:
                message = transcoder.message(message)
            except TranscodingError as error:
                self._lost[name] += 1
                self._first_loss.setdefault(name, f"the first at {message.log_time_ns / 1e9:.6f} s: {error}")
                return
        self._writer.write(message._replace(channel=channels[message.channel]))


def _write_records(
    records: Iterable[LogRecord], writer: FileWriter, encoding: str, selection: Selection, log: RunLog
) -> Contents:
    """Write a classic log's measurements."""
    messages = RecordingWriter(writer, encoding)
    seen: set[str] = set()
    with log.stage("convert"):
        for record in _selected(records, selection, seen):
            messages.write(record.topic, record.measurement, log_time_ns=record.log_time_ns)
    selection.check(seen)
    return Contents(
        paths=(), format="", size_bytes=0, topics=(), start_ns=None, end_ns=None, num_messages=None, compression=""
    )


def _selected(records: Iterable[LogRecord], selection: Selection, seen: set[str]) -> Iterator[LogRecord]:
    start_ns: int | None = None
    stop_ns: int | None = None
    for number, record in enumerate(records):
        if number == 0:
            start_ns, stop_ns = selection.window_ns(record.log_time_ns)
        seen.add(record.topic)
        static = record.topic == "/tf_static"  # without the mounts the rest is of little use
        if stop_ns is not None and record.log_time_ns >= stop_ns and not static:
            continue
        if selection.chooses(record.topic) and (static or start_ns is None or record.log_time_ns >= start_ns):
            yield record
