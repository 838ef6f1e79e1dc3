# SPDX-License-Identifier: MIT
"""Where a recording's odometry comes from, and which frames are the robot's base and the odometry's."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.errors import RecordingError
from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import Odometry
from slamcli.recordings.raw import Topic
from slamcli.recordings.recording import Recording
from slamcli.recordings.topic_ranks import usable_odometry

FROM_TF = "tf"
"""What a user names as odometry topic to take odometry from the frame tree."""

_BASE_FRAMES = ("base_link", "base_footprint", "base", "base_frame")
_ODOM_FRAMES = ("odom", "odom_combined", "odom_frame")


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryPick:
    """Where the odometry comes from, and the frames to use."""

    base_frame: str
    odom_frame: str
    odometry: str
    """``topic``, ``tf`` or ``none``."""
    odom_topic: Topic | None
    """The nav_msgs/Odometry topic if `odometry` is ``topic``."""
    odom_child_frame: str
    """The frame whose motion the odometry describes; differs from `base_frame` by a fixed transform, if at all."""


def pick_odometry(
    recording: Recording,
    sensor_frame: str,
    *,
    odom_topic: str | None = None,
    base_frame: str | None = None,
    odom_frame: str | None = None,
    wanted: bool = True,
) -> OdometryPick:
    """Return the odometry and the frames to use: what the caller names, else what fits best.

    Parameters
    ----------
    sensor_frame
        Frame of the range sensor, which the base frame is looked for above.
    wanted
        False to find the frames only: odometry is not used then.

    Raises
    ------
    RecordingError
        If a named topic is missing, empty or of another type.
    """
    tree = recording.frames()
    topic = None if odom_topic == FROM_TF else _odometry_topic(recording, odom_topic, say=wanted)
    sample = next(iter(recording.measurements([topic])), None) if topic is not None else None
    if sample is not None:
        # Where a driver leaves the child frame empty, it is the one that /tf moves against the odometry's frame.
        child = sample.child_frame_id or _child_towards(tree, sample.frame_id, sensor_frame) or base_frame
        child = child or _base_in(tree, sensor_frame) or "base_link"
        base = base_frame or (child if tree.connected(child, sensor_frame) else _base_in(tree, sensor_frame)) or child
        picked = (odom_frame or sample.frame_id or "odom", base, "topic", topic, child)
    else:
        picked = _from_frames(recording, tree, sensor_frame, base_frame, odom_frame)
    odom, base, source, topic, child = picked
    if not wanted:
        source, topic = "none", None
    else:
        _say_odometry(recording, source, topic, odom, child, named=odom_topic)
    return OdometryPick(base_frame=base, odom_frame=odom, odometry=source, odom_topic=topic, odom_child_frame=child)


def _from_frames(
    recording: Recording, tree: FrameTree, laser_frame: str, base_frame: str | None, odom_frame: str | None
) -> tuple[str, str, str, Topic | None, str]:
    """Return odom frame, base frame, source, no topic and child frame where there is no Odometry topic."""
    base = base_frame or _base_in(tree, laser_frame)
    odom = odom_frame or next((frame for frame in _ODOM_FRAMES if frame in tree.frames), None)
    if odom is None and base is not None:
        odom = _first_moving_parent(tree, base)
    if odom is not None and base is None:
        base = _child_towards(tree, odom, laser_frame)
    if odom is not None and base is not None and tree.connected(odom, base):
        if not tree.is_static(odom, base):
            return odom, base, "tf", None, base
        recording.log.warn(f"tf: {odom} -> {base} never changes in this recording: not used as odometry")
    return odom or "odom", base or laser_frame, "none", None, base or laser_frame


def _odometry_topic(recording: Recording, named: str | None, *, say: bool) -> Topic | None:
    if named:
        return recording.topic(named, Odometry)
    found = [topic for topic in recording.topics(Odometry) if topic.count != 0]
    usable = usable_odometry(found)
    if usable and len(found) > 1 and say:
        others = ", ".join(topic.name for topic in found if topic != usable[0])
        recording.log.note(f"odometry: {usable[0].name} is used (also there: {others}; choose with --odom-topic)")
    return usable[0] if usable else None


def _say_odometry(
    recording: Recording, source: str, topic: Topic | None, odom: str, child: str, named: str | None
) -> None:
    log = recording.log
    if source == "topic" and topic is not None:
        log.note(f"odometry from topic {topic.name} ({odom} -> {child})")
    elif source == "tf":
        why = "as asked" if named == FROM_TF else "there is no odometry topic"
        log.note(f"odometry from the transform {odom} -> {child} on /tf ({why})")
    elif named == FROM_TF:
        raise RecordingError(
            f"{recording.name}: no odometry in tf: {odom} -> {child} is not among its transforms; "
            f"frames are {', '.join(recording.frames().frames) or 'none'} (choose with --odom-frame and --base-frame)"
        )
    else:
        log.warn(
            "no odometry: neither a nav_msgs/Odometry topic nor a moving transform "
            f"{odom} -> {child} on /tf; only the scans tell how the robot moved"
        )


def _base_in(tree: FrameTree, laser_frame: str) -> str | None:
    """Return the robot's base frame: a usual name above the laser, else a usual name, else the laser's fixed ancestor."""
    above = _ancestors(tree, laser_frame)
    for names in (above, tree.frames):
        for usual in _BASE_FRAMES:
            for frame in names:
                if frame == usual or frame.endswith(f"/{usual}"):
                    return frame
    fixed = None
    for frame in above:
        edge = tree.edge(frame)
        if edge is None or not edge.static:
            return frame if frame != laser_frame or edge is not None else fixed
        fixed = edge.parent
    return fixed


def _ancestors(tree: FrameTree, frame: str) -> list[str]:
    """Return a frame and those above it, empty if the tree does not know it."""
    if frame not in tree.frames:
        return []
    chain = [frame]
    while (parent := tree.parent(chain[-1])) is not None:
        chain.append(parent)
    return chain


def _first_moving_parent(tree: FrameTree, base: str) -> str | None:
    for frame in _ancestors(tree, base):
        edge = tree.edge(frame)
        if edge is not None and not edge.static:
            return edge.parent
    return None


def _child_towards(tree: FrameTree, odom: str, laser_frame: str) -> str | None:
    """Return the frame below `odom` on the way to the laser."""
    above = _ancestors(tree, laser_frame)
    return above[above.index(odom) - 1] if odom in above and above.index(odom) > 0 else None
