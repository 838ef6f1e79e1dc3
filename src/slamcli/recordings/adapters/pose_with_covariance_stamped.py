# SPDX-License-Identifier: MIT
"""geometry_msgs/PoseWithCovarianceStamped."""

from __future__ import annotations

from typing import Any

from slamcli.measurements import StampedPose
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory, covariance36, covariance66


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[StampedPose]:
    pose = StampedPose(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        position_m=vector(message.pose.pose.position),
        quat_xyzw=context.quaternion(message.pose.pose.orientation),
        covariance=covariance66(message.pose.covariance),
        topic=context.topic,
    )
    return (pose,)


def _encode(pose: StampedPose, messages: MessageFactory) -> Any:
    return messages.make(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        messages.header(pose.stamp_ns, pose.frame_id),
        messages.make(
            "geometry_msgs/msg/PoseWithCovariance",
            messages.pose(pose.position_m, pose.quat_xyzw),
            covariance36(pose.covariance),
        ),
    )


ADAPTER = Adapter(
    msgtypes=("geometry_msgs/msg/PoseWithCovarianceStamped",), produces=StampedPose, decode=_decode, encode=_encode
)
