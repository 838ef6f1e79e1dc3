# SPDX-License-Identifier: MIT
"""cartographer_ros_msgs/LandmarkList."""

from __future__ import annotations

from typing import Any

from slamcli.measurements import LandmarkObservation, Landmarks
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[Landmarks]:
    # The field was called `landmark` at first (cartographer_ros before 1.0).
    entries = message.landmarks if hasattr(message, "landmarks") else message.landmark
    observations = tuple(
        LandmarkObservation(
            id=entry.id,
            position_m=vector(entry.tracking_from_landmark_transform.position),
            quat_xyzw=context.quaternion(entry.tracking_from_landmark_transform.orientation),
            translation_weight=float(entry.translation_weight),
            rotation_weight=float(entry.rotation_weight),
        )
        for entry in entries
    )
    frame = context.frame(message.header.frame_id)
    return (Landmarks(stamp_ns=stamp_ns, frame_id=frame, observations=observations, topic=context.topic),)


def _encode(landmarks: Landmarks, messages: MessageFactory) -> Any:
    entries = [
        messages.make(
            "cartographer_ros_msgs/msg/LandmarkEntry",
            seen.id,
            messages.pose(seen.position_m, seen.quat_xyzw),
            float(seen.translation_weight),
            float(seen.rotation_weight),
        )
        for seen in landmarks.observations
    ]
    header = messages.header(landmarks.stamp_ns, landmarks.frame_id)
    return messages.make("cartographer_ros_msgs/msg/LandmarkList", header, entries)


ADAPTER = Adapter(
    msgtypes=("cartographer_ros_msgs/msg/LandmarkList",), produces=Landmarks, decode=_decode, encode=_encode
)
