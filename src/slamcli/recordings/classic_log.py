# SPDX-License-Identifier: MIT
"""CARMEN and BreezySLAM logs as a container of messages, so that every command reads them as they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from slamcli.errors import RecordingError
from slamcli.recordings.adapters import encoder_for, message_factory
from slamcli.recordings.adapters.tf_message import is_static_topic
from slamcli.recordings.breezy import BreezyOptions, is_breezy, read_breezy
from slamcli.recordings.carmen import read_carmen
from slamcli.recordings.carmen_lines import is_carmen
from slamcli.recordings.raw import Contents, RawMessage, Topic
from slamcli.runtime import RunLog

_CARMEN_SUFFIXES = (".clf", ".log", ".clf.gz", ".log.gz")


CLASSIC_FORMATS = ("carmen log", "breezy log")
"""Formats as `Contents.format` names them; such logs have no log times of their own."""


def classic_kind(paths: Sequence[Path], breezy: BreezyOptions | None = None) -> str:
    """Return ``carmen`` or ``breezy`` for a classic log, an empty string for anything else.

    Raises
    ------
    RecordingError
        If there are several files and one of them is a classic log.
    """
    kind = next((found for path in paths if (found := _kind_of(path, breezy))), "")
    if kind and len(paths) > 1:
        raise RecordingError(f"{paths[0]}: classic logs cannot be joined with other files; give one")
    return kind


def has_classic_content(path: Path) -> bool:
    """Return whether a file is a classic log by its content alone, whatever its name says."""
    return path.is_file() and (is_carmen(path) or is_breezy(path))


def _kind_of(path: Path, breezy: BreezyOptions | None) -> str:
    try:
        if not path.is_file() or path.stat().st_size == 0:
            return ""
        if path.name.lower().endswith(_CARMEN_SUFFIXES) or is_carmen(path):
            return "carmen"
        return "breezy" if is_breezy(path, breezy) else ""
    except OSError:
        return ""


class ClassicLogReader:
    """A classic log read into memory as CDR messages; implements `slamcli.recordings.raw.RawReader`.

    Such logs are text of a few tens of MB at most, and their messages take less memory than that.
    """

    def __init__(self, path: Path, kind: str, log: RunLog) -> None:
        self._messages: list[RawMessage] = []
        self._factory = message_factory("cdr")
        msgtypes: dict[str, str] = {}
        for record in read_carmen(path, log) if kind == "carmen" else read_breezy(path, log):
            adapter = encoder_for(record.measurement)
            msgtype = msgtypes.setdefault(record.topic, adapter.msgtypes[0])
            data = self._factory.serialise(adapter.encode(record.measurement, self._factory), msgtype)
            self._messages.append(RawMessage(record.topic, record.log_time_ns, data))
        self._msgtypes = msgtypes
        self._contents = self._describe(path, kind)

    def _describe(self, path: Path, kind: str) -> Contents:
        counts = Counter(message.topic for message in self._messages)
        topics = tuple(
            Topic(
                name=name,
                msgtype=msgtype,
                count=counts[name],
                definition=self._factory.definition(msgtype),
                latched=is_static_topic(name),
            )
            for name, msgtype in self._msgtypes.items()
        )
        return Contents(
            paths=(path,),
            format=f"{kind} log",
            size_bytes=path.stat().st_size,
            topics=topics,
            start_ns=self._messages[0].log_time_ns if self._messages else None,
            end_ns=self._messages[-1].log_time_ns if self._messages else None,
            num_messages=len(self._messages),
            compression="gzip" if path.suffix.lower() == ".gz" else "none",
        )

    @property
    def contents(self) -> Contents:
        """What lies in the log."""
        return self._contents

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Yield messages in the order of the log's lines, from `start_ns` to before `stop_ns`."""
        for message in self._messages:
            if stop_ns is not None and message.log_time_ns >= stop_ns:
                return
            if (topics is None or message.topic in topics) and (start_ns is None or message.log_time_ns >= start_ns):
                yield message

    def decode(self, message: RawMessage) -> Any:
        """Return the decoded message."""
        return self._factory.deserialise(message.data, self._msgtypes[message.topic])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._messages = []


def open_classic(paths: Sequence[Path], log: RunLog) -> ClassicLogReader | None:
    """Return a reader if `paths` is a classic log, None if it is something else.

    Raises
    ------
    RecordingError
        If the log cannot be used, or there are several files and one of them is a classic log.
    """
    kind = classic_kind(paths)
    return ClassicLogReader(paths[0], kind, log) if kind else None
