# SPDX-License-Identifier: MIT
"""Measurements to a recording."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from slamcli.errors import RecordingError
from slamcli.measurements import FrameTransform
from slamcli.recordings.adapters import encoder_for, message_factory
from slamcli.recordings.adapters.tf_message import encode_transforms, is_static_topic
from slamcli.recordings.raw import RawMessage, RawWriter, Topic


def create_recording(
    path: str | os.PathLike[str], *, format: str | None = None, compression: str | None = None,
    latched: Collection[str] = (),
) -> RecordingWriter:  # fmt: skip
    """Begin a recording; `path` says its format (``.bag`` ROS 1, ``.mcap``, ``.db3`` or a folder ROS 2).

    Topics in `latched` keep their last message for who listens later (``transient_local`` in ROS 2); static transforms and
    occupancy grids always do.

    Raises
    ------
    UsageError, RecordingError
        If the format is unknown or the path cannot be written.
    """
    from slamcli.recordings.containers import create_raw

    ros1 = format == "rosbag1" if format is not None else Path(path).suffix.lower() == ".bag"
    return RecordingWriter(
        create_raw(Path(path), format=format, compression=compression), "ros1" if ros1 else "cdr", latched
    )


class RecordingWriter:
    """Writes measurements as messages; a context manager that leaves the whole recording or none.

    A topic takes the type of the first measurement that is written to it.
    """

    def __init__(self, raw: RawWriter, encoding: str, latched: Collection[str] = ()) -> None:
        self._raw = raw
        self._latched = frozenset(latched)
        self._messages = message_factory(encoding)
        self._msgtypes: dict[str, str] = {}
        self._last_log_time_ns = 0

    @property
    def ros1(self) -> bool:
        """Whether messages are those of ROS 1."""
        return self._messages.ros1

    def write(
        self, topic: str, measurement: Any, *, log_time_ns: int | None = None, msgtype: str | None = None
    ) -> None:
        """Append a measurement.

        Parameters
        ----------
        log_time_ns
            When it was recorded; its stamp where none is given (the time of the last message where that is 0 too).
        msgtype
            Message type where the measurement can be written as several (``sensor_msgs/msg/CompressedImage``).

        Raises
        ------
        RecordingError
            If the measurement cannot be written as a message, or not to this topic.
        """
        adapter = encoder_for(measurement, msgtype)
        self._append(
            topic,
            msgtype or adapter.msgtypes[0],
            adapter.encode(measurement, self._messages),
            measurement.stamp_ns if log_time_ns is None else log_time_ns,
        )

    def write_transforms(
        self, topic: str, transforms: Sequence[FrameTransform], *, log_time_ns: int | None = None
    ) -> None:
        """Append several transforms as one message."""
        if transforms:
            log_time_ns = transforms[0].stamp_ns if log_time_ns is None else log_time_ns
            self._append(topic, "tf2_msgs/msg/TFMessage", encode_transforms(transforms, self._messages), log_time_ns)

    def _append(self, topic: str, msgtype: str, message: Any, log_time_ns: int) -> None:
        declared = self._msgtypes.get(topic)
        if declared is None:
            self._raw.add_topic(
                Topic(
                    name=topic,
                    msgtype=msgtype,
                    count=None,
                    definition=self._messages.definition(msgtype),
                    encoding=self._messages.encoding,
                    latched=is_static_topic(topic) or topic in self._latched or msgtype == "nav_msgs/msg/OccupancyGrid",
                )
            )
            self._msgtypes[topic] = msgtype
        elif declared != msgtype:
            raise RecordingError(f"topic {topic} holds {declared}: {msgtype} cannot be written to it")
        self._last_log_time_ns = log_time_ns if log_time_ns > 0 else self._last_log_time_ns
        data = self._messages.serialise(message, msgtype)
        self._raw.write(RawMessage(topic, self._last_log_time_ns, data))

    def __enter__(self) -> Self:
        self._raw.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._raw.__exit__(kind, error, trace)
