# SPDX-License-Identifier: MIT
"""Images, statistics and words of a replay as messages."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from slamcli.measurements import CameraModel
from slamcli.pipelines.replay import Replay
from slamcli.pipelines.replay_tracks import GraphTrack
from slamcli.recordings.adapters import ImageFile, LogLine, StampedNumber
from slamcli.reports.mcap_clock import Clock, Entry

IMAGE_TOPIC, INFO_TOPIC = "/camera/image/compressed", "/camera/camera_info"
_IMAGE_WIDTH = 640
_MOST_STEPS = 3000
_NOT_PLOTTED = ("stamp_ns", "scan_index", "node", "map_id")
_MOST_LINES = 500


def images(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/camera/image/compressed`` and its ``/camera/camera_info``: JPEG files no wider than 640 pixels."""
    for image in replay.images:
        stamp = clock.log_ns(image.stamp_ns)
        if image.camera is not None:
            yield Entry(stamp, INFO_TOPIC, replace(_shrunk(image.camera), stamp_ns=stamp, frame_id=image.frame_id))
        data = image.jpeg(_IMAGE_WIDTH)
        yield Entry(
            stamp, IMAGE_TOPIC, ImageFile(stamp_ns=stamp, frame_id=image.frame_id, data=data), "sensor_msgs/msg/CompressedImage"
        )  # fmt: skip


def steps(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/steps/NAME`` for each figure that the tier keeps of its steps, where it is a number."""
    columns = replay.run.get("steps")
    if not isinstance(columns, dict):
        return
    stamps = columns.get("stamp_ns")
    if not isinstance(stamps, list) or not all(isinstance(stamp, int) for stamp in stamps):
        return
    every = max(1, math.ceil(len(stamps) / _MOST_STEPS))
    usable = {
        name: values
        for name, values in sorted(columns.items())
        if name not in _NOT_PLOTTED and isinstance(values, list) and len(values) == len(stamps)
    }
    for i in np.argsort(np.array(stamps, dtype=np.int64), kind="stable")[::every].tolist():
        stamp = clock.log_ns(stamps[i])
        for name, values in usable.items():
            if isinstance(values[i], (int, float)):
                yield Entry(stamp, f"/steps/{name}", StampedNumber(stamp_ns=stamp, value=float(values[i])))


def log_lines(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/rosout``: what the run noted and warned of, at the start, and then loops and submaps as they come to be."""
    name = replay.algo or "slamcli"
    begin = clock.begin_ns
    said = [LogLine(stamp_ns=begin, level="info", name=name, text=text) for text in _texts(replay.run, "notes")]
    said += [LogLine(stamp_ns=begin, level="warning", name=name, text=text) for text in _texts(replay.run, "warnings")]
    yield from (Entry(begin, "/rosout", line) for line in said)
    for stamp, text in sorted(_events(replay, clock))[:_MOST_LINES]:
        yield Entry(stamp, "/rosout", LogLine(stamp_ns=stamp, level="info", name=name, text=text))


def _events(replay: Replay, clock: Clock) -> Iterator[tuple[int, str]]:
    """Yield when what came to be."""
    if replay.submaps is not None:
        for name, stamp in zip(replay.submaps.names, replay.submaps.finished_ns.tolist(), strict=True):
            yield clock.log_ns(stamp), f"submap {name} is finished"
    graph = replay.graph
    if graph is None:
        return
    loops = graph.kinds == GraphTrack.KINDS.index("loop")
    times, first, counts = np.unique(graph.edge_stamps_ns[loops], return_index=True, return_counts=True)
    for stamp, place, count in zip(times.tolist(), np.flatnonzero(loops)[first].tolist(), counts.tolist(), strict=True):
        older, newer = sorted(graph.edges[place].tolist())
        others = f" and {count - 1} more" if count > 1 else ""
        yield clock.log_ns(stamp), f"a loop is closed between nodes {older} and {newer}{others}"


def _texts(run: Mapping[str, Any], key: str) -> list[str]:
    values = run.get(key)
    return [text for text in values if isinstance(text, str)] if isinstance(values, list) else []


def _shrunk(camera: CameraModel) -> CameraModel:
    """Return the calibration of images that are no wider than 640 pixels."""
    if camera.width <= _IMAGE_WIDTH:
        return camera
    height = max(1, round(camera.height * _IMAGE_WIDTH / camera.width))
    scale = np.diag([_IMAGE_WIDTH / camera.width, height / camera.height, 1.0])
    return replace(
        camera,
        width=_IMAGE_WIDTH,
        height=height,
        intrinsics=scale @ camera.intrinsics,
        projection=scale @ camera.projection,
    )
