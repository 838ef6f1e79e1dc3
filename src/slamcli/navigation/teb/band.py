# SPDX-License-Identifier: MIT
"""A timed elastic band: poses and the times between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.teb import _resize_kernels
from slamcli.navigation.teb.parameters import TebParameters, TrajectoryParameters

Array = NDArray[np.float64]
_LOOK_FOR_ROBOT_POSES = 10
_SHORTEST_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band:
    """Where the robot shall be, and how long it takes from each pose to the next."""

    poses: Array
    """float64 (N, 3), N >= 3, in odom: x, y (metres), yaw (radians)."""
    dts: Array
    """float64 (N - 1,), seconds, positive."""

    @property
    def duration_s(self) -> float:
        """The whole time."""
        return float(self.dts.sum())

    @property
    def times(self) -> Array:
        """float64 (N,): when it is at each pose, from 0."""
        return np.concatenate([[0.0], np.cumsum(self.dts)])


def band_along(path: Array, start: Array, goal: Array, parameters: TebParameters) -> Band:
    """Return a first band along a path, float64 (N, 2 or 3), N >= 2, whose ends are replaced by the poses `start` and `goal`.

    Headings are those of the path's poses if it has any and ``global_plan_overwrite_orientation`` is off, otherwise the
    direction to the next point; times are what the greatest speeds need.
    """
    trajectory, robot = parameters.trajectory, parameters.robot
    points = np.array(path[:, :2], dtype=np.float64)
    points[0], points[-1] = start[:2], goal[:2]
    steps = np.diff(points, axis=0)
    yaws = np.empty(len(points))
    if path.shape[1] == 3 and not trajectory.global_plan_overwrite_orientation:
        yaws[1:-1] = path[1:-1, 2]
    else:
        yaws[:-1] = np.arctan2(steps[:, 1], steps[:, 0])
        behind = (goal[:2] - start[:2]) @ np.array([np.cos(start[2]), np.sin(start[2])]) < 0.0
        if trajectory.allow_init_with_backwards_motion and behind:
            yaws += np.pi
    yaws[0], yaws[-1] = start[2], goal[2]
    poses = np.column_stack([points, yaws])
    while len(poses) < trajectory.min_samples:  # halve the last stretch
        middle = 0.5 * (poses[-2] + poses[-1])
        middle[2] = poses[-2, 2] + 0.5 * float(se2.wrap_angle(poses[-1, 2] - poses[-2, 2]))
        poses = np.vstack([poses[:-1], middle, poses[-1:]])
    steps = np.diff(poses, axis=0)
    turns = np.abs(se2.wrap_angle(steps[:, 2]))
    dts = np.maximum(np.hypot(steps[:, 0], steps[:, 1]) / robot.max_vel_x, turns / robot.max_vel_theta)
    return Band(poses=poses, dts=np.maximum(dts, _SHORTEST_S))


def warm_start(band: Band, start: Array, goal: Array, min_samples: int) -> Band:
    """Return a band without the poses that the robot has passed, from where it is now to a goal that has moved a little."""
    last = min(len(band.poses) - min_samples, _LOOK_FOR_ROBOT_POSES)
    squared = ((band.poses[: last + 1, :2] - start[:2]) ** 2).sum(axis=1)
    passed = 0
    while passed < last and squared[passed + 1] < squared[passed]:
        passed += 1
    poses = np.concatenate([band.poses[:1], band.poses[passed + 1 :]])
    poses[0], poses[-1] = start, goal
    return Band(poses=poses, dts=np.concatenate([band.dts[:1], band.dts[passed + 1 :]]))


def resized(band: Band, parameters: TrajectoryParameters, *, once: bool = False) -> Band:
    """Return the band with poses inserted and removed so that time steps are ``dt_ref`` +- ``dt_hysteresis``.

    once : bool
        Stop after one round, as the original does where no dynamic obstacles are expected.
    """
    room = max(parameters.max_samples, len(band.poses)) + 2
    poses, dts = np.empty((room, 3)), np.empty(room)
    num = len(band.poses)
    poses[:num], dts[: num - 1] = band.poses, band.dts
    num = _resize_kernels.resize(
        poses,
        dts,
        num,
        parameters.dt_ref,
        parameters.dt_hysteresis,
        parameters.min_samples,
        parameters.max_samples,
        once,
    )
    return Band(poses=poses[:num].copy(), dts=dts[: num - 1].copy())


def warm() -> None:
    """Compile the kernels of this module."""
    parameters = TebParameters()
    path = np.array([[0.0, 0.0], [2.0, 0.0]])
    resized(band_along(path, np.zeros(3), np.array([2.0, 0.0, 0.0]), parameters), parameters.trajectory)
