# SPDX-License-Identifier: MIT
"""Odometry of the base frame: from transforms, or from a topic that may describe another frame of the robot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.measurements import Odometry
from slamcli.recordings import Recording
from slamcli.recordings.odometry_pick import OdometryPick
from slamcli.recordings.odometry_track import odometry_transforms, read_odometry


def odometry_from_tf(
    recording: Recording, pick: OdometryPick, *, spatial: bool, start_s: float | None, duration_s: float | None
) -> Iterator[Odometry]:
    """Yield the odometry that the transforms hold in the order of its stamps: its planar part unless `spatial`.

    Raises
    ------
    RecordingError
        If this part of the recording holds none.
    """
    if spatial:
        stamps, transforms = odometry_transforms(recording, pick, start_s=start_s, duration_s=duration_s)
        for stamp, T_odom_base in zip(stamps.tolist(), transforms, strict=True):
            yield _odometry(pick, stamp, *se3.to_position_quaternion(T_odom_base))
        return
    track = read_odometry(recording, pick, start_s=start_s, duration_s=duration_s)
    if track is None:
        return
    half = track.poses[:, 2] / 2
    for stamp, pose, sine, cosine in zip(
        track.stamps_ns.tolist(), track.poses, np.sin(half), np.cos(half), strict=True
    ):
        yield _odometry(pick, stamp, np.array([pose[0], pose[1], 0.0]), np.array([0.0, 0.0, sine, cosine]))


def _odometry(
    pick: OdometryPick, stamp_ns: int, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]
) -> Odometry:
    return Odometry(
        stamp_ns=stamp_ns,
        frame_id=pick.odom_frame,
        child_frame_id=pick.base_frame,
        position_m=position_m,
        quat_xyzw=quat_xyzw,
    )


def moved_to(recording: Recording, pick: OdometryPick) -> Callable[[Odometry], Odometry]:
    """Return what turns a message of the odometry's topic into odometry of the base frame."""
    child, base, tree = pick.odom_child_frame, pick.base_frame, recording.frames()
    if child == base or not tree.connected(child, base):
        return lambda odometry: odometry
    T_child_base = tree.lookup(child, base)
    return lambda odometry: _moved(odometry, T_child_base)


def _moved(odometry: Odometry, T_child_base: NDArray[np.float64]) -> Odometry:
    """Return the odometry of a frame that is fixed to the child frame."""
    T_odom_base = se3.from_position_quaternion(odometry.position_m, odometry.quat_xyzw) @ T_child_base
    position, quat = se3.to_position_quaternion(T_odom_base)
    return replace(odometry, position_m=position, quat_xyzw=quat)
