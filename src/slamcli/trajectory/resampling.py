# SPDX-License-Identifier: MIT
"""Fewer poses, poses at other times, poses of a part of the time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.geometry import quaternion
from slamcli.trajectory.trajectory import Trajectory, seconds


def interpolate(trajectory: Trajectory, stamps_ns: ArrayLike, *, shift_s: float = 0.0) -> Trajectory:
    """Return the poses of a trajectory at other times: positions linearly, orientations by slerp.

    Parameters
    ----------
    trajectory
        At least two poses, in any order; of poses with one stamp the first counts.
    stamps_ns
        int64 (N,), nanoseconds, become the stamps of the result. Times outside of the trajectory get its first or last pose.
    shift_s
        Is added to `stamps_ns` to look into the trajectory, seconds.

    Raises
    ------
    EstimationError
        If the trajectory has fewer than two poses.

    Notes
    -----
    Times are compared as float64 seconds, as evo does, which for today's stamps are exact to 0.12 µs.
    """
    stamps = np.asarray(stamps_ns, dtype=np.int64)
    at = seconds(stamps) + shift_s
    times, first = np.unique(trajectory.stamps_s, return_index=True)
    if len(times) < 2:
        raise EstimationError("a trajectory of fewer than two poses cannot be interpolated")
    right = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    left = right - 1
    fraction = np.clip((at - times[left]) / (times[right] - times[left]), 0.0, 1.0)
    a, b = first[left], first[right]
    positions = trajectory.positions_m[a] + fraction[:, None] * (trajectory.positions_m[b] - trajectory.positions_m[a])
    quats = quaternion.normalise(trajectory.quats_xyzw)
    return replace(
        trajectory,
        stamps_ns=stamps,
        positions_m=positions,
        quats_xyzw=quaternion.slerp(quats[a], quats[b], fraction),
        matrices=None,
    )


def crop_time(trajectory: Trajectory, start_s: float | None = None, end_s: float | None = None) -> Trajectory:
    """Return the poses from `start_s` to `end_s`, seconds of the trajectory's own clock, both inclusive.

    Raises
    ------
    UsageError
        If nothing is left; the message says what the trajectory covers.
    """
    if start_s is None and end_s is None:
        return trajectory
    stamps = trajectory.stamps_s
    keep = (stamps >= (-math.inf if start_s is None else start_s)) & (stamps <= (math.inf if end_s is None else end_s))
    if not keep.any():
        raise UsageError(
            f"no pose of {trajectory.source or 'the trajectory'} lies in the time range asked for: it covers"
            f" {stamps.min():.6f} to {stamps.max():.6f} s"
        )
    return trajectory.select(keep)


def downsample(trajectory: Trajectory, num_poses: int) -> Trajectory:
    """Return at most `num_poses` poses, evenly spaced by their number, the first and the last among them.

    Raises
    ------
    UsageError
        If `num_poses` is less than 1.
    """
    if num_poses < 1:
        raise UsageError(f"cannot reduce a trajectory to {num_poses} poses")
    if len(trajectory) <= num_poses:
        return trajectory
    return trajectory.select(np.linspace(0, len(trajectory) - 1, num_poses, dtype=np.int64))


def motion_filter(trajectory: Trajectory, distance_m: float, angle_rad: float) -> Trajectory:
    """Return the poses after which the robot has moved: by `distance_m` along the path or by `angle_rad` since the last kept one.

    Raises
    ------
    UsageError
        If a threshold is negative.
    DataError
        If the trajectory has fewer than two poses.
    """
    if distance_m < 0 or angle_rad < 0:
        raise UsageError(f"motion filter: thresholds {distance_m:g} m and {angle_rad:g} rad must not be negative")
    if len(trajectory) < 2:
        raise DataError("motion filter: a trajectory of fewer than two poses has no motion")
    along = path_lengths(trajectory.positions_m).tolist()
    quats = quaternion.normalise(trajectory.quats_xyzw).tolist()
    kept, last = [0], 0
    for i in range(1, len(trajectory)):
        if along[i] - along[last] >= distance_m or _angle_between(quats[last], quats[i]) >= angle_rad:
            kept.append(i)
            last = i
    return trajectory.select(kept)


def path_lengths(positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the length of the path up to each position (N, 3), float64 (N,), metres, from 0."""
    steps = np.linalg.norm(positions_m[:-1] - positions_m[1:], axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _angle_between(a: list[float], b: list[float]) -> float:
    """Return the angle between two orientations given as unit quaternions x, y, z, w, radians."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by - ay * bw - az * bx + ax * bz
    z = aw * bz - az * bw - ax * by + ay * bx
    return 2 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(ax * bx + ay * by + az * bz + aw * bw))
