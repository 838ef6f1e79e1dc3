# SPDX-License-Identifier: MIT
"""What the range sensor of a recording saw, read once and thinned, for figures that need no ground truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import InputError
from slamcli.evaluation.seen_points import SeenPoints
from slamcli.geometry import se3
from slamcli.mapper import InputPlan
from slamcli.measurements import Image, LaserScan, PointCloud, RgbdFrame, StereoPair
from slamcli.pipelines.camera_calibration import load_calibration
from slamcli.pipelines.camera_finding import CameraRequest, found_cameras
from slamcli.pipelines.camera_input import CameraFeed, planned_cameras
from slamcli.pipelines.scan_cloud import cloud_of
from slamcli.recordings import Mends, Recording, Topic, open_recording
from slamcli.recordings.camera_topics import CameraNames
from slamcli.recordings.laser_mount import find_cloud_mount, find_laser_mount
from slamcli.recordings.scan_normalisation import normalise_scans
from slamcli.recordings.sensor_picks import NONE, lies_flat
from slamcli.recordings.topic_ranks import CLOUDS, SCANS, ranked
from slamcli.runtime import RunLog
from slamcli.vision.dense_depth import usable_depth
from slamcli.vision.preparation import Preparation
from slamcli.vision.stereo_depth import stereo_depth

T = TypeVar("T")

_MOST_POINTS = 400_000
_MOST_SCANS, _MOST_CLOUDS, _MOST_FRAMES = 4000, 1500, 200
_DEPTH_RANGE_M = 5.0
_STEREO_BASELINES = 40.0
"""Depth of a stereo pair beyond so many baselines is left out: its error grows with the square of the distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointsRequest:
    """Of which recording, and which part of it, points are wanted."""

    inputs: Sequence[Path]
    mends: Mends = field(default_factory=Mends)
    start_s: float | None = None
    duration_s: float | None = None
    scan_topics: Sequence[str] = ()
    """Named by the user, as the next; empty: found."""
    points_topics: Sequence[str] = ()
    cameras: CameraNames = field(default_factory=CameraNames)
    camera_files: Sequence[Path] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedPoints:
    """What the sensor saw, and where it sits."""

    seen: SeenPoints
    T_base_sensor: dict[str, NDArray[np.float64]]
    """Mount by base frame, float64 (4, 4)."""


class _View(NamedTuple):
    stamp_ns: int
    points_m: NDArray[np.float32]
    offset_ns: NDArray[np.int64] | None


def read_points(request: PointsRequest, base_frames: Iterable[str], log: RunLog) -> RecordedPoints | None:
    """Return what the recording's best range sensor saw: a planar scanner, else clouds, else depth or stereo images; None: it has none.

    Parameters
    ----------
    base_frames
        Frames whose poses the points are to be put at.

    Raises
    ------
    InputError
        If the recording cannot be read.
    """
    quiet = RunLog(log.progress)  # what there is to say of a recording was said by those who mapped it
    with open_recording(list(request.inputs), mends=request.mends, log=quiet) as recording:
        scan = _first(ranked(recording.topics(LaserScan), SCANS), request.scan_topics)
        if scan is not None:
            return _read_scans(recording, scan, request, base_frames, quiet)
        cloud = _first(ranked(recording.topics(PointCloud), CLOUDS), request.points_topics)
        if cloud is not None:
            return _read_clouds(recording, cloud, request, base_frames)
        return _read_images(recording, request, base_frames, quiet)


def _first(topics: Iterable[Topic], named: Sequence[str]) -> Topic | None:
    names = {name.lstrip("/") for name in named}
    return next((t for t in topics if t.count != 0 and (not names or t.name.lstrip("/") in names)), None)


def _read_scans(
    recording: Recording, topic: Topic, request: PointsRequest, base_frames: Iterable[str], log: RunLog
) -> RecordedPoints | None:
    def scans() -> Iterator[LaserScan]:
        return recording.measurements([topic], start_s=request.start_s, duration_s=request.duration_s)

    first = next(scans(), None)
    if first is None:
        return None
    mounts = {
        base: find_laser_mount(recording, base_frame=base, laser_frame=first.frame_id)
        for base in sorted(set(base_frames))
    }
    upside_down = any(mount.upside_down for mount in mounts.values())
    views = (
        _View(cloud.stamp_ns, cloud.points_m, cloud.offset_ns)
        for scan in _every(normalise_scans(scans(), mirrored=upside_down, log=log), topic.count, _MOST_SCANS)
        for cloud in (cloud_of(scan),)
    )
    seen = _collected(views, first.frame_id, topic.name, planar=True)
    return RecordedPoints(seen=seen, T_base_sensor={base: mount.T_base_laser for base, mount in mounts.items()})


def _read_clouds(
    recording: Recording, topic: Topic, request: PointsRequest, base_frames: Iterable[str]
) -> RecordedPoints | None:
    clouds: Iterator[PointCloud] = recording.measurements(
        [topic], start_s=request.start_s, duration_s=request.duration_s
    )
    first = next(clouds, None)
    if first is None:
        return None
    rest = recording.measurements([topic], start_s=request.start_s, duration_s=request.duration_s)
    views = (_View(c.stamp_ns, c.points_m, c.offset_ns) for c in _every(rest, topic.count, _MOST_CLOUDS))
    seen = _collected(views, first.frame_id, topic.name, planar=lies_flat(first))
    mounts = {
        base: find_cloud_mount(recording, base_frame=base, cloud_frame=first.frame_id).T_base_laser
        for base in sorted(set(base_frames))
    }
    return RecordedPoints(seen=seen, T_base_sensor=mounts)


def _read_images(
    recording: Recording, request: PointsRequest, base_frames: Iterable[str], log: RunLog
) -> RecordedPoints | None:
    """Return the points of depth images, else of stereo pairs; None without either."""
    if not any(topic.count != 0 for topic in recording.topics(Image)):
        return None
    wanted = CameraRequest(
        names=request.cameras, imu=NONE, calibration=load_calibration(request.camera_files), start_s=request.start_s,
        duration_s=request.duration_s,
    )  # fmt: skip
    try:
        found = found_cameras(recording, wanted)
        mode = next((mode for mode in ("rgbd", "stereo") if mode in found.topics.modes), None)
        if mode is None:
            return None
        feed = planned_cameras(recording, InputPlan(parameters=None, camera_mode=mode), wanted, found, log)
        seen = _collected(_depth_views(feed), feed.built.camera_frame, feed.main, planar=False)
    except InputError as error:
        log.note(f"no points of the cameras: {error}")
        return None
    return RecordedPoints(
        seen=seen, T_base_sensor={base: _camera_mount(recording, feed, base) for base in set(base_frames)}
    )


def _camera_mount(recording: Recording, feed: CameraFeed, base: str) -> NDArray[np.float64]:
    tree = recording.frames()
    if base != feed.base_frame and tree.connected(base, feed.base_frame):
        return tree.lookup(base, feed.base_frame) @ feed.rig.T_base_main
    return feed.rig.T_base_main


def _depth_views(feed: CameraFeed) -> Iterator[_View]:
    """Yield what frames see, in the frame of the main camera."""
    preparation = Preparation(feed.rig)
    camera = preparation.camera
    T_main_ideal = se3.inverse(feed.rig.T_base_main) @ preparation.T_base_camera
    most_m = _DEPTH_RANGE_M if feed.rig.mode == "rgbd" else _STEREO_BASELINES * camera.baseline_m
    count = feed.recording.topic(feed.main).count
    frames = (m for m in feed.measurements() if isinstance(m, (RgbdFrame, StereoPair)))
    step = max(int((preparation.width * preparation.height / (_MOST_POINTS / _MOST_FRAMES)) ** 0.5), 1)
    row, column = np.mgrid[step // 2 : preparation.height : step, step // 2 : preparation.width : step]
    row, column = row.ravel(), column.ravel()
    for frame in _every(frames, count, _MOST_FRAMES):
        prepared = preparation.prepare(frame)
        depth = prepared.depth
        if depth is None and prepared.right is not None:
            depth = stereo_depth(prepared.grey, prepared.right, camera, semi_global=False)
        if depth is None:
            continue
        metres = usable_depth(depth, most_m)[row, column].astype(np.float64)
        pixels = np.column_stack([column, row]).astype(np.float64)
        if not preparation.resampled and feed.rig.mode == "rgbd":
            pixels = preparation.to_pinhole(pixels).pixels
        good = (metres > 0) & np.isfinite(pixels[:, 0])
        points = camera.back_project(pixels[good], metres[good]) @ T_main_ideal[:3, :3].T + T_main_ideal[:3, 3]
        yield _View(frame.stamp_ns, points.astype(np.float32), None)


def _every(found: Iterable[T], count: int | None, most: int) -> Iterator[T]:
    """Yield every n-th, so that at most about `most` come of `count`."""
    return islice(iter(found), 0, None, max(-(-(count or 0) // most), 1))


def _collected(views: Iterable[_View], frame_id: str, topic: str, *, planar: bool) -> SeenPoints:
    """Return the views' points, of each view every n-th where there are too many."""
    stamps: list[int] = []
    kept: list[NDArray[np.float32]] = []
    offsets: list[NDArray[np.int64]] = []
    for view in views:
        stamps.append(view.stamp_ns)
        finite = np.isfinite(view.points_m).all(axis=1)
        kept.append(view.points_m[finite])
        none = np.zeros(len(view.points_m), dtype=np.int64)
        offsets.append((none if view.offset_ns is None else view.offset_ns)[finite])
        if len(kept[-1]) > 20_000:  # a spinning scanner's cloud: no figure needs more
            step = -(-len(kept[-1]) // 20_000)
            kept[-1], offsets[-1] = kept[-1][::step].copy(), offsets[-1][::step].copy()
    total = sum(len(points) for points in kept)
    step = max(-(-total // _MOST_POINTS), 1)
    # Each view begins at another of its points, so that no direction is left out in all of them.
    picks = [np.arange(i % step, len(points), step) for i, points in enumerate(kept)]
    return SeenPoints(
        stamps_ns=np.array(stamps, dtype=np.int64),
        view=np.repeat(np.arange(len(kept)), [len(pick) for pick in picks]),
        points_m=np.concatenate([p[i] for p, i in zip(kept, picks, strict=True)] or [np.zeros((0, 3), dtype=np.float32)]),
        offset_ns=np.concatenate([o[i] for o, i in zip(offsets, picks, strict=True)] or [np.zeros(0, dtype=np.int64)]),
        frame_id=frame_id, topic=topic, planar=planar,
    )  # fmt: skip
