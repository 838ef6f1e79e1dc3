# SPDX-License-Identifier: MIT
"""Which sensors' topics and which frames a mapping run takes from a recording, and why."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import islice

import numpy as np

from slamcli.errors import RecordingError
from slamcli.mapper import InputPlan, SensorOffer
from slamcli.measurements import GeoFix, ImuSample, Landmarks, LaserScan, Odometry, PointCloud, StampedPose
from slamcli.recordings.adapters import multi_echo_laser_scan
from slamcli.recordings.odometry_pick import OdometryPick, pick_odometry
from slamcli.recordings.raw import Topic
from slamcli.recordings.recording import Recording
from slamcli.recordings.topic_ranks import (
    CLOUDS,
    FIXES,
    IMUS,
    LANDMARKS,
    SCANS,
    Role,
    best_topics,
    ranked,
    usable_odometry,
)

NONE = "none"
"""What a user names as topic of a sensor that is not to be used."""
_FLAT_M = 0.3
# What a mapping system can use -> the option that names it.
ROLES = {
    "scans": "--scan-topic",
    "points": "--points-topic",
    "odometry": "--odom-topic",
    "imu": "--imu-topic",
    "fixes": "--fix-topic",
    "landmarks": "--landmark-topic",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicNames:
    """What the caller names; None or empty: found from the recording."""

    scans: tuple[str, ...] = ()
    """Topics, or ``none`` alone, as of the next."""
    points: tuple[str, ...] = ()
    odometry: str | None = None
    """A topic, ``tf`` for the transform from `odom_frame` to `base_frame`, or ``none``."""
    imu: str | None = None
    """A topic or ``none``, as of the following."""
    fixes: str | None = None
    landmarks: str | None = None
    base_frame: str | None = None
    odom_frame: str | None = None

    def named(self) -> dict[str, tuple[str, ...]]:
        """Return the topics that are named, by role."""
        listed = {role: (value,) if isinstance(value := getattr(self, role), str) else value or () for role in ROLES}
        return {role: topics for role, topics in listed.items() if topics not in ((), (NONE,))}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorPicks:
    """What was picked; the reasons stand in the recording's log as notes."""

    scans: tuple[Topic, ...]
    clouds: tuple[Topic, ...]
    odometry: OdometryPick
    imu: Topic | None
    fixes: Topic | None
    landmarks: Topic | None
    frames: Mapping[str, str]
    """Frame of each of these sensors by its topic; those without a message that can be decoded are left out."""

    @property
    def ranges(self) -> tuple[Topic, ...]:
        """Topics of scans, then of clouds."""
        return (*self.scans, *self.clouds)

    @property
    def sample_topics(self) -> tuple[str, ...]:
        """Names of the topics of odometry and of the IMU."""
        found = (self.odometry.odom_topic, self.imu)
        return tuple(topic.name for topic in found if topic is not None)


def offered_sensors(
    recording: Recording, names: TopicNames, roles: Collection[str], *, ranges_needed: bool = True
) -> SensorOffer:
    """Return what a recording holds for mapping; named topics and ``none`` leave only what is named.

    Parameters
    ----------
    roles
        What the system can use, as `slamcli.mapper.Tier` names it.

    Raises
    ------
    RecordingError
        If a named topic is missing, empty or of another type, or there is no range sensor at all and one is needed.
    """
    scans, clouds = _ranges(recording, names, roles)
    if ranges_needed and not scans and not clouds:
        raise RecordingError(f"{recording.name}: {_no_ranges(recording, roles)}")
    echoes = [topic for topic in scans if is_multi_echo(topic)]
    moving = any(not edge.static for edge in recording.frames().edges)
    odometry = [topic for topic in recording.topics(Odometry) if topic.count != 0]
    return SensorOffer(
        num_laser_scans=len(scans) - len(echoes),
        num_multi_echo_laser_scans=len(echoes),
        num_point_clouds=len(clouds),
        flat_clouds=bool(clouds) and not scans and _is_flat(recording, ranked(clouds, CLOUDS)[0]),
        odometry=names.odometry != NONE and (names.odometry is not None or moving or bool(usable_odometry(odometry))),
        imu=_offers(recording, names.imu, ImuSample),
        fixes=_offers(recording, names.fixes, GeoFix),
        landmarks=_offers(recording, names.landmarks, Landmarks),
        named=frozenset(names.named()),
    )


def pick_sensors(
    recording: Recording, names: TopicNames, plan: InputPlan, roles: Collection[str], *, camera_frame: str | None = None
) -> SensorPicks:
    """Return the topics and frames to use: what the caller names, else what fits best of what is planned.

    The base frame is looked for from `camera_frame`; None: from the first range sensor.

    Raises
    ------
    RecordingError
        If a named topic is missing, empty or of another type, or no message of the first range sensor can be decoded.
    """
    found, clouds = _ranges(recording, names, roles)
    scans = _planned_scans(recording, found, plan) if names.scans in ((), (NONE,)) else found
    clouds = best_topics(recording, clouds, plan.num_point_clouds, CLOUDS) if names.points in ((), (NONE,)) else clouds
    frames = {topic.name: frame for topic in (*scans, *clouds) if (frame := _frame(recording, topic)) is not None}
    scans, clouds = (_decodable(recording, topics, frames) for topics in (scans, clouds))
    odometry = pick_odometry(
        recording,
        next(iter(frames.values())) if camera_frame is None else camera_frame,
        odom_topic=None if names.odometry == NONE else names.odometry,
        base_frame=names.base_frame or _known_frame(recording, plan.base_frame),
        odom_frame=names.odom_frame or plan.odom_frame,
        wanted=plan.odometry and names.odometry != NONE,
    )
    others = {
        "imu": _one(recording, names.imu, (ImuSample,), IMUS) if plan.imu else None,
        "fixes": _one(recording, names.fixes, (GeoFix, StampedPose, Odometry), FIXES) if plan.fixes else None,
        "landmarks": _one(recording, names.landmarks, (Landmarks,), LANDMARKS) if plan.landmarks else None,
    }
    for topic in others.values():
        if topic is not None and (frame := _frame(recording, topic)) is not None:
            frames[topic.name] = frame
    return SensorPicks(scans=scans, clouds=clouds, odometry=odometry, frames=frames, **others)


def _decodable(recording: Recording, topics: tuple[Topic, ...], frames: Mapping[str, str]) -> tuple[Topic, ...]:
    """Return the range sensors that have a message which can be decoded; one of several that has none is left out.

    Raises
    ------
    RecordingError
        If none has one.
    """
    for topic in topics:
        if not frames:
            raise RecordingError(f"{recording.name}: no message on topic {topic.name} can be decoded")
        if topic.name not in frames:
            recording.log.warn(f"{topic.name}: no message can be decoded, it is left out")
    return tuple(topic for topic in topics if topic.name in frames)


def _known_frame(recording: Recording, configured: str | None) -> str | None:
    """Return the robot's frame as the configuration names it, None where the recording has transforms but not that one."""
    known = recording.frames().frames
    if configured is None or not known or configured in known:
        return configured
    recording.log.warn(
        f"the configuration's frame of the robot, {configured}, is not in the recording (it has {', '.join(known)}): "
        "the one that fits is used (choose with --base-frame)"
    )
    return None


def is_multi_echo(topic: Topic) -> bool:
    """Return whether a topic holds scans of several echoes."""
    return topic.msgtype in multi_echo_laser_scan.ADAPTER.msgtypes


def _ranges(
    recording: Recording, names: TopicNames, roles: Collection[str]
) -> tuple[tuple[Topic, ...], tuple[Topic, ...]]:
    """Return the topics of scans and of clouds that can be used: those that are named, else all."""
    given = [tuple(name for name in named if name != NONE) for named in (names.scans, names.points)]
    if any(given):
        return (
            tuple(dict.fromkeys(recording.topic(name, LaserScan) for name in given[0])),
            tuple(dict.fromkeys(recording.topic(name, PointCloud) for name in given[1])),
        )
    scans, clouds = (
        () if named == (NONE,) else tuple(topic for topic in recording.topics(kind) if topic.count != 0)
        for kind, named in ((LaserScan, names.scans), (PointCloud, names.points))
    )
    return scans, clouds if "points" in roles else ()


def _planned_scans(recording: Recording, found: tuple[Topic, ...], plan: InputPlan) -> tuple[Topic, ...]:
    if plan.num_multi_echo_laser_scans is None:
        return best_topics(recording, found, plan.num_laser_scans, SCANS)
    echoes = [topic for topic in found if is_multi_echo(topic)]
    lasers = [topic for topic in found if topic not in echoes]
    return (
        *best_topics(recording, lasers, plan.num_laser_scans, SCANS),
        *best_topics(recording, echoes, plan.num_multi_echo_laser_scans, SCANS),
    )


def _no_ranges(recording: Recording, roles: Collection[str]) -> str:
    kinds: tuple[type, ...] = (LaserScan, PointCloud) if "points" in roles else (LaserScan,)
    what = "LaserScan or PointCloud2" if "points" in roles else "LaserScan"
    empty = [topic.name for kind in kinds for topic in recording.topics(kind)]
    if empty:
        return f"topic {empty[0]} is empty, and there is no other sensor_msgs/{what} topic"
    held = ", ".join(
        f"{topic.name} ({topic.msgtype.replace('/msg/', '/')})" for topic in recording.contents.topics[:12]
    )
    return f"no sensor_msgs/{what} topic (it has {held or 'no topics at all'})"


def _offers(recording: Recording, named: str | None, kind: type) -> bool:
    return named != NONE and (named is not None or any(topic.count != 0 for topic in recording.topics(kind)))


def _one(recording: Recording, named: str | None, kinds: tuple[type, ...], role: Role) -> Topic | None:
    """Return the topic that is named, of any of the kinds, else the one of the first kind that fits best."""
    if named is not None and named != NONE:
        fits = next(
            (kind for kind in kinds if {named, f"/{named}"} & {t.name for t in recording.topics(kind)}), kinds[0]
        )
        return recording.topic(named, fits)
    found = [topic for topic in recording.topics(kinds[0]) if topic.count != 0]
    return next(iter(best_topics(recording, found, 1, role)), None)


def range_frames(recording: Recording, names: TopicNames, roles: Collection[str]) -> dict[str, str]:
    """Return the frame of each range sensor that can be used, by topic; those without a message that can be decoded are left out.

    Raises
    ------
    RecordingError
        If a named topic is missing, empty or of another type.
    """
    scans, clouds = _ranges(recording, names, roles)
    return {topic.name: frame for topic in (*scans, *clouds) if (frame := _frame(recording, topic)) is not None}


def _frame(recording: Recording, topic: Topic) -> str | None:
    """Return the frame of a sensor, as its first message names it, None where none can be decoded."""
    first = next(iter(recording.measurements([topic])), None)
    return None if first is None else str(first.frame_id)


def _is_flat(recording: Recording, topic: Topic) -> bool:
    """Return whether the first cloud that has points lies in a plane of constant z of its own frame."""
    for cloud in islice(recording.measurements([topic]), 20):
        if len(cloud.points_m):
            return lies_flat(cloud)
    return False


def lies_flat(cloud: PointCloud) -> bool:
    """Return whether a cloud lies in a plane of constant z of its own frame, as that of a planar scanner does."""
    if len(cloud.points_m) == 0:
        return False
    low, high = np.percentile(cloud.points_m[:, 2], [1, 99])
    return bool(high - low < _FLAT_M)
