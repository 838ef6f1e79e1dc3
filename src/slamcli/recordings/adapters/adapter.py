# SPDX-License-Identifier: MIT
"""What an adapter is: one message type to measurements, and back; and what is only written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoder:
    """A measurement to a message type."""

    msgtypes: tuple[str, ...]
    """ROS 2 style names; the first one is written."""
    produces: type
    """Type of the measurements."""
    encode: Callable[[Any, MessageFactory], Any]
    """Measurement to message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Adapter(Encoder):
    """One message type (or several of the same fields) to measurements, and back."""

    decode: Callable[[Any, int, DecodeContext], Sequence[Any]]
    """Message, its stamp (header stamp with the topic's offset, or the log time) and its topic to measurements."""
    stamp_path: str = "header"
    """Where the stamp lies: ``header`` (first field), ``first`` (header of the first element of a list) or ``none``."""
