# SPDX-License-Identifier: MIT
"""The protobuf messages of a ``.pbstream``, built from the table below.

The descriptors are made at import time instead of by ``protoc``: no generated code is kept that a later runtime refuses,
and the whole schema can be read in one place. Long packed arrays of integers (cells, points, voxels) are declared as
``bytes``, which has the same encoding: `slamcli.formats.pbstream.packed` turns them into arrays at once, while protobuf
would make a Python number of each. Enumerations are plain integers, which have the same encoding as well.
"""

from __future__ import annotations

from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

# message: type field = number, ...; a star marks repeated fields.
_TABLE = """
Vector2: double x=1, double y=2
Vector3: double x=1, double y=2, double z=3
Quaternion: double x=1, double y=2, double z=3, double w=4
Rigid3: Vector3 translation=1, Quaternion rotation=2

Header: uint32 format_version=1
Id: int32 trajectory=1, int32 number=2

Constraint: Id submap_id=1, Id node_id=2, Rigid3 relative_pose=3, int32 tag=5, double translation_weight=6, double rotation_weight=7
NodePose: int64 timestamp=1, Rigid3 pose=5, int32 node_index=7
SubmapPose: Rigid3 pose=1, int32 submap_index=2
Trajectory: NodePose* node=1, SubmapPose* submap=2, int32 trajectory_id=3
LandmarkPose: bytes landmark_id=1, Rigid3 global_pose=2
PoseGraph: Constraint* constraint=2, Trajectory* trajectory=4, LandmarkPose* landmark_poses=5

Options: bytes* options_with_sensor_ids=1

CellLimits: int32 num_x_cells=1, int32 num_y_cells=2
MapLimits: double resolution=1, Vector2 max=2, CellLimits cell_limits=3
CellBox: int32 max_x=1, int32 max_y=2, int32 min_x=3, int32 min_y=4
Empty:
Tsdf: float truncation_distance=1, float max_weight=2, bytes weight_cells=3
Grid2: MapLimits limits=1, bytes cells=2, CellBox known_cells_box=3, Empty probability_grid_2d=4, Tsdf tsdf_2d=5, float min_correspondence_cost=6, float max_correspondence_cost=7
Submap2: Rigid3 local_pose=1, int32 num_range_data=2, bool finished=3, Grid2 grid=4
HybridGrid: float resolution=1, bytes x_indices=3, bytes y_indices=4, bytes z_indices=5, bytes values=6
Submap3: Rigid3 local_pose=1, int32 num_range_data=2, bool finished=3, HybridGrid high_resolution_hybrid_grid=4, HybridGrid low_resolution_hybrid_grid=5, float* rotational_scan_matcher_histogram=6
Submap: Id submap_id=1, Submap2 submap_2d=2, Submap3 submap_3d=3

PointCloud: int32 num_points=1, bytes point_data=3
NodeData: int64 timestamp=1, Quaternion gravity_alignment=2, PointCloud filtered_gravity_aligned_point_cloud=3, PointCloud high_resolution_point_cloud=4, PointCloud low_resolution_point_cloud=5, float* rotational_scan_matcher_histogram=6, Rigid3 local_pose=7
Node: Id node_id=1, NodeData node_data=5

TrajectoryData: int32 trajectory_id=1, double gravity_constant=2, Quaternion imu_calibration=3, Rigid3 fixed_frame_origin_in_map=4

ImuSample: int64 timestamp=1, Vector3 linear_acceleration=2, Vector3 angular_velocity=3
ImuData: int32 trajectory_id=1, ImuSample sample=2
StampedPose: int64 timestamp=1, Rigid3 pose=2
OdometryData: int32 trajectory_id=1, StampedPose sample=2
FixedFramePoseData: int32 trajectory_id=1, StampedPose sample=2
LandmarkObservation: bytes id=1, Rigid3 landmark_to_tracking_transform=2, double translation_weight=3, double rotation_weight=4
LandmarkSample: int64 timestamp=1, LandmarkObservation* landmark_observations=2
LandmarkData: int32 trajectory_id=1, LandmarkSample sample=2

Data: PoseGraph pose_graph=1, Options all_trajectory_builder_options=2, Submap submap=3, Node node=4, TrajectoryData trajectory_data=5, ImuData imu_data=6, OdometryData odometry_data=7, FixedFramePoseData fixed_frame_pose_data=8, LandmarkData landmark_data=9
"""

_PACKAGE = "slamcli.pbstream"
_FIELD = descriptor_pb2.FieldDescriptorProto
_SCALARS = frozenset(_FIELD.Type.keys())


def _file() -> Any:
    """Return the file descriptor that the table describes."""
    file = descriptor_pb2.FileDescriptorProto(name="slamcli/pbstream.proto", package=_PACKAGE, syntax="proto3")
    for line in filter(None, _TABLE.splitlines()):
        name, _, fields = line.partition(":")
        message = file.message_type.add(name=name)
        for field in filter(None, (text.strip() for text in fields.split(","))):
            kind, _, rest = field.partition(" ")
            label, _, number = rest.partition("=")
            entry = message.field.add(name=label, number=int(number), label=_FIELD.LABEL_OPTIONAL)
            if kind.endswith("*"):
                entry.label = _FIELD.LABEL_REPEATED
            scalar = f"TYPE_{kind.rstrip('*').upper()}"
            if scalar in _SCALARS:
                entry.type = _FIELD.Type.Value(scalar)
            else:
                entry.type, entry.type_name = _FIELD.TYPE_MESSAGE, f".{_PACKAGE}.{kind.rstrip('*')}"
    return file


_POOL = descriptor_pool.DescriptorPool()
_POOL.Add(_file())


def _message(name: str) -> Any:
    return message_factory.GetMessageClass(_POOL.FindMessageTypeByName(f"{_PACKAGE}.{name}"))


Header = _message("Header")
Data = _message("Data")
PoseGraph = _message("PoseGraph")
