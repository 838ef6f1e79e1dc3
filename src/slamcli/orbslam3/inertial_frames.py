# SPDX-License-Identifier: MIT
"""Where frames were that only the IMU saw: integrated between the keyframes around them, as those are in the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slamcli.orbslam3.frame_track import TrackedFrame
from slamcli.orbslam3.inertial_state import Imu, MapInertia
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.posegraph.imu_preintegration import InertialState, predict, preintegrate

Floats = NDArray[np.float64]


def carried_frames(
    frames: list[TrackedFrame], number: int, sparse_map: SparseMap, inertia: MapInertia, imu: Imu
) -> list[TrackedFrame]:
    """Return all frames, those of map `number` that saw no point at the poses that the IMU says now.

    The samples are integrated from the keyframe before. What is missing to the keyframe after grows with the square of time,
    as it would from biases and tilt, and is taken out.
    """
    known = inertia.known(sparse_map)
    if inertia.gravity_map is None or not len(known):
        return frames
    return [
        _carried(frame, sparse_map, inertia, imu, known)
        if frame.map_number == number and not len(frame.points)
        else frame
        for frame in frames
    ]


def _carried(
    frame: TrackedFrame, sparse_map: SparseMap, inertia: MapInertia, imu: Imu, known: NDArray[np.int64]
) -> TrackedFrame:
    stamps = sparse_map.stamp_ns[known]
    at = int(np.searchsorted(stamps, frame.stamp_ns)) - 1
    if at < 0:
        return frame
    before, begin = known[at : at + 1], int(stamps[at])
    samples, T_camera_imu = imu.buffer.samples(begin), imu.T_camera_imu
    ends = [frame.stamp_ns, *([int(stamps[at + 1])] if at + 1 < len(known) else [])]
    motions = preintegrate(samples, np.full(len(ends), begin), np.array(ends), inertia.biases(before)[0], imu.noise)
    state = InertialState(
        T_map_imu=np.linalg.inv(sparse_map.T_camera_map[before[0]]) @ T_camera_imu,
        velocity_map=inertia.velocities(before)[0], biases=inertia.biases(before)[0],
    )  # fmt: skip
    T_map_imu = predict(state, motions, inertia.gravity).T_map_imu
    if len(ends) > 1:
        said = predict(state, motions, inertia.gravity, row=1).T_map_imu
        true = np.linalg.inv(sparse_map.T_camera_map[known[at + 1]]) @ T_camera_imu
        share = (frame.stamp_ns - begin) / (ends[1] - begin)
        missing = Rotation.from_matrix(true[:3, :3] @ said[:3, :3].T).as_rotvec()
        T_map_imu[:3, :3] = Rotation.from_rotvec(share * missing).as_matrix() @ T_map_imu[:3, :3]
        T_map_imu[:3, 3] += share**2 * (true[:3, 3] - said[:3, 3])
    T_camera_map = T_camera_imu @ np.linalg.inv(T_map_imu)
    reference = int(before[0])
    return replace(
        frame, reference=reference, T_frame_reference=T_camera_map @ np.linalg.inv(sparse_map.T_camera_map[reference])
    )
