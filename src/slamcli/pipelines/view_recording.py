# SPDX-License-Identifier: MIT
"""The picture of a recording: its topics over time, and where odometry and scanner say that the robot was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.measurements import LaserScan, Odometry, StampedPose
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.view_alignment import laid_over
from slamcli.pipelines.view_images import image_rows
from slamcli.pipelines.view_recorded_map import last_map
from slamcli.recordings import Recording, Topic, open_recording
from slamcli.recordings.laser_mount import find_laser_mount
from slamcli.reports.figures import raster, timeline, track
from slamcli.reports.figures.strip import strip_image
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

if TYPE_CHECKING:
    from slamcli.pipelines.view import ViewOptions

_TRUTH_WORDS = ("truth", "base_pose", "gt_pose", "groundtruth", "mocap", "vicon")
_ODOM_FRAMES = ("odom", "odom_combined", "odometry", "map", "world")
_BASE_FRAMES = ("base_footprint", "base_link")
_MOST_BEAMS = 1000
_MOST_PATHS = 5


@dataclass(slots=True)
class _Count:
    """Messages of one topic while they are counted."""

    columns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(timeline.BINS, dtype=np.int64))
    number: int = 0
    first_ns: int = 0
    last_ns: int = 0
    largest_gap_ns: int = 0

    def take(self, stamp_ns: int, column: int) -> None:
        if self.number:
            self.largest_gap_ns = max(self.largest_gap_ns, stamp_ns - self.last_ns)
        else:
            self.first_ns = stamp_ns
        self.last_ns = stamp_ns
        self.number += 1
        self.columns[column] += 1

    @property
    def rate_hz(self) -> float | None:
        span = self.last_ns - self.first_ns
        return (self.number - 1) * 1e9 / span if self.number > 2 and span > 1e8 else None


def draw_recording(sources: Sequence[Path], options: ViewOptions, log: RunLog) -> tuple[bytes, dict[str, Any]]:
    """Return a PNG and facts of a recording: topics by log time, what its cameras saw, odometry with scans on it.

    The first odometry topic (or transforms, or poses) places the scans; other odometry and pose topics are drawn beside it.
    """
    with open_recording(list(sources), mends=options.mends, log=log) as recording:
        start_ns, stop_ns = recording.window(options.start_s, options.duration_s)
        low = start_ns if start_ns is not None else recording.start_ns
        high = min(stop_ns if stop_ns is not None else recording.end_ns, recording.end_ns)
        with log.stage("topics over time"):
            counts = _count(recording, start_ns, stop_ns, low, high)
        name = sources[0].resolve().name
        title = name if options.title is None else options.title
        span_s = max(high - low, 0) / 1e9
        picture = timeline.timeline_image(_rows(recording, counts), span_s, title)
        facts: dict[str, Any] = {"duration_s": span_s, "topics": _topic_facts(recording, counts)}
        with log.stage("images"):
            strip = strip_image(image_rows(recording, options.start_s, options.duration_s))
        picture = timeline.stacked(picture, strip) if strip.size else picture
        with log.stage("odometry and scans"):
            drawn = _paths_and_scans(recording, options, log)
        _lay_over(drawn, options, log)
        with log.stage("map"):
            shown = last_map(recording, options)
    if drawn.paths or drawn.truth or len(drawn.points_m):
        (label, first), *others = drawn.paths or [("", _no_poses())]
        below = track.track_image(
            first,
            others[:_MOST_PATHS],
            truth=drawn.truth,
            points_m=drawn.points_m,
            label=label,
            title=drawn.title,
            max_pixels=min(1200, options.max_pixels),
        )
        picture = timeline.stacked(picture, below)
        facts["paths"] = [{"source": n, "poses": len(t), "length_m": t.length_m} for n, t in drawn.paths]
        facts["scans_drawn"] = drawn.num_scans
    if shown is not None:
        picture = timeline.stacked(picture, shown.image(min(1200, options.max_pixels)))
        facts["map"] = shown.facts()
    return raster.png(picture), facts


def _count(recording: Recording, start_ns: int | None, stop_ns: int | None, low: int, high: int) -> dict[str, _Count]:
    """Return how the messages of each topic lie over the log time from `low` to `high`."""
    counts = {topic.name: _Count() for topic in recording.contents.topics}
    scale = timeline.BINS / max(high - low, 1)
    last = timeline.BINS - 1
    for message in recording.raw.messages(None, start_ns, stop_ns):
        stamp = message.log_time_ns
        counts.setdefault(message.topic, _Count()).take(stamp, min(max(int((stamp - low) * scale), 0), last))
    return counts


def _rows(recording: Recording, counts: dict[str, _Count]) -> list[timeline.Row]:
    types = {topic.name: topic.msgtype.rsplit("/", 1)[-1] for topic in recording.contents.topics}
    rows = []
    for name, count in sorted(counts.items()):
        told = f"{types.get(name, '?')}   {count.number:,}"
        if count.rate_hz is not None:
            told += f"   {count.rate_hz:.3g} Hz   longest pause {count.largest_gap_ns / 1e9:.2g} s"
        rows.append(timeline.Row(name=name, counts=count.columns, fact=told))
    return rows


def _topic_facts(recording: Recording, counts: dict[str, _Count]) -> list[dict[str, Any]]:
    types = {topic.name: topic.msgtype for topic in recording.contents.topics}
    return [
        {
            "name": name,
            "type": types.get(name, ""),
            "count": count.number,
            "rate_hz": count.rate_hz,
            "largest_gap_s": count.largest_gap_ns / 1e9 if count.number > 1 else None,
        }
        for name, count in sorted(counts.items())
    ]


@dataclass(slots=True)
class _Drawn:
    """What is drawn below the timeline."""

    truth: tuple[str, Trajectory] | None = None
    paths: list[tuple[str, Trajectory]] = field(default_factory=list)
    points_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    num_scans: int = 0
    title: str = ""


def _paths_and_scans(recording: Recording, options: ViewOptions, log: RunLog) -> _Drawn:
    drawn = _Drawn()
    pose_topics = sorted(
        (t for kind in (Odometry, StampedPose) for t in recording.topics(kind) if t.count != 0 and not _is_request(t)),
        key=_preference,
    )
    for topic in pose_topics[: _MOST_PATHS + 1]:
        trajectory = _read_path(recording, topic, options)
        if not len(trajectory):
            continue
        is_named = trajectory.frame_id not in ("", topic.name.strip("/"))
        label = f"{topic.name} in {trajectory.frame_id}" if is_named else topic.name
        if drawn.paths and drawn.truth is None and _is_truth(topic):
            drawn.truth = (label, trajectory)
        else:
            drawn.paths.append((label, trajectory))
    scan_topics = sorted((t for t in recording.topics(LaserScan) if t.count != 0), key=lambda t: -(t.count or 0))
    if not scan_topics:
        return drawn
    topic = scan_topics[0]
    scans = _read_scans(recording, topic, options) if options.scans else []
    if not scans:
        return drawn
    stamps = np.array([scan.stamp_ns for scan in scans], dtype=np.int64)
    poses = _scanner_poses(recording, drawn, scans[0].frame_id, stamps)
    if poses is None:
        log.note(
            f"{topic.name}: neither odometry nor transforms say where the scanner was; only its first scan is drawn"
        )
        scans, poses = scans[:1], np.eye(4)[None]
    hits = [_end_points(scan) for scan in scans]
    # Height is left out last, so that a scanner that hangs upside down is drawn as it sees.
    drawn.points_m = np.concatenate([hit @ T[:2, :2].T + T[:2, 3] for T, hit in zip(poses, hits, strict=True)])
    drawn.num_scans = len(scans)
    told = "1 scan" if len(scans) == 1 else f"{len(scans)} scans"
    drawn.title = f"{told} of {topic.name}" + (f" on {drawn.paths[0][0]}" if drawn.paths else "")
    return drawn


def _lay_over(drawn: _Drawn, options: ViewOptions, log: RunLog) -> None:
    """Move what is drawn beside the first path into its frame."""
    if options.truth is not None:
        drawn.truth = ("ground truth", load_trajectory(options.truth, log=log))
    if not drawn.paths:
        return
    first = drawn.paths[0][1]

    def moved(name: str, path: Trajectory) -> tuple[str, Trajectory]:
        same_frame = path.frame_id == first.frame_id and name != "ground truth"
        how = options.align if options.align != "auto" else "none" if same_frame else "start"
        return laid_over(first, name, path, how, log)

    drawn.paths[1:] = [moved(*path) for path in drawn.paths[1:]]
    drawn.truth = moved(*drawn.truth) if drawn.truth is not None else None


def _preference(topic: Topic) -> tuple[bool, bool, bool, str]:
    """Order topics: odometry before poses, dead reckoning before ground truth."""
    name = topic.name.lower()
    return "Odometry" not in topic.msgtype, _is_truth(topic), "odom" not in name, name


def _is_truth(topic: Topic) -> bool:
    """Return whether a topic's name says that it is ground truth."""
    return any(word in topic.name.lower() for word in _TRUTH_WORDS)


def _is_request(topic: Topic) -> bool:
    """Return whether a topic's name says that its poses are where a robot should be, not where it was."""
    name = topic.name.lower().rpartition("/")[2]
    return "goal" in name or name == "initialpose"


def _read_path(recording: Recording, topic: Topic, options: ViewOptions) -> Trajectory:
    stamps, poses, frames = [], [], ("", "")
    for m in recording.measurements([topic], start_s=options.start_s, duration_s=options.duration_s):
        stamps.append(m.stamp_ns)
        poses.append((*m.position_m, *m.quat_xyzw))
        frames = (m.frame_id, m.child_frame_id)
    rows = np.array(poses, dtype=np.float64).reshape(-1, 7)
    return Trajectory(np.array(stamps, dtype=np.int64), rows[:, :3].copy(), rows[:, 3:].copy(), *frames)


def _read_scans(recording: Recording, topic: Topic, options: ViewOptions) -> list[LaserScan]:
    """Return scans spread evenly over the part of the recording."""
    kept: list[LaserScan] = []
    stride = 1
    found = recording.measurements([topic], start_s=options.start_s, duration_s=options.duration_s)
    for i, scan in enumerate(found):
        if i % stride == 0:
            kept.append(scan)
            if len(kept) >= 2 * options.scans:  # the count is not known beforehand: thin out as they come
                kept, stride = kept[::2], stride * 2
    if len(kept) <= options.scans:
        return kept
    chosen = np.linspace(0, len(kept) - 1, options.scans).round().astype(np.int64)
    return [kept[i] for i in chosen.tolist()]


def _scanner_poses(
    recording: Recording, drawn: _Drawn, frame_id: str, stamps_ns: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Return ``T_odom_laser`` (N, 4, 4) at scan stamps, None where nothing tells it.

    A path that only transforms tell is added to `drawn`.
    """
    tree = recording.frames()
    if drawn.paths:
        base = drawn.paths[0][1]
        body = base.child_frame_id or next((f for f in _BASE_FRAMES if f in tree.frames), frame_id)
        mount = find_laser_mount(recording, base_frame=body, laser_frame=frame_id)
        return se3.from_se2(_interpolate(base, stamps_ns)) @ mount.T_base_laser
    for root in _ODOM_FRAMES:
        if root in tree.frames and tree.connected(root, frame_id) and not tree.is_static(root, frame_id):
            T_root_laser, known = tree.lookup_many(root, frame_id, stamps_ns)
            if known.any():
                name = f"transforms {root} > {frame_id}"
                drawn.paths.append((name, Trajectory.from_se2(stamps_ns, se3.to_se2(T_root_laser), root, frame_id)))
                return T_root_laser
    return None


def _interpolate(base: Trajectory, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return planar poses (N, 3) at stamps, linear between neighbours, held outside."""
    order = np.argsort(base.stamps_ns, kind="stable")
    begin = int(base.stamps_ns[order[0]])
    known = (base.stamps_ns[order] - begin).astype(np.float64)
    at = (stamps_ns - begin).astype(np.float64)
    poses = base.poses_se2[order]
    poses[:, 2] = np.unwrap(poses[:, 2])
    return np.column_stack([np.interp(at, known, poses[:, i]) for i in range(3)])


def _end_points(scan: LaserScan) -> NDArray[np.float64]:
    """Return the points (N, 2) that a scan hit, metres, in the scanner's frame."""
    step = max(1, scan.num_beams // _MOST_BEAMS)
    with np.errstate(invalid="ignore"):  # a signalling NaN of a broken message is "no answer" as any other
        ranges, angles = scan.ranges_m[::step].astype(np.float64), scan.angles_rad[::step]
    hit = np.isfinite(ranges) & (ranges > max(scan.range_min_m, 0.0)) & (ranges < scan.range_max_m)
    return np.column_stack([ranges[hit] * np.cos(angles[hit]), ranges[hit] * np.sin(angles[hit])])


def _no_poses() -> Trajectory:
    return Trajectory.from_se2(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
