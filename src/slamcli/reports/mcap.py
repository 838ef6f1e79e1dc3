# SPDX-License-Identifier: MIT
"""A result as a recording that Foxglove, RViz and every ROS tool open: map, path, poses and transforms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from slamcli.errors import UsageError
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform, PointCloud, StampedPose
from slamcli.posegraph import MapState
from slamcli.recordings import create_recording
from slamcli.recordings.adapters import StampedGrid, StampedPath
from slamcli.reports.graph_markers import graph_markers
from slamcli.trajectory import Trajectory

_MAP_FRAME = "map"
_BASE_FRAME = "base_link"


def write_result(
    path: Path,
    *,
    grid: OccupancyGrid | None = None,
    trajectory: Trajectory | None = None,
    truth: Trajectory | None = None,
    state: MapState | None = None,
    cloud: PointCloud | None = None,
) -> dict[str, int]:
    """Write a result to a recording (.mcap, .bag or a ROS 2 folder) and return the number of messages by topic.

    ``/map`` (nav_msgs/OccupancyGrid), ``/trajectory`` and ``/ground_truth`` (nav_msgs/Path) come first and hold from the
    start on, and so do the
    graph (``/submaps``, ``/nodes``, ``/constraints``, visualization_msgs/MarkerArray) and ``/cloud``; ``/pose`` (geometry_msgs/PoseStamped) and ``/tf`` (map to base) follow in the order of their stamps. The
    same input gives the same bytes.

    Parameters
    ----------
    path
        Where it goes; the suffix names the format.
    grid, trajectory, truth, state, cloud
        What to write; what is None is left out.

    Raises
    ------
    UsageError
        If there is nothing to write, or the file cannot be written.
    """
    trajectories = [t for t in (trajectory, truth) if t is not None and len(t)]
    if grid is None and not trajectories:
        raise UsageError(f"{path}: neither a map nor a trajectory to write")
    begin = max(1, min((int(t.stamps_ns.min()) for t in trajectories), default=1))
    written: dict[str, int] = {}
    with create_recording(path) as recording:
        if grid is not None:
            recording.write("/map", StampedGrid(stamp_ns=begin, grid=grid))
            written["/map"] = 1
        for topic, whole in (("/trajectory", trajectory), ("/ground_truth", truth)):
            if whole is not None and len(whole):
                recording.write(topic, StampedPath(stamp_ns=begin, path=_in_map(whole)), log_time_ns=begin)
                written[topic] = 1
        for topic, markers in (graph_markers(state, begin) if state is not None else {}).items():
            recording.write(topic, markers, log_time_ns=begin)
            written[topic] = 1
        if cloud is not None:
            recording.write("/cloud", replace(cloud, stamp_ns=begin, frame_id=_MAP_FRAME), log_time_ns=begin)
            written["/cloud"] = 1
        if trajectory is not None and len(trajectory):
            poses = _in_map(trajectory)
            for i in np.argsort(poses.stamps_ns, kind="stable").tolist():
                pose = _pose(poses, i)
                log_time = max(begin, pose.stamp_ns)
                recording.write("/pose", pose, log_time_ns=log_time)
                recording.write("/tf", _transform(pose), log_time_ns=log_time)
            written["/pose"] = written["/tf"] = len(poses)
    return written


def _in_map(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory with frames: those of a file have no names."""
    return Trajectory(
        trajectory.stamps_ns,
        trajectory.positions_m,
        trajectory.quats_xyzw,
        trajectory.frame_id or _MAP_FRAME,
        trajectory.child_frame_id or _BASE_FRAME,
    )


def _pose(trajectory: Trajectory, i: int) -> StampedPose:
    return StampedPose(
        stamp_ns=int(trajectory.stamps_ns[i]),
        frame_id=trajectory.frame_id,
        position_m=trajectory.positions_m[i],
        quat_xyzw=trajectory.quats_xyzw[i],
        child_frame_id=trajectory.child_frame_id,
    )


def _transform(pose: StampedPose) -> FrameTransform:
    return FrameTransform(
        stamp_ns=pose.stamp_ns,
        parent_frame_id=pose.frame_id,
        child_frame_id=pose.child_frame_id,
        position_m=pose.position_m,
        quat_xyzw=pose.quat_xyzw,
    )
