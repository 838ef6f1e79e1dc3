# SPDX-License-Identifier: MIT
"""geometry_msgs/TransformStamped."""

from __future__ import annotations

from typing import Any

from slamcli.measurements import FrameTransform
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory


def decode_transform(message: Any, fallback_ns: int, context: DecodeContext, static: bool) -> FrameTransform:
    """Return one transform with its own stamp, or `fallback_ns` where that is unset."""
    return FrameTransform(
        stamp_ns=context.stamp_ns(message.header.stamp, fallback_ns),
        parent_frame_id=context.frame(message.header.frame_id),
        child_frame_id=context.frame(message.child_frame_id),
        position_m=vector(message.transform.translation),
        quat_xyzw=context.quaternion(message.transform.rotation),
        static=static,
        topic=context.topic,
    )


def encode_transform(transform: FrameTransform, messages: MessageFactory) -> Any:
    """Return the TransformStamped message of a transform."""
    return messages.make(
        "geometry_msgs/msg/TransformStamped",
        messages.header(transform.stamp_ns, transform.parent_frame_id),
        transform.child_frame_id,
        messages.transform(transform.position_m, transform.quat_xyzw),
    )


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[FrameTransform]:
    return (decode_transform(message, stamp_ns, context, static=False),)


ADAPTER = Adapter(
    msgtypes=("geometry_msgs/msg/TransformStamped",), produces=FrameTransform, decode=_decode, encode=encode_transform
)
