# SPDX-License-Identifier: MIT
"""Picks, mount, odometry and normalised scans of a recording in one go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.measurements import LaserScan
from slamcli.recordings import Recording
from slamcli.recordings.laser_mount import LaserMount, find_laser_mount
from slamcli.recordings.odometry_track import OdometryTrack, read_odometry
from slamcli.recordings.scan_normalisation import normalise_scans
from slamcli.recordings.topic_picks import TopicPicks, pick_topics


@dataclass(frozen=True)
class PlanarRun:
    picks: TopicPicks
    mount: LaserMount
    odometry: OdometryTrack | None
    scans: list[LaserScan]


def planar_run(
    recording: Recording, *, start_s: float | None = None, duration_s: float | None = None, **names: Any
) -> PlanarRun:
    picks = pick_topics(recording, **names)
    mount = find_laser_mount(recording, base_frame=picks.base_frame, laser_frame=picks.laser_frame)
    part = {"start_s": start_s, "duration_s": duration_s}
    scans = recording.measurements([picks.scan], **part)
    return PlanarRun(
        picks=picks,
        mount=mount,
        odometry=read_odometry(recording, picks, **part),
        scans=list(normalise_scans(scans, mirrored=mount.upside_down, log=recording.log)),
    )
