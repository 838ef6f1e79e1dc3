# SPDX-License-Identifier: MIT
"""The frame tree of a recording: every static transform first, then /tf."""

from __future__ import annotations

import math
from itertools import islice
from typing import TYPE_CHECKING, Any

from slamcli.errors import SlamcliError
from slamcli.geometry.frame_tree import FrameTree, FrameTreeBuilder
from slamcli.recordings.adapters import DecodeContext
from slamcli.recordings.adapters.tf_message import ADAPTER as TF_ADAPTER
from slamcli.recordings.adapters.tf_message import is_static_topic

if TYPE_CHECKING:
    from slamcli.recordings.raw import Topic
    from slamcli.recordings.recording import Recording

_FARTHEST_M = 1e12
_LARGEST_QUATERNION = 1e6


def is_transform_topic(topic: Topic) -> bool:
    """Return whether a topic holds transforms (tf or tf_static)."""
    return topic.msgtype in TF_ADAPTER.msgtypes


def transform_topics(recording: Recording) -> tuple[tuple[Topic, ...], tuple[Topic, ...]]:
    """Return the topics of static and of stamped transforms (TFMessage)."""
    found = [topic for topic in recording.contents.topics if is_transform_topic(topic)]
    static = tuple(topic for topic in found if is_static_topic(topic.name))
    return static, tuple(topic for topic in found if topic not in static)


def read_frames(recording: Recording, *, stop_ns: int | None = None) -> FrameTree:
    """Return the frame tree of a recording with its mends.

    Parameters
    ----------
    stop_ns
        Read /tf only up to this log time (for a quick look at a big file), and no further than to the last message of
        /tf_static; None for all.
    """
    builder = FrameTreeBuilder()
    static, stamped = transform_topics(recording)
    for topics, is_static in ((static, True), (stamped, False)):
        if not topics:
            continue
        contexts = {topic.name: DecodeContext(topic.name, recording.mends, recording.log) for topic in topics}
        last = None if is_static else stop_ns
        # Where counts are known the pass ends at the last message: static transforms stand at the start of big files.
        total = None if any(topic.count is None for topic in topics) else sum(topic.count or 0 for topic in topics)
        for message in islice(recording.raw.messages(tuple(contexts), None, last), total):
            context = contexts[message.topic]
            try:
                transforms = recording.raw.decode(message).transforms
                for transform in transforms:
                    _add(builder, transform, message.log_time_ns, context, is_static)
            except (SlamcliError, ValueError, AttributeError, TypeError):
                context.count("messages that cannot be decoded")
    for given in recording.mends.static_transforms:
        builder.override(given.parent_frame_id, given.child_frame_id, given.position_m, given.quat_xyzw)
    for joint in recording.mends.model_transforms:
        builder.fall_back(joint.parent_frame_id, joint.child_frame_id, joint.position_m, joint.quat_xyzw)
    tree = builder.build()
    for problem in tree.problems:
        recording.log.warn(f"tf: {problem}")
    return tree


def _add(builder: FrameTreeBuilder, message: Any, log_time_ns: int, context: DecodeContext, is_static: bool) -> None:
    parent, child = context.frame(message.header.frame_id), context.frame(message.child_frame_id)
    t, q = message.transform.translation, message.transform.rotation
    position, quat = (t.x, t.y, t.z), (q.x, q.y, q.z, q.w)
    plausible = math.hypot(*position) < _FARTHEST_M and math.hypot(*quat) < _LARGEST_QUATERNION
    if not plausible or not child:
        context.count("transforms that are not finite or name no frame")
        return
    if is_static:
        builder.add_static(parent, child, position, quat)
    else:
        stamp_ns = context.stamp_ns(message.header.stamp, log_time_ns + context.offset_ns)
        builder.add(parent, child, stamp_ns, position, quat)
