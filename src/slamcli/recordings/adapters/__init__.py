# SPDX-License-Identifier: MIT
"""Adapters between ROS messages and measurements: one file per message type and one line in `ADAPTERS`."""

from __future__ import annotations

from typing import Any

from slamcli.errors import RecordingError
from slamcli.recordings.adapters import (
    camera_info,
    compressed_image,
    image,
    imu,
    landmark_list,
    laser_scan,
    log_line,
    marker_array,
    multi_echo_laser_scan,
    nav_sat_fix,
    number,
    occupancy_grid,
    odometry,
    path,
    point_cloud2,
    pose_array,
    pose_stamped,
    pose_with_covariance_stamped,
    text,
    tf_message,
    transform_stamped,
    twist,
    twist_stamped,
)
from slamcli.recordings.adapters.adapter import Adapter, Encoder
from slamcli.recordings.adapters.compressed_image import ImageFile
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.log_line import LogLine
from slamcli.recordings.adapters.marker_array import Marker, StampedMarkers
from slamcli.recordings.adapters.messages import MessageFactory, message_factory
from slamcli.recordings.adapters.number import StampedNumber
from slamcli.recordings.adapters.occupancy_grid import StampedGrid
from slamcli.recordings.adapters.path import StampedPath
from slamcli.recordings.adapters.pose_array import StampedPoses
from slamcli.recordings.adapters.text import StampedText

# The first adapter that produces a measurement type also writes it, unless another message type is asked for.
ADAPTERS: tuple[Adapter, ...] = (
    laser_scan.ADAPTER,
    multi_echo_laser_scan.ADAPTER,
    point_cloud2.ADAPTER,
    imu.ADAPTER,
    image.ADAPTER,
    compressed_image.ADAPTER,
    camera_info.ADAPTER,
    odometry.ADAPTER,
    pose_stamped.ADAPTER,
    pose_with_covariance_stamped.ADAPTER,
    twist_stamped.ADAPTER,
    twist.ADAPTER,
    tf_message.ADAPTER,
    transform_stamped.ADAPTER,
    occupancy_grid.ADAPTER,
    path.ADAPTER,
    pose_array.ADAPTER,
    text.ADAPTER,
    nav_sat_fix.ADAPTER,
    landmark_list.ADAPTER,
)

_ENCODERS: tuple[Encoder, ...] = (
    *ADAPTERS,
    marker_array.ENCODER,
    compressed_image.FILE_ENCODER,
    log_line.ENCODER,
    number.ENCODER,
)
_BY_MSGTYPE: dict[str, Adapter] = {msgtype: adapter for adapter in ADAPTERS for msgtype in adapter.msgtypes}


def adapter_for(msgtype: str) -> Adapter | None:
    """Return the adapter of a message type, None if there is none."""
    return _BY_MSGTYPE.get(msgtype)


def msgtypes_of(kind: type) -> tuple[str, ...]:
    """Return the message types that decode to a measurement type (exactly that type, not one derived from it)."""
    return tuple(msgtype for msgtype, adapter in _BY_MSGTYPE.items() if adapter.produces is kind)


def encoder_for(measurement: Any, msgtype: str | None = None) -> Encoder:
    """Return what writes a measurement, as `msgtype` where one is named.

    Raises
    ------
    RecordingError
        If no adapter writes this measurement, or not as that message type.
    """
    fitting = [adapter for adapter in _ENCODERS if adapter.produces is type(measurement)]
    for adapter in fitting:
        if msgtype is None or msgtype in adapter.msgtypes:
            return adapter
    can = ", ".join(name for adapter in fitting for name in adapter.msgtypes[:1]) or "no message type"
    wanted = f" as {msgtype}" if msgtype else ""
    raise RecordingError(f"cannot write {type(measurement).__name__}{wanted}: it can be written as {can}")


__all__ = [
    "ADAPTERS",
    "Adapter",
    "DecodeContext",
    "Encoder",
    "ImageFile",
    "LogLine",
    "Marker",
    "MessageFactory",
    "StampedGrid",
    "StampedMarkers",
    "StampedNumber",
    "StampedPath",
    "StampedPoses",
    "StampedText",
    "adapter_for",
    "encoder_for",
    "message_factory",
    "msgtypes_of",
]
