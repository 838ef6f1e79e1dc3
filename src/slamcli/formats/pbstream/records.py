# SPDX-License-Identifier: MIT
"""What the messages of a ``.pbstream`` hold, before the pose graph's poses are joined to it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats.pbstream import grids, points
from slamcli.formats.pbstream.poses import check_rotations, numbers_of, stamp_of, transforms_of
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.measurements import ImuSample, LandmarkObservation, Landmarks, Odometry, StampedPose
from slamcli.posegraph import Id, TrajectoryData

_TRACKING = "tracking_frame"
_ODOMETRY = "odom"
_FIXED = "fixed_frame"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NodeRecord:
    """A node without its pose in the map; as `slamcli.posegraph.Node`."""

    stamp_ns: int
    local_pose: tuple[float, ...]
    gravity_alignment_xyzw: NDArray[np.float64]
    points_m: NDArray[np.float32]
    low_resolution_points_m: NDArray[np.float32] | None
    rotational_histogram: NDArray[np.float32] | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SubmapRecord:
    """A submap without its pose in the map; as `slamcli.posegraph.Submap`."""

    local_pose: tuple[float, ...]
    num_range_data: int
    finished: bool
    grid: ProbabilityGrid | TsdfGrid | None = None
    high_resolution: HybridGrid | None = None
    low_resolution: HybridGrid | None = None
    rotational_histogram: NDArray[np.float32] | None = None


def id_of(trajectory: int, number: int, what: str) -> Id:
    """Return an id.

    Raises
    ------
    FormatError
        If a number is negative.
    """
    if trajectory < 0 or number < 0:
        raise FormatError(f"{what}: the id {number} of trajectory {trajectory}")
    return Id(int(trajectory), int(number))


@dataclass(slots=True, eq=False)
class Records:
    """Collects messages in the order of the file."""

    nodes: dict[Id, NodeRecord] = field(default_factory=dict)
    submaps: dict[Id, SubmapRecord] = field(default_factory=dict)
    _data: dict[int, TrajectoryData] = field(default_factory=dict)
    _imu: dict[int, list[ImuSample]] = field(default_factory=dict)
    _odometry: dict[int, list[Odometry]] = field(default_factory=dict)
    _fixed: dict[int, list[StampedPose]] = field(default_factory=dict)
    _landmarks: dict[int, list[Landmarks]] = field(default_factory=dict)

    def add(self, kind: str, value: Any, where: str) -> None:
        """Take one message by the name of its field in the schema.

        Raises
        ------
        FormatError
            If something in it is wrong.
        """
        if kind == "node":
            self._add_node(value, where)
        elif kind == "submap":
            self._add_submap(value, where)
        elif kind == "trajectory_data":
            self._data[value.trajectory_id] = _trajectory_data(value, where)
        elif kind == "imu_data":
            self._imu.setdefault(value.trajectory_id, []).append(_imu(value.sample, where))
        elif kind == "odometry_data":
            pose = _pose(value.sample, where)
            self._odometry.setdefault(value.trajectory_id, []).append(
                Odometry(frame_id=_ODOMETRY, child_frame_id=_TRACKING, **pose)
            )
        elif kind == "fixed_frame_pose_data":
            if value.sample.HasField("pose"):  # without: the receiver had no fix
                pose = _pose(value.sample, where)
                self._fixed.setdefault(value.trajectory_id, []).append(
                    StampedPose(frame_id=_FIXED, child_frame_id=_TRACKING, **pose)
                )
        else:
            self._landmarks.setdefault(value.trajectory_id, []).append(_landmarks(value.sample, where))

    def sensor_data(self) -> dict[str, Any]:
        """Return what a MapState has by trajectory."""
        return {
            "imu": {key: tuple(values) for key, values in self._imu.items()},
            "odometry": {key: tuple(values) for key, values in self._odometry.items()},
            "fixed_frame_poses": {key: tuple(values) for key, values in self._fixed.items()},
            "landmark_observations": {key: tuple(values) for key, values in self._landmarks.items()},
            "trajectory_data": self._data,
        }

    def _add_node(self, value: Any, where: str) -> None:
        key, data = id_of(value.node_id.trajectory, value.node_id.number, where), value.node_data
        what = f"{where}, node {key.number} of trajectory {key.trajectory}"
        if key in self.nodes:
            raise FormatError(f"{what}: it is in the file twice")
        is_3d = data.HasField("low_resolution_point_cloud") and bool(
            data.low_resolution_point_cloud.num_points or data.high_resolution_point_cloud.num_points
        )
        is_3d = is_3d or len(data.rotational_scan_matcher_histogram) > 0
        flat, high, low = (
            data.filtered_gravity_aligned_point_cloud,
            data.high_resolution_point_cloud,
            data.low_resolution_point_cloud,
        )
        cloud = high if is_3d else flat
        quat = data.gravity_alignment
        rotation = np.array([[quat.x, quat.y, quat.z, quat.w]])
        self.nodes[key] = NodeRecord(
            stamp_ns=stamp_of(data.timestamp, what),
            local_pose=numbers_of(data.local_pose),
            gravity_alignment_xyzw=check_rotations(rotation, what)[0],
            points_m=points.decode(cloud.num_points, cloud.point_data, what),
            low_resolution_points_m=points.decode(low.num_points, low.point_data, what) if is_3d else None,
            rotational_histogram=_histogram(data, what) if is_3d else None,
        )

    def _add_submap(self, value: Any, where: str) -> None:
        key = id_of(value.submap_id.trajectory, value.submap_id.number, where)
        what = f"{where}, submap {key.number} of trajectory {key.trajectory}"
        if key in self.submaps:
            raise FormatError(f"{what}: it is in the file twice")
        if value.HasField("submap_3d"):
            self.submaps[key] = _submap_3d(value.submap_3d, what)
        elif value.HasField("submap_2d"):
            submap = value.submap_2d
            self.submaps[key] = SubmapRecord(
                local_pose=numbers_of(submap.local_pose), num_range_data=submap.num_range_data, finished=submap.finished,
                grid=grids.read_grid(submap.grid, what) if submap.HasField("grid") else None,
            )  # fmt: skip
        else:
            raise FormatError(f"{what}: neither 2D nor 3D")


def _submap_3d(submap: Any, what: str) -> SubmapRecord:
    high, low = (
        grids.read_hybrid_grid(getattr(submap, name), what) if submap.HasField(name) else None
        for name in ("high_resolution_hybrid_grid", "low_resolution_hybrid_grid")
    )
    return SubmapRecord(
        local_pose=numbers_of(submap.local_pose), num_range_data=submap.num_range_data, finished=submap.finished,
        high_resolution=high, low_resolution=low, rotational_histogram=_histogram(submap, what),
    )  # fmt: skip


def _histogram(message: Any, what: str) -> NDArray[np.float32]:
    """Return the histogram, float32 (B,); empty in files of version 1."""
    histogram = np.array(message.rotational_scan_matcher_histogram, np.float32)
    if not np.isfinite(histogram).all():
        raise FormatError(f"{what}: its rotational histogram is not finite")
    return histogram


def _trajectory_data(value: Any, where: str) -> TrajectoryData:
    quat = value.imu_calibration
    rotation = np.array([[quat.x, quat.y, quat.z, quat.w]])
    if not math.isfinite(value.gravity_constant):
        raise FormatError(f"{where}: a gravity of {value.gravity_constant} m/s²")
    origin = None
    if value.HasField("fixed_frame_origin_in_map"):
        origin = transforms_of([numbers_of(value.fixed_frame_origin_in_map)], where)[0]
    return TrajectoryData(
        gravity_m_s2=value.gravity_constant,
        imu_calibration_xyzw=check_rotations(rotation, where)[0] if rotation.any() else np.array([0.0, 0.0, 0.0, 1.0]),
        T_map_fixed_frame=origin,
    )


def _vector(vector: Any, where: str) -> NDArray[np.float64]:
    values = np.array([vector.x, vector.y, vector.z])
    if not np.isfinite(values).all():
        raise FormatError(f"{where}: a reading is not finite")
    return values


def _imu(sample: Any, where: str) -> ImuSample:
    return ImuSample(
        stamp_ns=stamp_of(sample.timestamp, where),
        frame_id=_TRACKING,
        angular_rad_s=_vector(sample.angular_velocity, where),
        acceleration_m_s2=_vector(sample.linear_acceleration, where),
    )


def _position_quaternion(rigid: Any, where: str) -> dict[str, Any]:
    numbers = np.array(numbers_of(rigid))
    return {"position_m": numbers[:3], "quat_xyzw": check_rotations(numbers[None, 3:], where)[0]}


def _pose(sample: Any, where: str) -> dict[str, Any]:
    return {"stamp_ns": stamp_of(sample.timestamp, where), **_position_quaternion(sample.pose, where)}


def _landmarks(sample: Any, where: str) -> Landmarks:
    observations = tuple(
        LandmarkObservation(
            id=seen.id.decode("utf-8", "surrogateescape"),
            translation_weight=seen.translation_weight,
            rotation_weight=seen.rotation_weight,
            **_position_quaternion(seen.landmark_to_tracking_transform, where),
        )
        for seen in sample.landmark_observations
    )
    return Landmarks(stamp_ns=stamp_of(sample.timestamp, where), frame_id=_TRACKING, observations=observations)
