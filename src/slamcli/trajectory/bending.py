# SPDX-License-Identifier: MIT
"""A pose for every scan from the motions between scans and the poses of some of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2

Pose = tuple[float, float, float]


def between_updates(
    motions: NDArray[np.float64], indices: NDArray[np.int64], path: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a pose (N, 3) for every scan: the motions (N, 3) from update to update, bent to pass through both ends.

    The difference at the end of a stretch is spread evenly over its scans. After the last update the motions lead on.
    """
    poses = np.empty((len(motions), 3))
    ends = [*indices[1:].tolist(), len(motions)]
    for a, (first, last) in enumerate(zip(indices.tolist(), ends, strict=True)):
        pose = as_pose(path[a])
        for k in range(first, last):
            if k > first:
                pose = compose(pose, motions[k])
            poses[k] = pose
        if a + 1 < len(indices):
            end = np.array(compose(pose, motions[last]))
            share = np.arange(last - first)[:, None] / (last - first)
            error = path[a + 1] - end
            error[2] = se2.wrap_angle(error[2])
            poses[first:last] += share * error
    poses[:, 2] = se2.wrap_angle(poses[:, 2])
    return poses


def led_back(poses: NDArray[np.float64], steps: NDArray[np.float64], first: int) -> NDArray[np.float64]:
    """Return poses (N, 3) in which the scans before `first`, which no update tells, are led back from it by the steps (N, 3)."""
    for k in range(first - 1, -1, -1):
        poses[k] = se2.compose(poses[k + 1], se2.inverse(steps[k + 1]))
    return poses


def moved_scans(
    poses: NDArray[np.float64], *, distance_m: float = 0.2, turn_rad: float = 0.1, every: bool = False
) -> NDArray[np.int64]:
    """Return the indices of `every` scan, or of those before which the robot moved or turned enough to see something new."""
    if every:
        return np.arange(len(poses))
    chosen, last = [0], poses[0]
    for k in range(1, len(poses)):
        dx, dy, turn = poses[k] - last
        if math.hypot(dx, dy) > distance_m or abs(math.remainder(turn, math.tau)) > turn_rad:
            chosen.append(k)
            last = poses[k]
    return np.array(chosen, dtype=np.int64)


def as_pose(row: NDArray[np.float64]) -> Pose:
    """Return a row x, y, yaw as a tuple of floats: scalars are faster than arrays of three."""
    return float(row[0]), float(row[1]), float(row[2])


def compose(pose: Pose, motion: NDArray[np.float64] | Pose) -> Pose:
    """Return the pose after a motion seen from it; the yaw is not wrapped."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return pose[0] + c * motion[0] - s * motion[1], pose[1] + s * motion[0] + c * motion[1], pose[2] + motion[2]
