# SPDX-License-Identifier: MIT
"""geometry_msgs/PoseArray: many poses of one moment, such as the particles of a localiser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedPoses:
    """Poses without an order in time, as they stood at one time."""

    stamp_ns: int
    frame_id: str
    positions_m: NDArray[np.float64]
    """float64 (N, 3), metres; N may be 0."""
    quats_xyzw: NDArray[np.float64]
    """float64 (N, 4)."""
    topic: str = ""

    def __post_init__(self) -> None:
        n = len(self.positions_m)
        if self.positions_m.shape != (n, 3) or self.quats_xyzw.shape != (n, 4):
            raise DataError(f"poses: {self.positions_m.shape} positions, {self.quats_xyzw.shape} orientations")

    def __len__(self) -> int:
        return len(self.positions_m)


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[StampedPoses]:
    poses = message.poses
    stamped = StampedPoses(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        positions_m=np.array([vector(pose.position) for pose in poses]).reshape(-1, 3),
        quats_xyzw=np.array([context.quaternion(pose.orientation) for pose in poses]).reshape(-1, 4),
        topic=context.topic,
    )
    return (stamped,)


def _encode(stamped: StampedPoses, messages: MessageFactory) -> Any:
    poses = messages.poses(stamped.positions_m, stamped.quats_xyzw)
    return messages.make("geometry_msgs/msg/PoseArray", messages.header(stamped.stamp_ns, stamped.frame_id), poses)


ADAPTER = Adapter(msgtypes=("geometry_msgs/msg/PoseArray",), produces=StampedPoses, decode=_decode, encode=_encode)
