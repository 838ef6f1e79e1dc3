# SPDX-License-Identifier: MIT
"""Trajectories projected into a plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slamcli.errors import UsageError
from slamcli.geometry import quaternion
from slamcli.trajectory import Trajectory

_NORMAL = {"xy": 2, "xz": 1, "yz": 0}


def project(trajectory: Trajectory, plane: str) -> Trajectory:
    """Return a trajectory projected into one of the planes ``xy``, ``xz``, ``yz``.

    The coordinate along the plane's normal becomes zero, and of the orientation the angle about the normal stays (of
    roll, pitch, yaw about fixed axes).

    Raises
    ------
    UsageError
        If there is no such plane.
    """
    if plane not in _NORMAL:
        raise UsageError(f"no plane {plane!r}: there are {', '.join(_NORMAL)}")
    axis = _NORMAL[plane]
    poses = np.array(trajectory.transforms)
    poses[:, axis, 3] = 0.0
    vectors = np.zeros((len(poses), 3))
    vectors[:, axis] = _fixed_axis_angle(poses[:, :3, :3], axis)
    poses[:, :3, :3] = Rotation.from_rotvec(vectors).as_matrix()
    return replace(
        trajectory,
        positions_m=poses[:, :3, 3].copy(),
        quats_xyzw=quaternion.from_matrix(poses[:, :3, :3]),
        matrices=poses,
    )


def _fixed_axis_angle(rotations: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return roll (0), pitch (1) or yaw (2) of ``Rz(yaw) Ry(pitch) Rx(roll)``; yaw is 0 where it is one with roll."""
    level = np.hypot(rotations[:, 0, 0], rotations[:, 1, 0])
    upright = level < 4 * np.finfo(np.float64).eps
    if axis == 1:
        return np.arctan2(-rotations[:, 2, 0], level)
    if axis == 2:
        return np.where(upright, 0.0, np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]))
    roll = np.arctan2(rotations[:, 2, 1], rotations[:, 2, 2])
    return np.where(upright, np.arctan2(-rotations[:, 1, 2], rotations[:, 1, 1]), roll)
