# SPDX-License-Identifier: MIT
"""The images that a result was made of, or that were recorded besides, at its keyframes; each is read when it is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, SlamcliError
from slamcli.measurements import Image
from slamcli.pipelines.replay_tracks import GraphTrack, ReplayImage
from slamcli.recordings import Mends, Recording, Topic, open_recording
from slamcli.recordings.camera_topics import colour_name_rank, find_model, first_image
from slamcli.recordings.previews import jpeg_preview
from slamcli.recordings.topic_decoder import TopicDecoder
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

_MOST_IMAGES = 300
_FARTHEST_NS = 500_000_000
"""How far an image may be from the pose that it is shown at."""
_ROLES = ("rgb", "left")


def find_images(
    files: Sequence[Path], run: Mapping[str, Any], trajectory: Trajectory, graph: GraphTrack | None,
    mends: Mends | None, log: RunLog,
) -> tuple[ReplayImage, ...]:  # fmt: skip
    """Return at most 300 images of the main camera, in the order of time: those at nodes of the graph, or spread over the trajectory.

    The camera is the one that the run used, or the recording's best colour camera. A recording that cannot be read is said as a warning.
    """
    if not files:
        return ()
    try:
        with open_recording(list(files), mends=mends, log=RunLog()) as recording:
            topic = _topic(recording, run)
            if topic is None:
                return ()
            with log.stage("replay images"):
                times = _times(recording, topic)
            return _chosen(recording, topic, times, files, trajectory, graph)
    except SlamcliError as error:
        log.warn(f"images are left out: {error}")
        return ()


def _topic(recording: Recording, run: Mapping[str, Any]) -> Topic | None:
    used = run.get("topics")
    found = {topic.name: topic for topic in recording.topics(Image) if topic.count != 0}
    for role in _ROLES:
        name = used.get(role) if isinstance(used, dict) else None
        if isinstance(name, str) and name in found:
            return found[name]
    for name in sorted(found, key=lambda name: (*colour_name_rank(name), name)):
        first = first_image(recording, found[name])
        if first is not None and first.encoding != "depth":
            return found[name]
    return None


def _times(recording: Recording, topic: Topic) -> NDArray[np.int64]:
    """Return int64 (M, 3): stamp, log time, and how many messages of that log time came before; nothing is decoded."""
    decoder = TopicDecoder(topic, recording.raw, recording.mends, RunLog())
    rows: list[tuple[int, int, int]] = []
    for message in recording.raw.messages((topic.name,)):
        if decoder.accepts(message):
            same = rows[-1][2] + 1 if rows and rows[-1][1] == message.log_time_ns else 0
            rows.append((decoder.stamp_ns(message), message.log_time_ns, same))
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def _chosen(
    recording: Recording, topic: Topic, times: NDArray[np.int64], files: Sequence[Path],
    trajectory: Trajectory, graph: GraphTrack | None,
) -> tuple[ReplayImage, ...]:  # fmt: skip
    wanted = np.unique(trajectory.stamps_ns if graph is None else graph.stamps_ns)
    wanted = wanted[:: max(1, math.ceil(len(wanted) / _MOST_IMAGES))]
    order = np.argsort(times[:, 0], kind="stable")
    at = np.unique(order[nearest(times[order, 0], wanted)]) if len(times) else np.zeros(0, dtype=np.int64)
    rows = times[at][np.argsort(times[at, 0], kind="stable")]
    by_time = np.argsort(trajectory.stamps_ns, kind="stable")
    poses = by_time[nearest(trajectory.stamps_ns[by_time], rows[:, 0])] if len(rows) else at
    first = first_image(recording, topic)
    frame = "" if first is None else first.frame_id
    T_base_camera = mount_of(recording, trajectory.child_frame_id, frame)
    camera = find_model(recording, topic.name)
    return tuple(
        ReplayImage(
            stamp_ns=stamp, topic=topic.name, pose_index=pose, frame_id=frame, T_base_camera=T_base_camera, camera=camera,
            load=_loader(tuple(files), recording.mends, topic.name, stamp, log_time, place),
        )
        for (stamp, log_time, place), pose in zip(rows.tolist(), poses.tolist(), strict=True)
        if abs(int(trajectory.stamps_ns[pose]) - stamp) <= _FARTHEST_NS
    )  # fmt: skip


def nearest(stamps_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each wanted stamp the place of the nearest of sorted ones, the earlier of two."""
    after = np.clip(np.searchsorted(stamps_ns, wanted_ns), 0, len(stamps_ns) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(wanted_ns - stamps_ns[before]) <= np.abs(stamps_ns[after] - wanted_ns)
    return np.where(nearer, before, after).astype(np.int64)


def mount_of(recording: Recording, base: str, camera: str) -> NDArray[np.float64]:
    """Return where the camera sits, float64 (4, 4); at the base itself where no transform tells."""
    tree = recording.frames()
    if base == camera or not camera or base not in tree.frames or camera not in tree.frames:
        return np.eye(4)
    return tree.lookup(base, camera) if tree.connected(base, camera) else np.eye(4)


def _loader(
    files: tuple[Path, ...], mends: Mends, topic: str, stamp_ns: int, log_time_ns: int, place: int
) -> Callable[[int], bytes]:
    def load(max_width: int) -> bytes:
        with open_recording(files, mends=mends, log=RunLog()) as recording:
            decoder = TopicDecoder(recording.topic(topic, Image), recording.raw, recording.mends, RunLog())
            found = (m for m in recording.raw.messages((topic,), log_time_ns, log_time_ns + 1) if decoder.accepts(m))
            for i, message in enumerate(found):
                images = decoder.decode(message, stamp_ns) if i == place else ()
                if images:
                    return jpeg_preview(images[0], max_width)
        raise DataError(f"{files[0]}: {topic}: the image at {stamp_ns / 1e9:.3f} s cannot be read")

    return load
