# SPDX-License-Identifier: MIT
"""Which topics are taken where several would fit: the usual names first, then the busiest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from slamcli.recordings.raw import Topic
from slamcli.recordings.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Role:
    """What topics are taken for, and how they are told from others of the same type."""

    what: str
    option: str
    """Names a topic on the command line."""
    usual: tuple[str, ...]
    """Last parts of topic names, the most usual first."""
    unusual: tuple[str, ...] = ()
    """Parts of names that are taken only where nothing else is there."""


SCANS = Role(
    what="scans",
    option="--scan-topic",
    usual=("scan", "base_scan", "laser_scan", "laser", "front_scan", "scan_front", "scan_raw", "scan_filtered"),
    unusual=("tilt",),
)
ODOMETRY = Role(
    what="odometry",
    option="--odom-topic",
    usual=("odom", "odometry", "wheel_odom", "wheel_odometry", "odom_raw", "odom_combined"),
)
_NOT_ODOMETRY = ("truth", "_gt", "/gt", "mocap", "vicon", "optitrack", "gps", "visual", "vo/", "amcl", "slam")
CLOUDS = Role(
    what="point clouds",
    option="--points-topic",
    usual=("points2", "points", "velodyne_points", "lidar_points", "points_raw", "rslidar_points", "hesai", "lidar"),
    unusual=("camera", "depth", "stereo", "map", "obstacle", "ground", "cluster", "accumulated"),
)
IMUS = Role(
    what="IMU",
    option="--imu-topic",
    usual=("imu", "imu_data", "data", "imu_raw", "data_raw"),
    unusual=("camera", "filtered", "mag"),
)
FIXES = Role(what="GPS", option="--fix-topic", usual=("fix", "navsat", "gps"), unusual=("filtered",))
LANDMARKS = Role(what="landmarks", option="--landmark-topic", usual=("landmark", "landmarks"))


def ranked(found: Iterable[Topic], role: Role) -> tuple[Topic, ...]:
    """Return topics of one role, the one that fits best first."""

    def order(topic: Topic) -> tuple[int, bool, int]:
        odd = any(word in topic.name.lower() for word in role.unusual)
        return name_rank(topic.name, role.usual), odd, -(topic.count or 0)

    return tuple(sorted(found, key=order))


def best_topics(recording: Recording, found: Sequence[Topic], number: int, role: Role) -> tuple[Topic, ...]:
    """Return the `number` topics that fit best, or all where there are fewer; says which others there are."""
    best = ranked(found, role)[:number]
    if len(found) > len(best) > 0:
        others = ", ".join(topic.name for topic in found if topic not in best)
        used = ", ".join(topic.name for topic in best)
        recording.log.note(
            f"{role.what}: {used} {'is' if len(best) == 1 else 'are'} used (also there: {others}; "
            f"choose with {role.option})"
        )
    return best


def usable_odometry(found: Iterable[Topic]) -> tuple[Topic, ...]:
    """Return those topics of odometry that are not named like ground truth or another system's result, the best first."""
    return ranked((topic for topic in found if not any(word in topic.name.lower() for word in _NOT_ODOMETRY)), ODOMETRY)


def name_rank(name: str, usual: Sequence[str]) -> int:
    """Return how usual a topic name is: its last part's place in `usual`, or behind them."""
    last = name.rstrip("/").rsplit("/", 1)[-1].lower()
    return usual.index(last) if last in usual else len(usual)
