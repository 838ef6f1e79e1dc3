# SPDX-License-Identifier: MIT
"""geometry_msgs/Twist: a velocity without a header, stamped with its log time."""

from __future__ import annotations

from typing import Any

from slamcli.measurements import StampedTwist
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[StampedTwist]:
    twist = StampedTwist(
        stamp_ns=stamp_ns,
        frame_id="",
        linear_m_s=vector(message.linear),
        angular_rad_s=vector(message.angular),
        topic=context.topic,
    )
    return (twist,)


def _encode(twist: StampedTwist, messages: MessageFactory) -> Any:
    return messages.twist(twist.linear_m_s, twist.angular_rad_s)


ADAPTER = Adapter(
    msgtypes=("geometry_msgs/msg/Twist",), produces=StampedTwist, decode=_decode, encode=_encode, stamp_path="none"
)
