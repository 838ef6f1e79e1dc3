# SPDX-License-Identifier: MIT
"""nav_msgs/Path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext, vector
from slamcli.recordings.adapters.messages import MessageFactory
from slamcli.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedPath:
    """A path (planned or driven) as it stood at one time."""

    stamp_ns: int
    path: Trajectory
    topic: str = ""


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[StampedPath]:
    poses = message.poses
    path = Trajectory(
        # Planned paths often carry no stamps of their own: then the path's.
        stamps_ns=np.array([context.stamp_ns(pose.header.stamp, stamp_ns) for pose in poses], dtype=np.int64),
        positions_m=np.array([vector(pose.pose.position) for pose in poses]).reshape(-1, 3),
        quats_xyzw=np.array([context.quaternion(pose.pose.orientation) for pose in poses]).reshape(-1, 4),
        frame_id=context.frame(message.header.frame_id),
    )
    return (StampedPath(stamp_ns=stamp_ns, path=path, topic=context.topic),)


def _encode(stamped: StampedPath, messages: MessageFactory) -> Any:
    path = stamped.path
    stamps = path.stamps_ns.tolist()
    headers = {
        stamp_ns: messages.header(stamp_ns, path.frame_id) for stamp_ns in dict.fromkeys(stamps)
    }  # of a plan: one
    poses = [
        messages.make("geometry_msgs/msg/PoseStamped", headers[stamp_ns], pose)
        for stamp_ns, pose in zip(stamps, messages.poses(path.positions_m, path.quats_xyzw), strict=True)
    ]
    return messages.make("nav_msgs/msg/Path", messages.header(stamped.stamp_ns, path.frame_id), poses)


ADAPTER = Adapter(msgtypes=("nav_msgs/msg/Path",), produces=StampedPath, decode=_decode, encode=_encode)
