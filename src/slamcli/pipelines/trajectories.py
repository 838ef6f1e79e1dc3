# SPDX-License-Identifier: MIT
"""Trajectories from wherever they are: files, topics of a recording, or the transforms of a recording."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slamcli.errors import CalibrationError, DataError, FormatError, RecordingError, UsageError
from slamcli.formats import trajectories
from slamcli.geometry import se3
from slamcli.measurements import FrameTransform, StampedPose
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

if TYPE_CHECKING:
    from slamcli.recordings.recording import Recording

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
    """Return whether a path is a recording by its name: a bag, an MCAP, a database, or a folder with a metadata.yaml."""
    if path.is_dir():
        return (path / "metadata.yaml").exists() or any(path.glob("*.db3")) or any(path.glob("*.mcap"))
    return path.suffix in RECORDING_SUFFIXES


def load_trajectory(
    text: str | os.PathLike[str], *, times: str | os.PathLike[str] | None = None, unit: str = "auto", log: RunLog
) -> Trajectory:
    """Return a trajectory from a file, or from a topic or the transforms of a recording.

    Parameters
    ----------
    text
        A TUM, KITTI or EuRoC file; ``recording:/topic`` with poses (PoseStamped, PoseWithCovarianceStamped, Odometry, Path
        or TransformStamped); or ``recording:frame>child_frame``, a chain of transforms.
    times
        A file of stamps for a KITTI file.
    unit
        Unit of the stamps of a file: ``auto``, ``s``, ``ms``, ``us`` or ``ns``.
    log
        Takes what was found and mended.

    Raises
    ------
    InputError
        If it cannot be read; the message names file and line, or file and topic.
    """
    source = parse_source(os.fspath(text))
    if source.part or is_recording(source.path):
        if times is not None:
            raise UsageError("a times file goes with a KITTI file of poses, not with a recording")
        return _from_recording(source, log)
    if not source.path.exists():
        raise FormatError(f"{source.path}: no such file")
    if times is not None:
        return trajectories.read_kitti(source.path, times=times, log=log)
    return trajectories.read_trajectory(source.path, log=log, unit=unit)


def _from_recording(source: Source, log: RunLog) -> Trajectory:
    from slamcli.recordings import open_recording

    with open_recording([source.path], log=log) as recording:
        if not source.part:
            raise UsageError(f"{source.path} is a recording: say which poses in it, {_choices(source.path, recording)}")
        frame, arrow, child = source.part.partition(">")
        name = f"{source.path}:{source.part}"
        if arrow:
            return _from_frames(recording, frame.strip(), child.strip(), name)
        return _from_topic(recording, source.part, name)


def _from_topic(recording: Recording, topic: str, name: str) -> Trajectory:
    poses = [pose for measurement in recording.measurements([topic]) for pose in _poses_of(measurement)]
    if not poses:
        raise RecordingError(f"{name}: no poses in this topic; {_choices(Path(recording.name), recording)}")
    stamps, positions, quats, frames = zip(*poses, strict=True)
    if len(set(frames)) > 1:
        raise DataError(
            f"{name}: transforms between different frames ({', '.join(f'{a}>{b}' for a, b in sorted(set(frames)))}):"
            " name one of them instead of the topic"
        )
    return Trajectory(
        np.array(stamps, dtype=np.int64), np.array(positions), np.array(quats), frames[0][0], frames[0][1], source=name
    )


def _poses_of(measurement: Any) -> list[tuple[int, Any, Any, tuple[str, str]]]:
    """Return stamp, position, orientation and frames of the poses in a measurement."""
    if isinstance(measurement, StampedPose):
        frames = (measurement.frame_id, measurement.child_frame_id)
        return [(measurement.stamp_ns, measurement.position_m, measurement.quat_xyzw, frames)]
    if isinstance(measurement, FrameTransform):
        frames = (measurement.parent_frame_id, measurement.child_frame_id)
        return [(measurement.stamp_ns, measurement.position_m, measurement.quat_xyzw, frames)]
    path = getattr(measurement, "path", None)
    if isinstance(path, Trajectory):  # each Path message holds the whole path so far: the stamps tell them apart
        return [
            (stamp, position, quat, (path.frame_id, path.child_frame_id))
            for stamp, position, quat in zip(path.stamps_ns.tolist(), path.positions_m, path.quats_xyzw, strict=True)
        ]
    return []


def _from_frames(recording: Recording, frame: str, child: str, name: str) -> Trajectory:
    tree = recording.frames()
    stamps = _edge_stamps(tree, frame, child)
    if not stamps.size:
        raise RecordingError(f"{name}: the transform from {frame} to {child} never changes: it is no trajectory")
    poses, kept, last_error = [], [], ""
    for stamp in stamps.tolist():
        try:
            poses.append(tree.lookup(frame, child, stamp))
        except (CalibrationError, DataError) as error:  # the other edges of the chain may begin later
            last_error = str(error)
            continue
        kept.append(stamp)
    if not poses:
        raise RecordingError(f"{name}: {last_error}")
    positions, quats = se3.to_position_quaternion(np.array(poses))
    return replace(
        Trajectory(np.array(kept, dtype=np.int64), positions, quats, frame, child), source=name
    )
