# SPDX-License-Identifier: MIT
"""Everything that a planar SLAM tier takes from a recording, in one step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from slamcli.measurements import LaserScan
from slamcli.recordings.laser_mount import LaserMount, find_laser_mount
from slamcli.recordings.odometry_track import OdometryTrack, read_odometry
from slamcli.recordings.recording import Recording
from slamcli.recordings.scan_normalisation import normalise_scans
from slamcli.recordings.topic_picks import TopicPicks, pick_topics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanarInput:
    """Scans, mount and odometry of one scanner."""

    picks: TopicPicks
    mount: LaserMount
    odometry: OdometryTrack | None
    recording: Recording
    start_s: float | None = None
    duration_s: float | None = None

    def scans(self) -> Iterator[LaserScan]:
        """Yield the normalised scans in recorded order (see `slamcli.recordings.scan_normalisation`)."""
        recorded = self.recording.measurements([self.picks.scan], start_s=self.start_s, duration_s=self.duration_s)
        return normalise_scans(recorded, mirrored=self.mount.upside_down, log=self.recording.log)


def planar_input(
    recording: Recording,
    *,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    base_frame: str | None = None,
    odom_frame: str | None = None,
    start_s: float | None = None,
    duration_s: float | None = None,
) -> PlanarInput:
    """Return scans, mount and odometry of a recording: what the caller names, else what fits best.

    What was chosen stands in the recording's log as notes.

    Raises
    ------
    RecordingError
        If a topic is missing, empty or of another type.
    CalibrationError
        If frames that the caller names are not connected.
    """
    picks = pick_topics(
        recording, scan_topic=scan_topic, odom_topic=odom_topic, base_frame=base_frame, odom_frame=odom_frame
    )
    return PlanarInput(
        picks=picks,
        mount=find_laser_mount(recording, base_frame=picks.base_frame, laser_frame=picks.laser_frame),
        odometry=read_odometry(recording, picks, start_s=start_s, duration_s=duration_s),
        recording=recording,
        start_s=start_s,
        duration_s=duration_s,
    )
