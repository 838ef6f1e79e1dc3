# SPDX-License-Identifier: MIT
"""sensor_msgs/CameraInfo."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from slamcli.measurements import CameraModel
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[CameraModel]:
    frame_id = context.frame(message.header.frame_id)
    given = context.mends.camera_models.get(context.topic) or context.mends.camera_models.get("")
    if given is not None:
        return (replace(given, stamp_ns=stamp_ns, frame_id=frame_id, topic=context.topic),)
    ros1 = hasattr(message, "K")
    d, k, r, p = (getattr(message, name if ros1 else name.lower()) for name in "DKRP")
    model = CameraModel(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        width=int(message.width),
        height=int(message.height),
        distortion_model=message.distortion_model,
        distortion=np.array(d, dtype=np.float64),
        intrinsics=np.array(k, dtype=np.float64).reshape(3, 3),
        rectification=np.array(r, dtype=np.float64).reshape(3, 3),
        projection=np.array(p, dtype=np.float64).reshape(3, 4),
        topic=context.topic,
    )
    return (model,)


def _encode(model: CameraModel, messages: MessageFactory) -> Any:
    return messages.make(
        "sensor_msgs/msg/CameraInfo",
        messages.header(model.stamp_ns, model.frame_id),
        model.height,
        model.width,
        model.distortion_model,
        np.asarray(model.distortion, dtype=np.float64),
        np.asarray(model.intrinsics, dtype=np.float64).reshape(9),
        np.asarray(model.rectification, dtype=np.float64).reshape(9),
        np.asarray(model.projection, dtype=np.float64).reshape(12),
        0,
        0,
        messages.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False),
    )


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/CameraInfo",), produces=CameraModel, decode=_decode, encode=_encode)
