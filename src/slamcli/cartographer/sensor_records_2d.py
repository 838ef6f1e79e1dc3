# SPDX-License-Identifier: MIT
"""What sensors said during a run in the plane, as a saved state keeps it: in the frame of the robot and in order of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample, Landmarks, Odometry, StampedPose
from slamcli.posegraph import MapState

Record = TypeVar("Record", StampedPose, Odometry, ImuSample, Landmarks)
_TICK_NS = 100
"""Saved states count time in these; each record must be later than the one before."""


def with_records(
    kept: Mapping[int, tuple[Record, ...]], trajectory: int, records: Sequence[Record]
) -> dict[int, tuple[Record, ...]]:
    """Return records by trajectory with new ones; of those with one stamp the first."""
    found: list[Record] = []
    for record in sorted(records, key=lambda record: record.stamp_ns):
        if not found or record.stamp_ns // _TICK_NS > found[-1].stamp_ns // _TICK_NS:
            found.append(record)
    return {**kept, trajectory: tuple(found)} if found else dict(kept)


def with_motion_sensors(
    state: MapState, trajectory: int, odometry: Sequence[Odometry], imu: Sequence[ImuSample], setup: Setup
) -> MapState:
    """Return the state with the odometry and the IMU of a trajectory."""
    samples = [_turned(sample, setup) for sample in imu]
    return replace(
        state,
        odometry=with_records(state.odometry, trajectory, odometry),
        imu=with_records(state.imu, trajectory, samples),
    )


def tells_orientation(fix: StampedPose) -> bool:
    """Whether a pose in a fixed frame tells how its sensor is turned: not if its variance is infinite.

    Without a variance (saved states have none) the identity stands for untold.
    """
    if fix.covariance is None:
        return bool(np.abs(fix.quat_xyzw[:3]).max() > 0.0)
    return bool(np.isfinite(fix.covariance[5, 5]))


def robot_poses(
    fixes: Sequence[StampedPose],
    T_base_sensor: NDArray[np.float64],
    stamps_ns: NDArray[np.int64],
    yaws: NDArray[np.float64] | None,
) -> list[StampedPose]:
    """Return where fixes have the robot.

    Parameters
    ----------
    T_base_sensor
        float64 (4, 4), mount of the receiver.
    stamps_ns, yaws
        int64 (N,), float64 (N,): the robot's heading in the fixed frame over time, for fixes that tell no orientation. Where
        it is not known (None) these stay where the antenna is.
    """
    T_sensor_base, order = se3.inverse(T_base_sensor), np.argsort(stamps_ns, kind="stable")
    found = []
    for fix in fixes:
        if tells_orientation(fix):
            T_fixed_sensor = se3.from_position_quaternion(fix.position_m, quaternion.normalise(fix.quat_xyzw))
            position, quat = se3.to_position_quaternion(T_fixed_sensor @ T_sensor_base)
            found.append(replace(fix, position_m=position, quat_xyzw=quat))
        elif yaws is None:
            found.append(fix)
        else:
            seconds = (stamps_ns[order] - fix.stamp_ns) / 1e9
            yaw = np.interp(0.0, seconds, np.unwrap(yaws[order]))
            found.append(
                replace(
                    fix, position_m=fix.position_m - quaternion.rotate(quaternion.from_yaw(yaw), T_base_sensor[:3, 3])
                )
            )
    return found


def _turned(sample: ImuSample, setup: Setup) -> ImuSample:
    """Return a sample as the robot's frame has it."""
    turn = setup.T_base_sensor.get(sample.topic, np.eye(4))[:3, :3]
    return replace(
        sample,
        frame_id=setup.base_frame,
        angular_rad_s=turn @ sample.angular_rad_s,
        acceleration_m_s2=turn @ sample.acceleration_m_s2,
        quat_xyzw=None,
    )
