# SPDX-License-Identifier: MIT
"""std_msgs/Float64: one number without a header, stamped with its log time; written only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.recordings.adapters.adapter import Encoder
from slamcli.recordings.adapters.messages import MessageFactory


@dataclass(frozen=True, slots=True, kw_only=True)
class StampedNumber:
    """A figure as it stood at one time."""

    stamp_ns: int
    value: float
    topic: str = ""


def _encode(stamped: StampedNumber, messages: MessageFactory) -> Any:
    return messages.make("std_msgs/msg/Float64", float(stamped.value))


ENCODER = Encoder(msgtypes=("std_msgs/msg/Float64",), produces=StampedNumber, encode=_encode)
