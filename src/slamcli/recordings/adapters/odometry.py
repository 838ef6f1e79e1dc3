# SPDX-License-Identifier: MIT
"""nav_msgs/Odometry."""

from __future__ import annotations

from typing import Any

from slamcli.measurements import Odometry
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory, covariance36, covariance66


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[Odometry]:
    pose, twist = message.pose.pose, message.twist.twist
    odometry = Odometry(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        child_frame_id=context.frame(message.child_frame_id),
        position_m=vector(pose.position),
        quat_xyzw=context.quaternion(pose.orientation),
        covariance=covariance66(message.pose.covariance),
        linear_m_s=vector(twist.linear),
        angular_rad_s=vector(twist.angular),
        topic=context.topic,
    )
    return (odometry,)


def _encode(odometry: Odometry, messages: MessageFactory) -> Any:
    pose = messages.pose(odometry.position_m, odometry.quat_xyzw)
    twist = messages.twist(odometry.linear_m_s, odometry.angular_rad_s)
    return messages.make(
        "nav_msgs/msg/Odometry",
        messages.header(odometry.stamp_ns, odometry.frame_id),
        odometry.child_frame_id,
        messages.make("geometry_msgs/msg/PoseWithCovariance", pose, covariance36(odometry.covariance)),
        messages.make("geometry_msgs/msg/TwistWithCovariance", twist, covariance36(None)),
    )


ADAPTER = Adapter(msgtypes=("nav_msgs/msg/Odometry",), produces=Odometry, decode=_decode, encode=_encode)
