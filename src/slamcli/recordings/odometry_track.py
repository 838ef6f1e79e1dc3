# SPDX-License-Identifier: MIT
"""Odometry of a recording as one array of planar poses: from an Odometry topic or from the frame tree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import RecordingError
from slamcli.geometry import se2, se3
from slamcli.recordings.odometry_pick import OdometryPick
from slamcli.recordings.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OdometryTrack:
    """Poses of the base frame in the odometry frame, in recorded order (stamps may run backwards)."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,)."""
    poses: NDArray[np.float64]
    """float64 (N, 3), x and y in metres, yaw in radians, of `base_frame` in `odom_frame`."""
    odom_frame: str
    base_frame: str
    source: str
    """``topic NAME`` or ``tf``."""

    def __len__(self) -> int:
        return len(self.stamps_ns)


def read_odometry(
    recording: Recording, picks: OdometryPick, *, start_s: float | None = None, duration_s: float | None = None
) -> OdometryTrack | None:
    """Return the odometry that was picked, None if there is none.

    Raises
    ------
    RecordingError
        If the part of the recording holds no odometry.
    """
    if picks.odometry == "none":
        return None
    if picks.odom_topic is not None:
        track = _from_topic(recording, picks, start_s, duration_s)
    else:
        track = _from_frames(recording, picks, start_s, duration_s)
    if len(track) == 0:
        raise RecordingError(f"{recording.name}: no odometry from {track.source} in this part of the recording")
    return track


def _from_topic(
    recording: Recording, picks: OdometryPick, start_s: float | None, duration_s: float | None
) -> OdometryTrack:
    topic = picks.odom_topic
    assert topic is not None  # noqa: S101 - checked by the caller
    samples = recording.measurements([topic], start_s=start_s, duration_s=duration_s)
    rows = [(sample.stamp_ns, (*sample.position_m[:2].tolist(), *sample.quat_xyzw.tolist())) for sample in samples]
    stamps = np.array([row[0] for row in rows], dtype=np.int64)
    x, y, qx, qy, qz, qw = np.array([row[1] for row in rows], dtype=np.float64).reshape(-1, 6).T
    poses = np.column_stack([x, y, np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))])
    tree = recording.frames()
    if picks.odom_child_frame != picks.base_frame and tree.connected(picks.odom_child_frame, picks.base_frame):
        # Wheels report base_footprint where the scans are placed from base_link: a fixed transform apart.
        poses = se2.compose(poses, se3.to_se2(tree.lookup(picks.odom_child_frame, picks.base_frame)))
    return OdometryTrack(
        stamps_ns=stamps,
        poses=poses,
        odom_frame=picks.odom_frame,
        base_frame=picks.base_frame,
        source=f"topic {topic.name}",
    )


def _from_frames(
    recording: Recording, picks: OdometryPick, start_s: float | None, duration_s: float | None
) -> OdometryTrack:
    stamps, transforms = odometry_transforms(recording, picks, start_s=start_s, duration_s=duration_s)
    return OdometryTrack(
        stamps_ns=stamps,
        poses=se3.to_se2(transforms),
        odom_frame=picks.odom_frame,
        base_frame=picks.base_frame,
        source="tf",
    )


def odometry_transforms(
    recording: Recording, picks: OdometryPick, *, start_s: float | None = None, duration_s: float | None = None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the transforms from the odometry's frame to the base: stamps int64 (N,), ascending, and float64 (N, 4, 4)."""
    tree = recording.frames()
    moving = [edge for edge in tree.path(picks.odom_frame, picks.base_frame) if not edge.static]
    stamps = max(moving, key=lambda edge: len(edge.stamps_ns)).stamps_ns
    # The part of the recording is log time; stamps and log time differ by little, so a second is added on both sides.
    first, before = recording.window(start_s, duration_s)
    margin = 1_000_000_000
    if first is not None:
        stamps = stamps[stamps >= first - margin]
    if before is not None:
        stamps = stamps[stamps < before + margin]
    transforms, valid = tree.lookup_many(picks.odom_frame, picks.base_frame, stamps)
    return stamps[valid], transforms[valid]
