# SPDX-License-Identifier: MIT
"""Builds and serialises ROS messages for either encoding."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray


class MessageFactory:
    """Messages of one encoding (``ros1`` or ``cdr``), from rosbags' type stores.

    ROS 1 (Noetic) and ROS 2 (Humble) differ in a few fields (the header's sequence number, upper-case calibration
    matrices); adapters ask `ros1` where they must know.
    """

    def __init__(self, encoding: str) -> None:
        from rosbags.typesys import Stores, get_typestore

        from slamcli.recordings.extra_types import add_extra_types

        self.encoding = encoding
        self.ros1 = encoding == "ros1"
        self._store = add_extra_types(get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE))

    def make(self, msgtype: str, *values: Any) -> Any:
        """Return a message of `msgtype` with its fields in the order of the definition."""
        return self._store.types[msgtype](*values)

    def time(self, stamp_ns: int) -> Any:
        """Return a builtin_interfaces/Time; stamps before 1970 are not possible in ROS and become 0."""
        stamp_ns = max(int(stamp_ns), 0)
        return self.make("builtin_interfaces/msg/Time", stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Return a std_msgs/Header."""
        fields = (self.time(stamp_ns), frame_id)
        return self.make("std_msgs/msg/Header", 0, *fields) if self.ros1 else self.make("std_msgs/msg/Header", *fields)

    def vector(self, xyz: NDArray[np.float64]) -> Any:
        """Return a geometry_msgs/Vector3."""
        return self.make("geometry_msgs/msg/Vector3", *map(float, xyz))

    def quaternion(self, xyzw: NDArray[np.float64]) -> Any:
        """Return a geometry_msgs/Quaternion."""
        return self.make("geometry_msgs/msg/Quaternion", *map(float, xyzw))

    def pose(self, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]) -> Any:
        """Return a geometry_msgs/Pose."""
        point = self.make("geometry_msgs/msg/Point", *map(float, position_m))
        return self.make("geometry_msgs/msg/Pose", point, self.quaternion(quat_xyzw))

    def poses(self, positions_m: NDArray[np.float64], quats_xyzw: NDArray[np.float64]) -> list[Any]:
        """Return a geometry_msgs/Pose for each row of (N, 3) and (N, 4); of many, this is several times as fast as `pose`."""
        types = self._store.types
        point, turn, pose = (types[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion", "Pose"))
        rows = zip(
            np.asarray(positions_m, dtype=np.float64).tolist(), np.asarray(quats_xyzw, dtype=np.float64).tolist(), strict=True
        )  # fmt: skip
        return [pose(point(*xyz), turn(*xyzw)) for xyz, xyzw in rows]

    def transform(self, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]) -> Any:
        """Return a geometry_msgs/Transform."""
        return self.make("geometry_msgs/msg/Transform", self.vector(position_m), self.quaternion(quat_xyzw))

    def twist(self, linear: NDArray[np.float64], angular: NDArray[np.float64]) -> Any:
        """Return a geometry_msgs/Twist."""
        return self.make("geometry_msgs/msg/Twist", self.vector(linear), self.vector(angular))

    def serialise(self, message: Any, msgtype: str) -> memoryview:
        """Return the bytes of a message."""
        if self.ros1:
            return self._store.serialize_ros1(message, msgtype)
        return self._store.serialize_cdr(message, msgtype, little_endian=True)

    def deserialise(self, data: bytes | memoryview, msgtype: str) -> Any:
        """Return the message in bytes of this encoding."""
        if self.ros1:
            return self._store.deserialize_ros1(data, msgtype)
        return self._store.deserialize_cdr(data, msgtype)

    def definition(self, msgtype: str) -> str:
        """Return the full definition text as this encoding's bags hold it."""
        text, _ = self._store.generate_msgdef(msgtype, ros_version=1 if self.ros1 else 2)
        return text


@cache
def message_factory(encoding: str) -> MessageFactory:
    """Return the factory of an encoding."""
    return MessageFactory(encoding)


def covariance36(covariance: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return a 6 x 6 covariance as messages hold it, float64 (36,); zeros for none."""
    return np.zeros(36) if covariance is None else np.asarray(covariance, dtype=np.float64).reshape(36)


def covariance66(values: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return a message's covariance as float64 (6, 6), None where it is all zero (ROS: unknown)."""
    return np.array(values, dtype=np.float64).reshape(6, 6) if np.count_nonzero(values) else None
