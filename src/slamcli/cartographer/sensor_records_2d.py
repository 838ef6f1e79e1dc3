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


def robot_pose(fix: StampedPose, T_base_sensor: NDArray[np.float64]) -> StampedPose:
    """Return where a fix has the robot; without an orientation it stays where the antenna is."""
    if not tells_orientation(fix):
        return fix
    T_fixed_sensor = se3.from_position_quaternion(fix.position_m, quaternion.normalise(fix.quat_xyzw))
    position, quat = se3.to_position_quaternion(T_fixed_sensor @ se3.inverse(T_base_sensor))
    return replace(fix, position_m=position, quat_xyzw=quat)


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
