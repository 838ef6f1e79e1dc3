# SPDX-License-Identifier: MIT
"""The robot's frames at the poses of a result: map to odometry, odometry to robot as it was recorded, and the mounts of sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import SlamcliError
from slamcli.geometry import se3
from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import FrameTransform, Odometry
from slamcli.pipelines.replay_tracks import FrameTrack, MovingFrame
from slamcli.recordings import Mends, Recording, open_recording
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.trajectory.resampling import interpolate

Transforms = NDArray[np.float64]


def follow_frames(
    files: Sequence[Path], run: Mapping[str, Any], trajectory: Trajectory, mends: Mends | None, log: RunLog
) -> FrameTrack | None:
    """Return the frames of the robot, None without a recording; one that cannot be read is said as a warning.

    Where the run used odometry the map's frame is the parent of the odometry's, as a localiser has it (REP 105); otherwise of the
    topmost frame that is fixed to the robot. No frame gets a second parent when the recording is played besides.
    """
    if not files:
        return None
    try:
        with open_recording(list(files), mends=mends, log=RunLog()) as recording:
            return _follow(recording, run, trajectory)
    except SlamcliError as error:
        log.warn(f"frames are left out: {error}")
        return None


def _follow(recording: Recording, run: Mapping[str, Any], trajectory: Trajectory) -> FrameTrack:
    tree, base = recording.frames(), trajectory.child_frame_id
    odom = _named(run, "frames", "odom")
    topic = _named(run, "topics", "odometry")
    below: list[MovingFrame] = []
    T_top_base, known = np.broadcast_to(np.eye(4), (len(trajectory), 4, 4)), np.ones(len(trajectory), dtype=bool)
    if odom and topic and odom != base and tree.connected(odom, base) and not tree.is_static(odom, base):
        below = _chain(tree, odom, base, trajectory.stamps_ns)
        if below:
            T_top_base, known = tree.lookup_many(odom, base, trajectory.stamps_ns)
    elif odom and topic and odom != base:
        below = _from_topic(recording, topic, odom, base, trajectory)
        if below:
            T_top_base, known = below[0].T_parent_child, below[0].known
    top = odom if below else _topmost(tree, base)
    if not below and top != base:
        T_top_base = T_top_base @ tree.lookup(top, base)
    above = MovingFrame(
        parent=trajectory.frame_id,
        child=top,
        T_parent_child=trajectory.transforms @ se3.inverse(T_top_base),
        known=known,
    )
    taken = {above.child, *(frame.child for frame in below)}
    return FrameTrack(moving=(above, *below), static=_statics(tree, base, taken, trajectory.frame_id))


def _chain(tree: FrameTree, odom: str, base: str, stamps_ns: NDArray[np.int64]) -> list[MovingFrame]:
    """Return the edges that move between the odometry's frame and the robot's, from above."""
    downward = []
    frame = base
    while frame != odom:
        edge = tree.edge(frame)
        if edge is None:
            return []  # the odometry's frame is not above the robot's: nothing can be told without a second parent
        downward.append(edge)
        frame = edge.parent
    found = []
    for edge in (edge for edge in downward[::-1] if not edge.static):
        T, known = tree.lookup_many(edge.parent, edge.child, stamps_ns)
        found.append(MovingFrame(parent=edge.parent, child=edge.child, T_parent_child=T, known=known))
    return found


def _from_topic(recording: Recording, topic: str, odom: str, base: str, trajectory: Trajectory) -> list[MovingFrame]:
    """Return the robot in the odometry's frame by the messages of a topic; between them it is interpolated."""
    named = [t for t in recording.topics(Odometry) if t.name == topic]
    read: list[Odometry] = list(recording.measurements(named)) if named else []
    if len({odometry.stamp_ns for odometry in read}) < 2:
        return []
    child, tree = read[0].child_frame_id, recording.frames()
    track = Trajectory(
        np.array([o.stamp_ns for o in read], dtype=np.int64), np.array([o.position_m for o in read]),
        np.array([o.quat_xyzw for o in read]), odom, child,
    )  # fmt: skip
    T = interpolate(track, trajectory.stamps_ns).transforms
    if child != base and tree.connected(child, base):
        T = T @ tree.lookup(child, base)
    inside = (trajectory.stamps_ns >= track.stamps_ns.min()) & (trajectory.stamps_ns <= track.stamps_ns.max())
    return [MovingFrame(parent=odom, child=base, T_parent_child=T, known=inside)]


def _topmost(tree: FrameTree, base: str) -> str:
    """Return the highest frame above the robot's that is fixed to it."""
    frame = base
    while (edge := tree.edge(frame)) is not None and edge.static:
        frame = edge.parent
    return frame


def _statics(tree: FrameTree, base: str, taken: set[str], map_frame: str) -> tuple[FrameTransform, ...]:
    """Return the fixed edges of the robot's tree but those whose child has another parent already."""
    if base not in tree.frames:
        return ()
    return tuple(
        FrameTransform(
            stamp_ns=0, parent_frame_id=edge.parent, child_frame_id=edge.child,
            position_m=edge.at(np.zeros(1, dtype=np.int64))[0, :3, 3], static=True,
            quat_xyzw=se3.to_position_quaternion(edge.at(np.zeros(1, dtype=np.int64))[0])[1],
        )
        for edge in tree.edges
        if edge.static and edge.child not in taken and map_frame not in (edge.parent, edge.child) and tree.connected(edge.child, base)
    )  # fmt: skip


def _named(run: Mapping[str, Any], section: str, role: str) -> str:
    values = run.get(section)
    value = values.get(role) if isinstance(values, dict) else None
    return value if isinstance(value, str) and value != "none" else ""
