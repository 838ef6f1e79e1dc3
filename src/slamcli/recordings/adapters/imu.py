# SPDX-License-Identifier: MIT
"""sensor_msgs/Imu."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamcli.measurements import ImuSample
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[ImuSample]:
    q = message.orientation
    # REP 145: orientation_covariance[0] is -1 where the device gives no orientation; drivers also send zeros or NaN.
    oriented = message.orientation_covariance[0] != -1.0 and 0.0 < abs(q.x) + abs(q.y) + abs(q.z) + abs(q.w) < 4.0
    sample = ImuSample(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        angular_rad_s=vector(message.angular_velocity),
        acceleration_m_s2=vector(message.linear_acceleration),
        quat_xyzw=context.quaternion(q) if oriented else None,
        topic=context.topic,
    )
    return (sample,)


def _encode(sample: ImuSample, messages: MessageFactory) -> Any:
    unknown = np.zeros(9)
    orientation_covariance = np.zeros(9)
    if sample.quat_xyzw is None:
        orientation_covariance[0] = -1.0
    return messages.make(
        "sensor_msgs/msg/Imu",
        messages.header(sample.stamp_ns, sample.frame_id),
        messages.quaternion(np.array([0.0, 0.0, 0.0, 1.0]) if sample.quat_xyzw is None else sample.quat_xyzw),
        orientation_covariance,
        messages.vector(sample.angular_rad_s),
        unknown,
        messages.vector(sample.acceleration_m_s2),
        unknown,
    )


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/Imu",), produces=ImuSample, decode=_decode, encode=_encode)
