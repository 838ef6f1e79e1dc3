# SPDX-License-Identifier: MIT
"""Motion of a replay as messages: transforms, path, poses, ground truth, scans and particles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.measurements import FrameTransform, PointCloud, StampedPose
from slamcli.pipelines.replay import Replay
from slamcli.recordings.adapters import StampedPath, StampedPoses
from slamcli.reports.mcap_clock import Clock, Entry, moments, named_frames
from slamcli.trajectory import Trajectory

_MOST_PATHS = 60
_MOST_ON_PATH = 1000
"""Poses of a path that still grows; the last one has them all."""
_MOST_STEPS = 400
_MOST_PARTICLES = 200


def transforms(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/tf_static`` at the start, and ``/tf`` at each pose: from the map down to the robot."""
    frames = replay.frames
    if frames is None:
        for i in _in_order(replay.trajectory):
            pose = replay.trajectory
            stamp = max(clock.begin_ns, int(pose.stamps_ns[i]))
            edge = FrameTransform(
                stamp_ns=stamp, parent_frame_id=pose.frame_id, child_frame_id=pose.child_frame_id,
                position_m=pose.positions_m[i], quat_xyzw=pose.quats_xyzw[i],
            )  # fmt: skip
            yield Entry(stamp, "/tf", [edge])
        return
    if frames.static:
        yield Entry(clock.begin_ns, "/tf_static", [replace(edge, stamp_ns=clock.begin_ns) for edge in frames.static])
    parts = [(frame, *se3.to_position_quaternion(frame.T_parent_child)) for frame in frames.moving]
    for i in _in_order(replay.trajectory):
        stamp = max(clock.begin_ns, int(replay.trajectory.stamps_ns[i]))
        edges = [
            FrameTransform(
                stamp_ns=stamp, parent_frame_id=frame.parent, child_frame_id=frame.child, position_m=positions[i],
                quat_xyzw=quats[i],
            )
            for frame, positions, quats in parts
            if frame.known[i]
        ]  # fmt: skip
        if edges:
            yield Entry(stamp, "/tf", edges)


def poses(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/pose``: the robot in the map."""
    whole = replay.trajectory
    for i in _in_order(whole):
        stamp = max(clock.begin_ns, int(whole.stamps_ns[i]))
        pose = StampedPose(
            stamp_ns=stamp, frame_id=whole.frame_id, position_m=whole.positions_m[i], quat_xyzw=whole.quats_xyzw[i],
            child_frame_id=whole.child_frame_id,
        )  # fmt: skip
        yield Entry(stamp, "/pose", pose)


def growing_path(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/trajectory``: the way so far."""
    whole = replay.trajectory
    times = np.array([clock.at_pose(i) for i in range(len(whole))], dtype=np.int64)
    chosen = moments(np.ones(len(whole), dtype=np.int64), times, _MOST_PATHS)
    for i in chosen:
        every = 1 if i == chosen[-1] else max(1, math.ceil((i + 1) / _MOST_ON_PATH))
        shown = np.unique([*range(0, i + 1, every), i])
        part = Trajectory(
            whole.stamps_ns[shown], whole.positions_m[shown], whole.quats_xyzw[shown], whole.frame_id, whole.child_frame_id
        )  # fmt: skip
        yield Entry(times[i].item(), "/trajectory", StampedPath(stamp_ns=times[i].item(), path=part))


def ground_truth(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/ground_truth``, whole and from the start."""
    if replay.truth is not None and len(replay.truth):
        path = replace(named_frames(replay.truth), frame_id=replay.trajectory.frame_id)
        yield Entry(clock.begin_ns, "/ground_truth", StampedPath(stamp_ns=clock.begin_ns, path=path))


def scans(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/scan_in_map``: what scanners hit, where it ended in the map, flat."""
    track = replay.scans
    if track is None:
        return
    for i in np.argsort(track.stamps_ns, kind="stable").tolist():
        part = track.points_m[track.offsets[i] : track.offsets[i + 1]]
        points = np.column_stack([part, np.zeros(len(part), dtype=np.float32)]).astype(np.float32)
        stamp = max(clock.begin_ns, int(track.stamps_ns[i]))
        yield Entry(
            stamp, "/scan_in_map", PointCloud(stamp_ns=stamp, frame_id=replay.trajectory.frame_id, points_m=points)
        )


def particles(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/particles``: the poses that the filter holds for possible."""
    track = replay.particles
    if track is None:
        return
    order = np.argsort(track.stamps_ns, kind="stable")
    for i in order[:: max(1, math.ceil(len(order) / _MOST_STEPS))].tolist():
        there = track.poses[i, np.isfinite(track.poses[i]).all(axis=1)]
        shown = there[:: max(1, math.ceil(len(there) / _MOST_PARTICLES))].astype(np.float64)
        stamp = max(clock.begin_ns, int(track.stamps_ns[i]))
        cloud = StampedPoses(
            stamp_ns=stamp, frame_id=replay.trajectory.frame_id, quats_xyzw=quaternion.from_yaw(shown[:, 2]),
            positions_m=np.column_stack([shown[:, :2], np.zeros(len(shown))]),
        )  # fmt: skip
        yield Entry(stamp, "/particles", cloud)


def _in_order(trajectory: Trajectory) -> list[int]:
    order: list[int] = np.argsort(trajectory.stamps_ns, kind="stable").tolist()
    return order
