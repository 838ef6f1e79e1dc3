# SPDX-License-Identifier: MIT
"""nav_msgs/OccupancyGrid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.errors import DataError
from slamcli.geometry import quaternion
from slamcli.grids import OccupancyGrid
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedGrid:
    """An occupancy grid as it stood at one time."""

    stamp_ns: int
    grid: OccupancyGrid
    topic: str = ""


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[StampedGrid]:
    info = message.info
    height, width = int(info.height), int(info.width)
    cells = np.array(message.data, dtype=np.int8)
    if len(cells) != height * width:
        raise DataError(f"occupancy grid of {width} x {height} cells with {len(cells)} values")
    grid = OccupancyGrid(
        cells=cells.reshape(height, width),
        resolution_m=float(np.format_float_positional(np.float32(info.resolution), unique=True)),
        origin=(
            float(info.origin.position.x),
            float(info.origin.position.y),
            float(quaternion.yaw(context.quaternion(info.origin.orientation))),
        ),
        frame_id=context.frame(message.header.frame_id),
    )
    return (StampedGrid(stamp_ns=stamp_ns, grid=grid, topic=context.topic),)


def _encode(stamped: StampedGrid, messages: MessageFactory) -> Any:
    grid = stamped.grid
    x, y, yaw = grid.origin
    origin = messages.pose(np.array([x, y, 0.0]), np.array([0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]))
    return messages.make(
        "nav_msgs/msg/OccupancyGrid",
        messages.header(stamped.stamp_ns, grid.frame_id),
        messages.make(
            "nav_msgs/msg/MapMetaData",
            messages.time(stamped.stamp_ns),
            float(grid.resolution_m),
            grid.width,
            grid.height,
            origin,
        ),
        np.ascontiguousarray(grid.cells).reshape(-1),
    )


ADAPTER = Adapter(msgtypes=("nav_msgs/msg/OccupancyGrid",), produces=StampedGrid, decode=_decode, encode=_encode)
