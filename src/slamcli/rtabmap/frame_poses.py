# SPDX-License-Identifier: MIT
"""A pose in the map for every frame, from its pose by odometry and the poses in the graph of the nodes around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3

Floats = NDArray[np.float64]
_METRES_PER_RADIAN = 0.5
"""How much of drift a turn brings, next to a metre of way: only where drift lies between two nodes depends on it."""
_METRES_PER_SECOND = 1e-3
"""The same of time, so that a robot that stands has a way too."""


def frame_poses(
    stamps_ns: NDArray[np.int64], T_odom_frame: Floats, node_rows: NDArray[np.int64], T_map_node: Floats
) -> Floats:
    """Return the poses (F, 4, 4) in the map of frames of one stretch of odometry.

    Every frame is placed from the node before it and from the node after it, and lies between these two places by its share
    of the way between the nodes: what odometry lost between two nodes is spread along the way. Before the first node and
    after the last one only one of them counts.

    Parameters
    ----------
    stamps_ns
        int64 (F,), of the frames.
    T_odom_frame
        float64 (F, 4, 4), poses by odometry.
    node_rows
        int64 (N,), increasing: which frames became nodes; at least one.
    T_map_node
        float64 (N, 4, 4), their poses in the map.
    """
    corrections = T_map_node @ se3.inverse(T_odom_frame[node_rows])
    rows = np.arange(len(stamps_ns))
    after = np.searchsorted(node_rows, rows, side="left")
    first, last = np.clip(after - 1, 0, None), np.clip(after, None, len(node_rows) - 1)
    first = np.where(after < len(node_rows), first, last)
    ways = _ways(stamps_ns, T_odom_frame)
    begin, end = ways[node_rows[first]], ways[node_rows[last]]
    share = np.clip((ways - begin) / np.maximum(end - begin, 1e-12), 0.0, 1.0)
    share = np.where(first == last, 0.0, share)
    return between(corrections[first] @ T_odom_frame, corrections[last] @ T_odom_frame, share)


def between(T_map_a: Floats, T_map_b: Floats, share: Floats) -> Floats:
    """Return poses (F, 4, 4) `share` (F,) of the way from poses a to poses b, rotation and translation each by itself."""
    position_a, quat_a = se3.to_position_quaternion(T_map_a)
    position_b, quat_b = se3.to_position_quaternion(T_map_b)
    position = position_a + share[:, None] * (position_b - position_a)
    return se3.from_position_quaternion(position, quaternion.slerp(quat_a, quat_b, share))


def _ways(stamps_ns: NDArray[np.int64], T_odom_frame: Floats) -> Floats:
    """Return the way (F,) up to each frame, metres; turns and time count a little."""
    if len(stamps_ns) < 2:
        return np.zeros(len(stamps_ns))
    motions = se3.inverse(T_odom_frame[:-1]) @ T_odom_frame[1:]
    cosine = (np.trace(motions[:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0
    turns = np.arccos(np.clip(cosine, -1.0, 1.0))
    seconds = np.diff(stamps_ns) / 1e9
    steps = (
        np.linalg.norm(motions[:, :3, 3], axis=1) + _METRES_PER_RADIAN * turns + _METRES_PER_SECOND * np.abs(seconds)
    )
    return np.concatenate([[0.0], np.cumsum(steps)])
