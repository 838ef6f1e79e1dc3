# SPDX-License-Identifier: MIT
"""Trajectories from wherever they are: files, topics of a recording, or the transforms of a recording."""

from __future__ import annotations

import os
from array import array
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.errors import FormatError, RecordingError, UsageError
from slamcli.formats import trajectories
from slamcli.formats.pbstream.container import is_pbstream
from slamcli.geometry import se3
from slamcli.measurements import FrameTransform, Odometry, StampedPose
from slamcli.recordings import open_recording
from slamcli.recordings.adapters import StampedPath
from slamcli.recordings.classic_log import has_classic_content
from slamcli.recordings.folders import TRUTH_TOPIC, find_layout
from slamcli.recordings.mends import Mends
from slamcli.recordings.recording import Recording
from slamcli.rtabmap.database.probing import is_database
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

_POSE_KINDS: tuple[type, ...] = (StampedPose, Odometry, StampedPath)
RECORDING_SUFFIXES = (".bag", ".mcap", ".db3", ".zstd")


@dataclass(frozen=True, slots=True)
class Source:
    """Where a trajectory comes from."""

    path: Path
    part: str = ""
    """Topic, or ``frame>child_frame``; empty for files of poses."""


def parse_source(text: str) -> Source:
    """Split ``bag.mcap:/topic`` or ``bag.mcap:odom>base_link``; a path that exists as it stands is a path, colons and all."""
    if not Path(text).exists():
        for position in range(len(text) - 1, 0, -1):
            if text[position] == ":" and Path(text[:position]).exists():
                return Source(Path(text[:position]), text[position + 1 :])
    return Source(Path(text))


def is_recording(path: Path) -> bool:
    """Return whether a path is a recording: by its name, a folder of a bag or of a data set, or a classic log by its content."""
    if path.is_dir():
        is_bag = (path / "metadata.yaml").exists() or any(path.glob("*.db3")) or any(path.glob("*.mcap"))
        return is_bag or find_layout(path) is not None
    return path.suffix in RECORDING_SUFFIXES or has_classic_content(path)


def load_trajectory(
    text: str | os.PathLike[str],
    *,
    times: str | os.PathLike[str] | None = None,
    unit: str = "auto",
    mends: Mends | None = None,
    log: RunLog,
) -> Trajectory:
    """Return a trajectory from a file, or from a topic or the transforms of a recording.

    Parameters
    ----------
    text
        A TUM, KITTI or EuRoC file; a saved state (``state.pbstream``, or ``state.pbstream:1`` for one of several
        trajectories); a database of RTAB-Map (``rtabmap.db``, ``rtabmap.db:odometry``, ``rtabmap.db:truth``); a data-set folder or another recording with ``/groundtruth``; ``recording:/topic`` with poses
        (PoseStamped, PoseWithCovarianceStamped, Odometry, Path or TransformStamped); or ``recording:frame>child_frame``,
        a chain of transforms.
    times
        A file of stamps for a KITTI file.
    unit
        Unit of the stamps of a file: ``auto``, ``s``, ``ms``, ``us`` or ``ns``.
    mends
        What is mended while a recording is read.
    log
        Takes what was found and mended.

    Raises
    ------
    InputError
        If it cannot be read; the message names file and line, or file and topic.
    """
    source = parse_source(os.fspath(text))
    if is_pbstream(source.path):
        from slamcli.formats.pbstream.node_poses import read_node_poses  # brings numba, which few commands need

        return read_node_poses(source.path, source.part, log=log)
    if is_database(source.path):
        from slamcli.pipelines.database_poses import read_database_poses

        return read_database_poses(source.path, source.part, log=log)
    if source.part or is_recording(source.path):
        if times is not None:
            raise UsageError("a times file goes with a KITTI file of poses, not with a recording")
        return _from_recording(source, mends or Mends(), log)
    if not source.path.exists():
        raise FormatError(f"{source.path}: no such file")
    if times is not None:
        return trajectories.read_kitti(source.path, times=times, log=log)
    return trajectories.read_trajectory(source.path, log=log, unit=unit)


def _from_recording(source: Source, mends: Mends, log: RunLog) -> Trajectory:
    with open_recording([source.path], mends=mends, log=log) as recording:
        if not source.part:
            source = _with_truth(source, recording, log)
        frame, arrow, child = source.part.partition(">")
        name = f"{source.path}:{source.part}"
        if arrow:
            return _from_frames(recording, frame.strip().lstrip("/"), child.strip().lstrip("/"), name, log)
        return trajectory_of_topic(recording, source.part, name, log)


def _with_truth(source: Source, recording: Recording, log: RunLog) -> Source:
    """Return where the recording's true poses are, as those of data sets are called.

    Raises
    ------
    UsageError
        If it has none of that name.
    """
    if not any(topic.name == TRUTH_TOPIC and topic.count for topic in recording.topics(StampedPose)):
        raise UsageError(f"{source.path} is a recording: say which poses in it, {_choices(recording)}")
    log.note(f"{source.path}: the true poses on {TRUTH_TOPIC} are taken")
    return Source(source.path, TRUTH_TOPIC)


def _choices(recording: Recording) -> str:
    """Name the topics and chains of transforms that hold a trajectory."""
    topics = [topic.name for kind in _POSE_KINDS for topic in recording.topics(kind) if topic.count]
    edges = [f"{edge.parent}>{edge.child}" for edge in recording.frames().edges if not edge.static]
    found = [*topics, *edges]
    return (
        f"one of {', '.join(f'{recording.contents.paths[0]}:{part}' for part in found)}" if found else "but it has none"
    )


def trajectory_of_topic(recording: Recording, topic: str, name: str, log: RunLog) -> Trajectory:
    """Return the poses of a topic.

    Raises
    ------
    InputError
        If they are no poses, of several frames, or none; `name` stands for the topic in the message.
    """
    stamps, positions, quats, frames = array("q"), array("d"), array("d"), dict[tuple[str, str], int]()
    path: Trajectory | None = None
    for measurement in recording.measurements([topic]):
        if isinstance(measurement, StampedPath):
            path = measurement.path  # each message holds the whole path so far: the last one counts
            continue
        edge = _frames_of(measurement, recording, name)
        frames[edge] = frames.get(edge, 0) + 1
        stamps.append(measurement.stamp_ns)
        positions.extend(measurement.position_m.tolist())
        quats.extend(measurement.quat_xyzw.tolist())
    if path is not None:
        log.note(f"{name}: the last path of the topic is taken, {len(path)} poses")
        if not len(path):
            raise RecordingError(f"{name}: the path is empty")
        return replace(path, source=name)
    if len(frames) > 1:
        listed = ", ".join(f"{recording.contents.paths[0]}:{parent}>{child}" for parent, child in sorted(frames))
        raise UsageError(f"{name}: transforms between several frames, say which: {listed}")
    if not stamps:
        raise RecordingError(f"{name}: no poses in this topic; give {_choices(recording)}")
    ((frame, child),) = frames
    return Trajectory(
        np.array(stamps, dtype=np.int64),
        np.array(positions).reshape(-1, 3),
        np.array(quats).reshape(-1, 4),
        frame,
        child,
        source=name,
    )


def _frames_of(measurement: Any, recording: Recording, name: str) -> tuple[str, str]:
    if isinstance(measurement, StampedPose):
        return measurement.frame_id, measurement.child_frame_id
    if isinstance(measurement, FrameTransform):
        return measurement.parent_frame_id, measurement.child_frame_id
    raise UsageError(f"{name}: {type(measurement).__name__} has no pose; give {_choices(recording)}")


def _from_frames(recording: Recording, frame: str, child: str, name: str, log: RunLog) -> Trajectory:
    tree = recording.frames()
    moving = [edge for edge in tree.path(frame, child) if not edge.static]
    if not moving:
        raise RecordingError(f"{name}: the transform from {frame} to {child} never changes: it is no trajectory")
    stamps = max(moving, key=lambda edge: len(edge.stamps_ns)).stamps_ns  # those of the edge that is published most
    poses, valid = tree.lookup_many(frame, child, stamps)
    if not valid.any():
        raise RecordingError(f"{name}: the transforms between {frame} and {child} are never known at the same time")
    if not valid.all():
        log.note(f"{name}: {int((~valid).sum())} of {len(valid)} poses left out, where not all transforms are known")
    positions, quats = se3.to_position_quaternion(poses[valid])
    return Trajectory(stamps[valid].copy(), positions, quats, frame, child, source=name)
