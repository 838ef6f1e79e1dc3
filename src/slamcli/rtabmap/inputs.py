# SPDX-License-Identifier: MIT
"""In which mode RTAB-Map runs on what a recording offers."""

from __future__ import annotations

from collections.abc import Collection

from slamcli.errors import RecordingError, UsageError
from slamcli.mapper import InputPlan, SensorOffer
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.runtime import RunLog

MODES = ("rgbd", "stereo", "scan")
ROLES = frozenset({"images", "scans", "points", "odometry", "imu", "landmarks"})


def plan_inputs(parameters: RtabmapParameters, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:
    """Return which sensors are taken: what the user asks for, else all that RTAB-Map can use.

    Raises
    ------
    RecordingError, UsageError
        If there is nothing to map from, or not what the mode that is asked for needs.
    """
    del given, log
    scans = offer.num_laser_scans + offer.num_multi_echo_laser_scans
    cameras: str | None = next((mode for mode in ("rgbd", "stereo") if mode in offer.cameras), None)
    if offer.mode in ("rgbd", "stereo") and offer.mode not in offer.cameras:
        raise UsageError(f"--mode {offer.mode}: the recording has no such images")
    cameras = None if offer.mode == "scan" else offer.mode or cameras
    if cameras is None and not scans and not offer.num_point_clouds:
        raise RecordingError("no images with depth, stereo images, scans or clouds that rtabmap could use")
    return InputPlan(
        parameters=parameters,
        num_laser_scans=min(scans, 1),
        num_point_clouds=offer.num_point_clouds if not scans else 0,
        spatial=offer.spatial or cameras is not None,
        odometry=offer.odometry,
        imu=offer.imu,
        camera_mode=cameras,
        base_frame=parameters.node.frame_id or None,
        map_frame=parameters.node.map_frame_id,
    )
