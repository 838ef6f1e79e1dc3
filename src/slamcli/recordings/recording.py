# SPDX-License-Identifier: MIT
"""A recording as measurements: topics merged by header stamp, frames, and the mends applied while reading."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from slamcli.errors import RecordingError, SlamcliError, UsageError
from slamcli.geometry.frame_tree import FrameTree
from slamcli.recordings.adapters import adapter_for, msgtypes_of
from slamcli.recordings.adapters.context import renaming
from slamcli.recordings.frames import read_frames
from slamcli.recordings.mends import Mends
from slamcli.recordings.raw import Contents, RawReader, Topic
from slamcli.recordings.stamps import merge_by_stamp
from slamcli.recordings.topic_decoder import TopicDecoder, short_type
from slamcli.runtime import RunLog

T = TypeVar("T")


def open_recording(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    mends: Mends | None = None,
    log: RunLog | None = None,
) -> Recording:
    """Open a recording (one path, or several split files that belong together) to read its measurements.

    CARMEN (``.log``, ``.clf``, also ``.gz``) and BreezySLAM logs (``exp*.dat``) are read as they are, and so are the
    folders of data sets (see `slamcli.recordings.folders`).

    Raises
    ------
    RecordingError
        If a file is missing, or is no recording.
    """
    from slamcli.recordings.classic_log import open_classic
    from slamcli.recordings.containers import open_raw
    from slamcli.recordings.folders import open_folder

    log = log if log is not None else RunLog()
    listed = [Path(path) for path in ([paths] if isinstance(paths, (str, os.PathLike)) else paths)]
    mends = mends or Mends()
    units = mends.depth_units_per_m or mends.settings_depth_units_per_m
    raw: RawReader | None = open_folder(listed, log, depth_units_per_m=units)
    if raw is not None:  # the folder's messages are in metres by it already
        mends = replace(mends, depth_units_per_m=None, settings_depth_units_per_m=None)
    raw = raw or open_classic(listed, log) or open_raw(listed, log)
    recording = Recording(raw, mends=mends, log=log)
    try:
        recording.check_mends()
    except SlamcliError:
        recording.raw.__exit__(None, None, None)
        raise
    return recording


class Recording:
    """A recording that is open for reading; a context manager.

    Within a topic measurements come as they were recorded. Stamps that run backwards or repeat are counted in the log
    and kept; stamps that are unset (0) are replaced by the log time, said aloud.
    """

    def __init__(self, raw: RawReader, *, mends: Mends, log: RunLog) -> None:
        self.raw = raw
        self.mends = mends
        self.log = log
        self._frames: FrameTree | None = None
        self._told_damage = False

    @property
    def contents(self) -> Contents:
        """What lies in the container."""
        return self.raw.contents

    @property
    def name(self) -> str:
        """Name of the first file, for messages."""
        return self.contents.paths[0].name if self.contents.paths else "recording"

    @property
    def start_ns(self) -> int:
        """Log time of the first message, 0 for an empty recording."""
        return self.contents.start_ns or 0

    @property
    def end_ns(self) -> int:
        """Log time of the last message, 0 for an empty recording."""
        return self.contents.end_ns or 0

    def topics(self, kind: type) -> tuple[Topic, ...]:
        """Return the topics that decode to a measurement type, in the order of the container."""
        msgtypes = msgtypes_of(kind)
        return tuple(topic for topic in self.contents.topics if topic.msgtype in msgtypes)

    def topic(self, name: str, kind: type | None = None) -> Topic:
        """Return a topic by name (a leading slash may be left out), checked to decode to `kind`.

        Raises
        ------
        RecordingError
            If there is no such topic, it is empty, or its type does not fit; the message names the topics that would.
        """
        # Two types under one name: the one that fits, else the first.
        listed = sorted(self.contents.topics, key=lambda topic: kind is None or topic.msgtype in msgtypes_of(kind))
        known = {topic.name: topic for topic in listed}
        topic = known.get(name) or known.get(f"/{name}") or known.get(name.lstrip("/"))
        if topic is None:
            raise RecordingError(f"{self.name}: no topic {name!r}; {self._would_fit(name, kind)}")
        adapter = adapter_for(topic.msgtype)
        if adapter is None or (kind is not None and adapter.produces is not kind):
            wanted = f", not {kind.__name__}" if kind is not None else ", which slamcli does not decode"
            raise RecordingError(
                f"{self.name}: topic {topic.name} is {short_type(topic.msgtype)}{wanted}; {self._would_fit(name, kind)}"
            )
        if topic.count == 0:
            raise RecordingError(f"{self.name}: topic {topic.name} is empty; {self._would_fit(name, kind)}")
        return topic

    def measurements(
        self,
        topics: Iterable[str | Topic],
        *,
        start_s: float | None = None,
        duration_s: float | None = None,
        log_order: bool = False,
        log: RunLog | None = None,
    ) -> Iterator[Any]:
        """Return an iterator over the measurements of topics, merged by header stamp with constant memory.

        Parameters
        ----------
        topics
            Topics, or their names.
        start_s, duration_s
            Part of the recording, in seconds of log time from its start; found by seeking.
        log_order
            Keep the order in which messages were recorded instead of merging by stamp.
        log
            Takes what is to be said of these messages, where they are read on another thread; None: the recording's.

        Raises
        ------
        RecordingError
            If a topic is missing, empty or of a type that is not decoded.
        UsageError
            If the part lies outside of the recording.
        """
        chosen = [self.topic(topic if isinstance(topic, str) else topic.name) for topic in topics]
        start_ns, stop_ns = self.window(start_s, duration_s)
        return self._stream(
            {topic.name: TopicDecoder(topic, self.raw, self.mends, log or self.log) for topic in chosen},
            start_ns,
            stop_ns,
            log_order,
            log or self.log,
        )

    def frames(self) -> FrameTree:
        """Return the tree of all transforms in the recording, the mends among them; read once, then kept."""
        if self._frames is None:
            self._frames = read_frames(self)
        return self._frames

    def window(self, start_s: float | None, duration_s: float | None) -> tuple[int | None, int | None]:
        """Return the log times (from, before) of a part of the recording, None for its own limits.

        Raises
        ------
        UsageError
            If the part is empty.
        """
        length_s = (self.end_ns - self.start_ns) / 1e9
        if start_s is not None and not 0 <= start_s <= length_s:
            raise UsageError(f"--start {start_s:g}: {self.name} lasts {length_s:.1f} s")
        if duration_s is not None and not duration_s > 0:
            raise UsageError(f"--duration {duration_s:g}: must be more than 0 s")
        first = self.start_ns + round((start_s or 0.0) * 1e9)
        start_ns = None if start_s is None else first
        stop_ns = None if duration_s is None or duration_s > 1e9 else first + round(duration_s * 1e9)
        return start_ns, stop_ns

    def check_mends(self) -> None:
        """Check that the topics that the mends name are there.

        Raises
        ------
        RecordingError
            If one is not.
        """
        known = {topic.name for topic in self.contents.topics}
        for option, names in (
            ("--time-offset", self.mends.time_offsets_ns),
            ("--camera-info", self.mends.camera_models),
        ):
            for name in names:
                if name and name not in known and not self.mends.shared:
                    raise RecordingError(
                        f"{option} {name}: {self.name} has no such topic; {self._would_fit(name, None)}"
                    )

    def unused_mends(self) -> tuple[str, ...]:
        """Return the renamings of frames that nothing that was read so far named."""
        return tuple(
            f"--rename-frame {old}={new}"
            for old, new in self.mends.renamed_frames.items()
            if not self.log.counts[renaming(old, new)]
        )

    def _stream(
        self, decoders: dict[str, TopicDecoder], start_ns: int | None, stop_ns: int | None, log_order: bool, log: RunLog
    ) -> Iterator[Any]:
        raw = self.raw.messages(tuple(decoders), start_ns, stop_ns)
        stamped = ((decoders[m.topic].stamp_ns(m), m) for m in raw if decoders[m.topic].accepts(m))
        ordered = stamped if log_order or len(decoders) == 1 else merge_by_stamp(stamped)
        for stamp_ns, message in ordered:
            yield from decoders[message.topic].decode(message, stamp_ns)
        # Not where the caller stops early: a look at the first scans is not what the figures are about.
        for decoder in decoders.values():
            decoder.tell()
        for damage in self.contents.damage:
            log.warn(damage)

    def _would_fit(self, name: str, kind: type | None) -> str:
        """Return which topics could have been meant."""
        fitting = [
            topic
            for topic in self.contents.topics
            if topic.count != 0
            and (topic.msgtype in msgtypes_of(kind) if kind is not None else adapter_for(topic.msgtype) is not None)
        ]
        if not fitting:
            what = "usable" if kind is None else " or ".join(short_type(msgtype) for msgtype in msgtypes_of(kind))
            held = ", ".join(f"{topic.name} ({short_type(topic.msgtype)})" for topic in self.contents.topics[:12])
            return f"the recording has no {what} topic (it has {held or 'no topics at all'})"
        near = difflib.get_close_matches(name, [topic.name for topic in fitting], n=1, cutoff=0.75)
        listed = ", ".join(f"{topic.name} ({short_type(topic.msgtype)})" for topic in fitting[:12])
        meant = f"did you mean {near[0]}? " if near else ""
        return f"{meant}it could be one of: {listed}"

    def __enter__(self) -> Self:
        self.raw.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.raw.__exit__(kind, error, trace)
        for unused in self.unused_mends() if error is None and not self.mends.shared else ():
            self.log.warn(f"{unused} changed nothing: no message that was read names that frame")
