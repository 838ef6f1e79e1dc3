# SPDX-License-Identifier: MIT
"""std_msgs/String: words without a header, stamped with their log time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory


@dataclass(frozen=True, slots=True, kw_only=True)
class StampedText:
    """What was said at one time."""

    stamp_ns: int
    text: str
    topic: str = ""


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[StampedText]:
    return (StampedText(stamp_ns=stamp_ns, text=str(message.data), topic=context.topic),)


def _encode(stamped: StampedText, messages: MessageFactory) -> Any:
    return messages.make("std_msgs/msg/String", stamped.text)


ADAPTER = Adapter(
    msgtypes=("std_msgs/msg/String",), produces=StampedText, decode=_decode, encode=_encode, stamp_path="none"
)
