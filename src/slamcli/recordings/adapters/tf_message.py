# SPDX-License-Identifier: MIT
"""tf2_msgs/TFMessage and tf/tfMessage: any number of transforms in one message."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from slamcli.measurements import FrameTransform
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory
from slamcli.recordings.adapters.transform_stamped import decode_transform, encode_transform


def is_static_topic(topic: str) -> bool:
    """Return whether a topic of transforms is ``tf_static`` (of any name space)."""
    return topic.rstrip("/").rsplit("/", 1)[-1] == "tf_static"


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> list[FrameTransform]:
    static = is_static_topic(context.topic)
    return [decode_transform(transform, stamp_ns, context, static) for transform in message.transforms]


def encode_transforms(transforms: Sequence[FrameTransform], messages: MessageFactory) -> Any:
    """Return one TFMessage of several transforms."""
    return messages.make("tf2_msgs/msg/TFMessage", [encode_transform(transform, messages) for transform in transforms])


def _encode(transform: FrameTransform, messages: MessageFactory) -> Any:
    return encode_transforms((transform,), messages)


ADAPTER = Adapter(
    msgtypes=("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"),
    produces=FrameTransform,
    decode=_decode,
    encode=_encode,
    stamp_path="first",
)
