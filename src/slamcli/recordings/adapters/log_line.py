# SPDX-License-Identifier: MIT
"""rcl_interfaces/Log (ROS 2) and rosgraph_msgs/Log (ROS 1): what nodes say on /rosout; written only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from slamcli.recordings.adapters.adapter import Encoder
from slamcli.recordings.adapters.messages import MessageFactory

_ROS2, _ROS1 = "rcl_interfaces/msg/Log", "rosgraph_msgs/msg/Log"
_LEVELS = {"info": (20, 2), "warning": (30, 4)}
"""In ROS 2 and in ROS 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogLine:
    """What was said at one time."""

    stamp_ns: int
    level: Literal["info", "warning"]
    name: str
    """Of the node."""
    text: str
    topic: str = ""

    @staticmethod
    def msgtype(*, ros1: bool) -> str:
        """Return the message type of either ROS."""
        return _ROS1 if ros1 else _ROS2


def _encode(line: LogLine, messages: MessageFactory) -> Any:
    level = _LEVELS[line.level][1 if messages.ros1 else 0]
    rest = (level, line.name, line.text, "", "", 0)
    if messages.ros1:
        return messages.make(_ROS1, messages.header(line.stamp_ns, ""), *rest, [])
    return messages.make(_ROS2, messages.time(line.stamp_ns), *rest)


ENCODER = Encoder(msgtypes=(_ROS2, _ROS1), produces=LogLine, encode=_encode)
