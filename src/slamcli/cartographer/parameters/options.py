# SPDX-License-Identifier: MIT
"""The option block of Cartographer's ROS node: frames, inputs and what it publishes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.cartographer.parameters.tables import count, share
from slamcli.parameters import parameter

_LIVE = "nothing is published here: results are files"


def _period(default: float, help: str) -> Any:
    return parameter(default, f"{help}; {_LIVE}", unit="s", minimum=0.0, maximum=1e6, effective=False)


def _optional(help: str, kind: type = bool) -> Any:
    if kind is int:
        return count(None, help)
    return parameter(None, help, kind=kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeOptions:
    """What stands in the ``options`` table beside ``map_builder`` and ``trajectory_builder``."""

    map_frame: str = parameter("map", "frame of the map")
    tracking_frame: str = parameter(
        "base_link", "frame whose poses are estimated; the original wants the IMU's frame here where one is used"
    )
    published_frame: str = parameter(
        "base_link", f"child of the broadcast transform; {_LIVE}, with poses of tracking_frame", effective=False
    )
    odom_frame: str = parameter("odom", "frame of the odometry")
    provide_odom_frame: bool = parameter(True, f"broadcast odom -> published_frame; {_LIVE}", effective=False)
    publish_frame_projected_to_2d: bool = parameter(
        False, f"flatten the broadcast pose; {_LIVE}, in 2D flat as they are", effective=False
    )
    use_odometry: bool = _optional("use odometry; auto: where the recording has it")
    use_nav_sat: bool = _optional("use GPS fixes as fixed-frame poses; auto: where the recording has them")
    use_landmarks: bool = _optional("use landmarks; auto: where the recording has them")
    num_laser_scans: int = _optional("topics of 2D scans (scan, or scan_1, scan_2 ...); auto: as recorded", int)
    num_multi_echo_laser_scans: int = _optional("topics of multi-echo scans (echoes ...); auto: as recorded", int)
    num_subdivisions_per_laser_scan: int = count(
        1,
        "parts of a scan; num_accumulated_range_data counts them. Here every beam has its own time, and scans stay whole",
        1,
    )
    num_point_clouds: int = _optional("topics of point clouds (points2, or points2_1 ...); auto: as recorded", int)
    lookup_transform_timeout_sec: float = parameter(
        0.2,
        "how long to wait for a transform; here all of them are known from the start",
        unit="s",
        minimum=0.0,
        maximum=1e6,
        effective=False,
    )
    submap_publish_period_sec: float = _period(0.3, "period of the submap list")
    pose_publish_period_sec: float = _period(5e-3, "period of the pose broadcast")
    trajectory_publish_period_sec: float = _period(30e-3, "period of the trajectory markers")
    rangefinder_sampling_ratio: float = share(1.0, "share of the scans that are used")
    odometry_sampling_ratio: float = share(1.0, "share of the odometry messages that are used")
    fixed_frame_pose_sampling_ratio: float = share(1.0, "share of the GPS fixes that are used")
    imu_sampling_ratio: float = share(1.0, "share of the IMU messages that are used")
    landmarks_sampling_ratio: float = share(1.0, "share of the landmark messages that are used")
    publish_to_tf: bool = parameter(True, f"broadcast transforms; {_LIVE}", effective=False)
    publish_tracked_pose: bool = parameter(False, f"publish the pose as a message; {_LIVE}", effective=False)
    use_pose_extrapolator: bool = parameter(True, f"extrapolate the published pose; {_LIVE}", effective=False)
    ignore_out_of_order: bool = parameter(
        False, "drop messages that come late; here messages are ordered by their stamps first", effective=False
    )
