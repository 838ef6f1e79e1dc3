# SPDX-License-Identifier: MIT
"""Picks, mount, odometry and normalised scans of a recording with one planar scanner in one go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.mapper import InputPlan
from slamcli.measurements import LaserScan
from slamcli.recordings import Recording, Topic
from slamcli.recordings.laser_mount import LaserMount, find_laser_mount
from slamcli.recordings.odometry_pick import OdometryPick
from slamcli.recordings.odometry_track import OdometryTrack, read_odometry
from slamcli.recordings.scan_normalisation import normalise_scans
from slamcli.recordings.sensor_picks import TopicNames, offered_sensors, pick_sensors

ROLES = ("scans", "odometry")


@dataclass(frozen=True, kw_only=True)
class PlanarPicks(OdometryPick):
    scan: Topic
    laser_frame: str


@dataclass(frozen=True)
class PlanarRun:
    picks: PlanarPicks
    mount: LaserMount
    odometry: OdometryTrack | None
    scans: list[LaserScan]


def pick_topics(
    recording: Recording,
    *,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    base_frame: str | None = None,
    odom_frame: str | None = None,
) -> PlanarPicks:
    names = TopicNames(
        scans=() if scan_topic is None else (scan_topic,),
        odometry=odom_topic,
        base_frame=base_frame,
        odom_frame=odom_frame,
    )
    offered_sensors(recording, names, ROLES)
    picks = pick_sensors(recording, names, InputPlan(parameters=None), ROLES)
    odometry = picks.odometry
    return PlanarPicks(
        scan=picks.scans[0],
        laser_frame=picks.frames[picks.scans[0].name],
        base_frame=odometry.base_frame,
        odom_frame=odometry.odom_frame,
        odometry=odometry.odometry,
        odom_topic=odometry.odom_topic,
        odom_child_frame=odometry.odom_child_frame,
    )


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
