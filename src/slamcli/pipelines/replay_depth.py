# SPDX-License-Identifier: MIT
"""When the cells of a map became known to a depth camera: what its images saw, at the poses that a result gave them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.measurements import CameraModel, Image
from slamcli.pipelines.replay_images import mount_of, nearest
from slamcli.recordings import Mends, Recording, Topic, open_recording
from slamcli.recordings.camera_topics import find_model
from slamcli.recordings.topic_decoder import TopicDecoder
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

_MOST_IMAGES = 400
_MOST_RAYS = 2500
"""Of one image."""
_FARTHEST_M = 8.0
_APART_NS = 50_000_000
"""How far an image may be from its pose."""


def follow_depth(
    files: Sequence[Path],
    run: Mapping[str, Any],
    trajectory: Trajectory,
    grid: OccupancyGrid,
    mends: Mends | None,
    log: RunLog,
) -> NDArray[np.int32] | None:
    """Return int32 (H, W), when the cells of a map became known, of at most 400 images spread over the recording.

    None where the run used no depth images, their camera is not known, or none fits to a pose. Depths are used to 8 m.

    Raises
    ------
    InputError
        If the recording cannot be read.
    """
    topics = run.get("topics")
    name = topics.get("depth") if isinstance(topics, dict) else None
    if not isinstance(name, str):
        return None
    with open_recording(list(files), mends=mends, log=RunLog()) as recording:
        topic = next((t for t in recording.topics(Image) if t.name == name and t.count != 0), None)
        camera = None if topic is None else find_model(recording, name)
        if topic is None or camera is None:
            return None
        from slamcli.grids.first_seen import FirstSeen

        seen = FirstSeen(grid)
        order = np.argsort(trajectory.stamps_ns, kind="stable")
        stamps, T_map_base = trajectory.stamps_ns[order], trajectory.transforms
        with log.stage("replay depth"):
            for image in _some(recording, topic):
                place = int(nearest(stamps, np.array([image.stamp_ns]))[0])
                if abs(int(stamps[place]) - image.stamp_ns) > _APART_NS:
                    continue
                index = int(order[place])
                T = T_map_base[index] @ mount_of(recording, trajectory.child_frame_id, image.frame_id)
                points = _points(image, camera) @ T[:3, :3].T + T[:3, 3]
                seen.add_rays(index, T[:2, 3], points[:, :2])
        return seen.result()


def _some(recording: Recording, topic: Topic) -> Iterator[Image]:
    """Yield images spread over the recording; the others are not decoded."""
    decoder = TopicDecoder(topic, recording.raw, recording.mends, RunLog())
    every = max(1, math.ceil((topic.count or 0) / _MOST_IMAGES))
    for i, message in enumerate(recording.raw.messages((topic.name,))):
        if i % every == 0 and decoder.accepts(message):
            yield from decoder.decode(message, decoder.stamp_ns(message))


def _points(image: Image, camera: CameraModel) -> NDArray[np.float64]:
    """Return points (N, 3) in the camera's frame, as a pinhole sees them: lens distortion moves them less than a cell."""
    depth = np.asarray(image.pixels, dtype=np.float64)
    step = max(1, math.ceil(math.sqrt(depth.size / _MOST_RAYS)))
    rows, columns = np.mgrid[step // 2 : depth.shape[0] : step, step // 2 : depth.shape[1] : step]
    z = depth[rows, columns]
    there = np.isfinite(z) & (z > 0) & (z < _FARTHEST_M)
    k = camera.intrinsics
    x = (columns[there] - k[0, 2]) / k[0, 0] * z[there]
    y = (rows[there] - k[1, 2]) / k[1, 1] * z[there]
    return np.column_stack([x, y, z[there]])
