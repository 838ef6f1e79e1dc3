# SPDX-License-Identifier: MIT
"""Scans and odometry of a recording in the order in which they were recorded, as a planar tier takes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.measurements import LaserScan, Measurement, Odometry
from slamcli.recordings import Recording
from slamcli.recordings.laser_mount import LaserMount, find_laser_mount
from slamcli.recordings.odometry_track import read_odometry
from slamcli.recordings.scan_normalisation import (
    FAN_SAMPLE,
    Fan,
    ScanNormaliser,
    most_frequent_fan,
    turn_counter_clockwise,
)
from slamcli.recordings.topic_picks import TopicPicks, pick_topics
from slamcli.runtime import RunLog


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanarFeed:
    """Where scans and odometry come from; `measurements` may be read once."""

    recording: Recording
    picks: TopicPicks
    mount: LaserMount
    fan: Fan | None
    start_s: float | None
    duration_s: float | None
    log: RunLog

    @property
    def scan_topic(self) -> str:
        """Topic of the scans."""
        return self.picks.scan.name

    @property
    def T_base_laser(self) -> NDArray[np.float64]:  # noqa: N802 - frames stand in names
        """Mount of the scanner, float64 (4, 4)."""
        return self.mount.T_base_laser

    @property
    def topics(self) -> Mapping[str, Any]:
        """What was picked, for ``run.json``."""
        odometry = self.picks.odom_topic.name if self.picks.odom_topic is not None else self.picks.odometry
        return {"scan": self.scan_topic, "odometry": odometry}

    @property
    def frames(self) -> Mapping[str, Any]:
        """The frames that were picked, for ``run.json``."""
        return {
            "base": self.picks.base_frame,
            "odom": self.picks.odom_frame,
            "laser": self.picks.laser_frame,
            "laser_mount": self.mount.source,
        }

    @property
    def length_s(self) -> float:
        """Seconds of recording that are read."""
        whole = (self.recording.end_ns - self.recording.start_ns) / 1e9 - (self.start_s or 0.0)
        return whole if self.duration_s is None else min(whole, self.duration_s)

    def measurements(self) -> Iterator[Measurement]:
        """Yield scans (counter-clockwise, cleaned, on one fan) and odometry of the base, in recorded order.

        Odometry from tf has no place in that order, and comes before the scans.
        """
        topics = [self.picks.scan]
        if self.picks.odom_topic is not None:
            topics.append(self.picks.odom_topic)
        else:
            yield from self._odometry_from_tf()
        child_to_base = self._child_to_base()
        began = self.recording.start_ns
        if self.fan is None:
            return
        normaliser = ScanNormaliser(self.fan, mirrored=self.mount.upside_down, log=self.log)
        for measurement in self.recording.measurements(
            topics, start_s=self.start_s, duration_s=self.duration_s, log_order=True
        ):
            if isinstance(measurement, Odometry):
                yield measurement if child_to_base is None else _moved(measurement, child_to_base)
            else:
                yield normaliser.normalise(measurement)
                self.log.progress.update((measurement.stamp_ns - began) / 1e9)
        normaliser.tell()

    def _odometry_from_tf(self) -> Iterator[Odometry]:
        track = read_odometry(self.recording, self.picks, start_s=self.start_s, duration_s=self.duration_s)
        if track is None:
            return
        half = track.poses[:, 2] / 2
        for stamp, pose, sine, cosine in zip(
            track.stamps_ns.tolist(), track.poses, np.sin(half), np.cos(half), strict=True
        ):
            position, quat = np.array([pose[0], pose[1], 0.0]), np.array([0.0, 0.0, sine, cosine])
            yield Odometry(
                stamp_ns=stamp,
                frame_id=track.odom_frame,
                child_frame_id=track.base_frame,
                position_m=position,
                quat_xyzw=quat,
            )

    def _child_to_base(self) -> NDArray[np.float64] | None:
        """Return the fixed transform from the frame whose motion the odometry describes to the base, None for the same."""
        child, base, tree = self.picks.odom_child_frame, self.picks.base_frame, self.recording.frames()
        return tree.lookup(child, base) if child != base and tree.connected(child, base) else None


def feed_planar(recording: Recording, wanted: Mapping[str, Any], log: RunLog) -> PlanarFeed:
    """Pick topics, frames and the scanner's mount; `wanted` names topics, frames and the part of the recording (None: found).

    Raises
    ------
    RecordingError
        If a topic is missing, empty or of another type.
    CalibrationError
        If frames that the caller names are not connected.
    """
    start_s, duration_s = wanted["start_s"], wanted["duration_s"]
    names = {key: wanted[key] for key in ("scan_topic", "odom_topic", "base_frame", "odom_frame")}
    picks = pick_topics(recording, **names)
    mount = find_laser_mount(recording, base_frame=picks.base_frame, laser_frame=picks.laser_frame)
    first: list[LaserScan] = list(
        islice(recording.measurements([picks.scan], start_s=start_s, duration_s=duration_s), FAN_SAMPLE)
    )
    fan = most_frequent_fan([turn_counter_clockwise(scan, mirrored=mount.upside_down) for scan in first])
    return PlanarFeed(
        recording=recording, picks=picks, mount=mount, fan=fan, start_s=start_s, duration_s=duration_s, log=log
    )


def _moved(odometry: Odometry, T_child_base: NDArray[np.float64]) -> Odometry:
    """Return the odometry of a frame that is fixed to the child frame."""
    T_odom_base = se3.from_position_quaternion(odometry.position_m, odometry.quat_xyzw) @ T_child_base
    position, quat = se3.to_position_quaternion(T_odom_base)
    return replace(odometry, position_m=position, quat_xyzw=quat)
