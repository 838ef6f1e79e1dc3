# SPDX-License-Identifier: MIT
"""What sensors measured during a run, as messages of a ``.pbstream``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.formats.pbstream import schema
from slamcli.formats.pbstream.poses import fill, numbers_from, ticks_of
from slamcli.measurements import ImuSample, LandmarkObservation, Landmarks, StampedPose
from slamcli.posegraph import MapState


def sensor_messages(state: MapState) -> Iterator[Any]:
    """Yield the messages of what was measured, kind after kind, trajectory after trajectory."""
    yield from _trajectory_data(state)
    yield from _listed(state.imu, "imu_data", _fill_imu)
    yield from _listed(state.odometry, "odometry_data", _fill_pose)
    yield from _listed(state.fixed_frame_poses, "fixed_frame_pose_data", _fill_pose)
    yield from _listed(state.landmark_observations, "landmark_data", _fill_landmarks)


def _listed(table: Mapping[int, Iterable[Any]], kind: str, fill_sample: Callable[[Any, Any], None]) -> Iterator[Any]:
    """Yield one message per record of a table by trajectory; `kind` names the field of the message."""
    for number, records in sorted(table.items()):
        for record in records:
            data = schema.Data()
            message = getattr(data, kind)
            message.trajectory_id = number
            fill_sample(message.sample, record)
            yield data


def _trajectory_data(state: MapState) -> Iterator[Any]:
    for number, found in sorted(state.trajectory_data.items()):
        data = schema.Data()
        message = data.trajectory_data
        message.trajectory_id, message.gravity_constant = number, found.gravity_m_s2
        quat = message.imu_calibration
        quat.x, quat.y, quat.z, quat.w = found.imu_calibration_xyzw.tolist()
        if found.T_map_fixed_frame is not None:
            fill(message.fixed_frame_origin_in_map, numbers_from([found.T_map_fixed_frame], "fixed frame")[0])
        yield data


def _fill_imu(message: Any, sample: ImuSample) -> None:
    message.timestamp = ticks_of(sample.stamp_ns)
    for vector, values in (
        (message.linear_acceleration, sample.acceleration_m_s2),
        (message.angular_velocity, sample.angular_rad_s),
    ):
        vector.x, vector.y, vector.z = np.asarray(values, np.float64).tolist()


def _fill_pose(message: Any, pose: StampedPose) -> None:
    message.timestamp = ticks_of(pose.stamp_ns)
    fill(message.pose, _numbers(pose))


def _numbers(pose: StampedPose | LandmarkObservation) -> list[float]:
    both: NDArray[np.float64] = np.concatenate([pose.position_m, pose.quat_xyzw])
    return both.tolist()


def _fill_landmarks(message: Any, seen: Landmarks) -> None:
    message.timestamp = ticks_of(seen.stamp_ns)
    for observation in seen.observations:
        entry = message.landmark_observations.add(id=observation.id.encode("utf-8", "surrogateescape"))
        fill(entry.landmark_to_tracking_transform, _numbers(observation))
        entry.translation_weight, entry.rotation_weight = observation.translation_weight, observation.rotation_weight
