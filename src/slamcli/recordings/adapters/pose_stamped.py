# SPDX-License-Identifier: MIT
"""geometry_msgs/PoseStamped."""

from __future__ import annotations

from typing import Any

from slamcli.measurements import StampedPose
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[StampedPose]:
    pose = StampedPose(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        position_m=vector(message.pose.position),
        quat_xyzw=context.quaternion(message.pose.orientation),
        topic=context.topic,
    )
    return (pose,)


def _encode(pose: StampedPose, messages: MessageFactory) -> Any:
    header = messages.header(pose.stamp_ns, pose.frame_id)
    return messages.make("geometry_msgs/msg/PoseStamped", header, messages.pose(pose.position_m, pose.quat_xyzw))


ADAPTER = Adapter(msgtypes=("geometry_msgs/msg/PoseStamped",), produces=StampedPose, decode=_decode, encode=_encode)
