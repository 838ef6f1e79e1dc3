# SPDX-License-Identifier: MIT
"""Data-set folders as containers of messages, so that every command reads them as they are."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import RecordingError
from slamcli.recordings.adapters import message_factory
from slamcli.recordings.adapters.tf_message import is_static_topic
from slamcli.recordings.containers.damage import Damage
from slamcli.recordings.folders.layout import DataFolder, Reading
from slamcli.recordings.folders.streams import CameraInfos, Stream
from slamcli.recordings.imu_noise import NOISE_SUFFIX
from slamcli.recordings.raw import Contents, RawMessage, Topic

_LAST_NS = (1 << 31) * 1_000_000_000
"""Beyond the last second that a message's stamp holds (the year 2038)."""
_STEP = 4096
"""Messages whose places in the index are turned into Python numbers at once."""


class FolderReader:
    """A data-set folder; implements `slamcli.recordings.raw.RawReader`.

    Only stamps and names are kept: an image is read when its message is asked for, one at a time. Reading keeps no
    state besides the list of files that turned out unreadable, so that several threads may read. Log times are stamps.
    """

    def __init__(self, folder: DataFolder, layout: str, reading: Reading) -> None:
        damage = reading.damage
        self._folder = folder
        self._reading = reading
        usable = [(stream, _in_range(stream, damage)) for stream in folder.streams]
        usable = [(stream, rows) for stream, rows in usable if len(rows)]
        if not usable:
            reason = damage.lines()[:1]
            raise RecordingError(
                f"{folder.root}: a {layout}, but nothing of it can be read" + (f" ({reason[0]})" if reason else "")
            )
        self._streams = tuple(stream for stream, _ in usable)
        self._layout = layout
        self._damage = damage
        self._factory = message_factory("cdr")
        self._lost: dict[str, dict[int, str]] = {}
        stamps = np.concatenate([stream.stamps_ns[rows] for stream, rows in usable])
        order = np.argsort(stamps, kind="stable")
        self._stamps = stamps[order]
        self._channels = np.repeat(np.arange(len(usable)), [len(rows) for _, rows in usable])[order]
        self._indices = np.concatenate([rows for _, rows in usable])[order]
        self._topics = tuple(
            Topic(
                name=stream.topic,
                msgtype=stream.msgtype,
                count=len(rows),
                definition=self._factory.definition(stream.msgtype),
                latched=is_static_topic(stream.topic) or stream.topic.endswith(NOISE_SUFFIX),
            )
            for stream, rows in usable
        )

    @property
    def contents(self) -> Contents:
        """What lies in the folder."""
        lost = tuple(
            f"{topic}: {len(found)} images cannot be read and are left out, the first: {found[min(found)]}"
            for topic, found in sorted(self._lost.items())
        )
        return Contents(
            paths=(self._folder.root,),
            format=self._layout,
            size_bytes=self._folder.size_bytes,
            topics=self._topics,
            start_ns=int(self._stamps[0]),
            end_ns=int(self._stamps[-1]),
            num_messages=len(self._stamps),
            damage=(*self._damage.lines(), *lost),
        )

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Yield messages in the order of their stamps, from `start_ns` to before `stop_ns`."""
        self._tell_remarks(topics)
        first = 0 if start_ns is None else int(np.searchsorted(self._stamps, start_ns))
        last = len(self._stamps) if stop_ns is None else int(np.searchsorted(self._stamps, stop_ns))
        wanted = np.array([topics is None or topic.name in topics for topic in self._topics])
        places = first + np.flatnonzero(wanted[self._channels[first:last]])
        for begin in range(0, len(places), _STEP):
            chunk = places[begin : begin + _STEP]
            rows = (self._stamps[chunk].tolist(), self._channels[chunk].tolist(), self._indices[chunk].tolist())
            for stamp_ns, channel, index in zip(*rows, strict=True):
                topic = self._topics[channel]
                try:
                    message = self._streams[channel].message(index)
                except RecordingError as error:
                    self._lost.setdefault(topic.name, {})[index] = str(error)
                    continue
                data = self._factory.serialise(message, topic.msgtype)
                yield RawMessage(topic.name, stamp_ns, data, channel, index)

    def _tell_remarks(self, topics: Collection[str] | None) -> None:
        """Say where the calibration comes from, if it is among what is read."""
        infos = (topic.name for topic in self._topics if topic.msgtype == CameraInfos.msgtype)
        if not any(topics is None or name in topics for name in infos):
            return
        for text, doubtful in self._reading.remarks:
            (self._reading.log.warn if doubtful else self._reading.log.note)(text)

    def extras(self) -> Iterator[Any]:
        """Yield nothing: folders have no attachments."""
        return iter(())

    def decode(self, message: RawMessage) -> Any:
        """Return the decoded message."""
        return self._factory.deserialise(message.data, self._topics[message.channel].msgtype)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is held open."""


def _in_range(stream: Stream, damage: Damage) -> NDArray[np.int64]:
    """Return the indices of the messages whose stamps a message can hold, int64 (N,); the others are told."""
    good = (stream.stamps_ns > 0) & (stream.stamps_ns < _LAST_NS)
    if not good.all():
        wrong = stream.stamps_ns[~good]
        damage.add(
            f"{stream.topic}: {len(wrong)} of {len(good)} stamps are beyond what a message can hold (first: {wrong[0] / 1e9:.9g} s)"
        )
    return np.flatnonzero(good)
