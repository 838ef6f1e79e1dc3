# SPDX-License-Identifier: MIT
"""What a session ends with, in the frames of the robot."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import PointCloud
from slamcli.orbslam3.frame_making import FrameMaker
from slamcli.orbslam3.frame_track import final_pose
from slamcli.orbslam3.session import Session
from slamcli.trajectory import Trajectory

_UPRIGHT = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Pose of an optical frame (z ahead, y down) in a frame with x ahead and z up (REP 103)."""


def result_of(session: Session, maker: FrameMaker, setup: Setup, stamps_ns: list[int]) -> MappingResult:
    """Return trajectory, keyframes and points of the largest map of a session.

    Raises
    ------
    EstimationError
        If no frame was tracked.
    """
    frames = Counter(frame.map_number for frame in session.tracked)
    if not frames:
        raise EstimationError("no frame could be tracked: " + _why(session))
    chosen = min(frames, key=lambda number: (-frames[number], number))
    sparse_map = session.maps[chosen]
    T_base_camera = maker.preparation.T_base_camera
    gravity = session.inertial.gravity(sparse_map) if session.inertial is not None else None
    T_map_start = _start(T_base_camera, gravity, upright=maker.preparation.rig.base_is_upright)
    poses = sparse_map.poses_of_all()
    tracked = [frame for frame in session.tracked if frame.map_number == chosen]
    T_camera = np.array([final_pose(sparse_map, poses, frame, refine=True) for frame in tracked])
    T_map_base = T_map_start @ se3.inverse(T_camera) @ se3.inverse(T_base_camera)
    living = sparse_map.living_keyframes
    alive = np.flatnonzero(sparse_map.point_alive)
    points = sparse_map.positions[alive] @ T_map_start[:3, :3].T + T_map_start[:3, 3]
    return MappingResult(
        trajectory=_trajectory(np.array([stamps_ns[frame.number] for frame in tracked]), T_map_base, setup),
        keyframes=_trajectory(
            sparse_map.stamp_ns[living], T_map_start @ se3.inverse(poses[living]) @ se3.inverse(T_base_camera), setup
        ),
        cloud=PointCloud(
            stamp_ns=stamps_ns[tracked[0].number], frame_id=setup.map_frame, points_m=points.astype(np.float32)
        ),
        summary={
            "frames": len(stamps_ns), "tracked": len(tracked), "maps": len(frames), "keyframes": len(living), "points": len(alive),
            **dict(sorted(session.counts.items())),
        },
    )  # fmt: skip


def _start(
    T_base_camera: NDArray[np.float64], gravity: NDArray[np.float64] | None, *, upright: bool
) -> NDArray[np.float64]:
    """Return the pose of the session's first camera in a map whose z points up.

    `gravity` (3,), pointing down in the camera's frame, says what is up where an IMU found it; the base is at the origin then,
    and its x axis (z, should that stand upright) points ahead.
    """
    if gravity is None:
        return T_base_camera if upright else _UPRIGHT
    down = T_base_camera[:3, :3] @ gravity
    up = -down / np.linalg.norm(down)
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    ahead -= (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    T_map_base = np.eye(4)
    T_map_base[:3, :3] = np.stack([ahead, np.cross(up, ahead), up])
    return np.asarray(T_map_base @ T_base_camera)


def _trajectory(stamps_ns: NDArray[np.int64], T_map_base: NDArray[np.float64], setup: Setup) -> Trajectory:
    positions, quats = se3.to_position_quaternion(T_map_base)
    return Trajectory(stamps_ns, positions, quats, frame_id=setup.map_frame, child_frame_id=setup.base_frame)


def _why(session: Session) -> str:
    """Return what is the likely cause."""
    frames = session.num_frames
    return (
        f"of {frames} frames none had enough features that match the next one's"
        if frames
        else "the recording has no frames"
    )
