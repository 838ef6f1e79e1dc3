# SPDX-License-Identifier: MIT
"""Messages as they lie in a container, before anything is decoded: what every container reader and writer speaks."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One topic of a recording."""

    name: str
    msgtype: str
    """ROS 2 style whatever the container: ``sensor_msgs/msg/LaserScan``."""
    count: int | None
    """Number of messages; None where only reading everything would tell."""
    definition: str = ""
    """Message definition text as the container holds it, empty where it holds none."""
    encoding: str = "cdr"
    """``ros1`` or ``cdr``."""
    latched: bool = False
    qos: str = ""
    """QoS profiles as the container holds them (ROS 2), carried through conversions."""
    definition_format: str = "msg"
    """``msg`` or ``idl``, the language of `definition`; else MCAP's name of it, and `definition` is its bytes as latin-1."""
    digest: str = ""
    """MD5 sum (ROS 1) or RIHS01 hash (ROS 2) of the type as the container holds it, empty where it holds none."""
    publisher: str = ""
    """Name of the node that published it (ROS 1), empty where unknown or where there were several."""


class RawMessage(NamedTuple):
    """One message, undecoded.

    A tuple, because recordings hold millions of them. `data` is its own copy: keeping it keeps nothing else alive.
    """

    topic: str
    log_time_ns: int
    data: bytes | memoryview
    channel: int = -1
    """Index into `Contents.topics`; -1 where only the name is known (a name may stand there with two types)."""
    sequence: int = 0
    """The publisher's counter: MCAP's message sequence, ``Header.seq`` of ROS 1 where a conversion kept it."""
    publish_time_ns: int | None = None
    """When it was sent, where the container tells that apart from `log_time_ns`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """What a container says of itself without reading its messages."""

    paths: tuple[Path, ...]
    format: str
    """``rosbag1``, ``rosbag2-sqlite3``, ``rosbag2-mcap`` or ``mcap``."""
    size_bytes: int
    topics: tuple[Topic, ...]
    start_ns: int | None
    """Log time of the first message; None for an empty recording."""
    end_ns: int | None
    num_messages: int | None
    compression: str = "none"
    damage: tuple[str, ...] = field(default=())
    """Warnings on what could not be read and how much was lost; empty for a sound file."""


class RawReader(Protocol):
    """A recording's container, opened; a context manager."""

    @property
    def contents(self) -> Contents:
        """What lies in it (after reading to the end `damage` is complete)."""

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Yield messages in log order (stable: file order within equal times), from `start_ns` to before `stop_ns` by log time, by seeking."""

    def decode(self, message: RawMessage) -> Any:
        """Return the message as rosbags' decoded object."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class RawWriter(Protocol):
    """A container being written; a context manager that leaves the whole file or none."""

    def add_topic(self, topic: Topic) -> None:
        """Declare a topic before its first message."""

    def write(self, message: RawMessage) -> None:
        """Append a message that is encoded as its topic's `encoding` says."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
