# SPDX-License-Identifier: MIT
"""Scans, clouds and what else a tier takes of a recording, in the order in which they were recorded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.mapper import InputPlan, Tier
from slamcli.measurements import LaserScan, Measurement, PointCloud
from slamcli.pipelines.sensor_order import SensorOrder
from slamcli.pipelines.sensor_stream import OTHERS, SensorStream, others
from slamcli.recordings import Recording
from slamcli.recordings.laser_mount import LaserMount, find_cloud_mount, find_laser_mount, find_sensor_mount
from slamcli.recordings.scan_normalisation import (
    FAN_SAMPLE,
    Fan,
    most_frequent_fan,
    turn_counter_clockwise,
)
from slamcli.recordings.sensor_picks import NONE, ROLES, SensorPicks, TopicNames, offered_sensors, pick_sensors
from slamcli.runtime import RunLog


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorFeed:
    """Where measurements come from; `measurements` may be read once."""

    recording: Recording
    plan: InputPlan
    picks: SensorPicks
    mounts: Mapping[str, LaserMount]
    """Of each range sensor, by topic."""
    T_base_sensor: Mapping[str, NDArray[np.float64]]
    """Mount of each other sensor by topic, float64 (4, 4)."""
    fans: Mapping[str, Fan]
    """Of each planar scanner, by topic; those without scans have none."""
    start_s: float | None
    duration_s: float | None
    log: RunLog

    @property
    def T_base_laser(self) -> Mapping[str, NDArray[np.float64]]:  # noqa: N802 - frames stand in names
        """Mount of each range sensor by topic, float64 (4, 4)."""
        return {name: mount.T_base_laser for name, mount in self.mounts.items()}

    @property
    def cameras(self) -> None:
        """No cameras."""
        return

    @property
    def rig(self) -> None:
        """No cameras."""
        return

    @property
    def base_frame(self) -> str:
        """The robot's frame, whose poses are asked for."""
        return self.picks.odometry.base_frame

    @property
    def topics(self) -> Mapping[str, Any]:
        """What was picked, by role, for ``run.json``; several topics of one role as a list."""
        picks, odometry = self.picks, self.picks.odometry
        topic = odometry.odom_topic
        return {
            **_listed("scan", [topic.name for topic in picks.scans]),
            **_listed("points", [topic.name for topic in picks.clouds]),
            "odometry": topic.name if topic is not None else odometry.odometry,
            **{role: found.name for role, found in others(self.picks).items()},
        }

    @property
    def frames(self) -> Mapping[str, Any]:
        """The frames that were picked, by role, for ``run.json``; several as a list, in the order of the topics."""
        picks, odometry = self.picks, self.picks.odometry
        ranges = picks.ranges
        return {
            "base": odometry.base_frame,
            "odom": odometry.odom_frame,
            **_listed("laser", [picks.frames[topic.name] for topic in ranges]),
            **_listed("laser_mount", [self.mounts[topic.name].source for topic in ranges]),
            **{role: picks.frames.get(found.name) for role, found in others(self.picks).items()},
        }

    @property
    def length_s(self) -> float:
        """Seconds of recording that are read."""
        whole = (self.recording.end_ns - self.recording.start_ns) / 1e9 - (self.start_s or 0.0)
        return whole if self.duration_s is None else min(whole, self.duration_s)

    def measurements(self) -> Iterator[Measurement]:
        """Yield what was picked in recorded order, one message decoded at a time.

        Scans are counter-clockwise, cleaned and on their scanner's fan, or in space clouds of their returns; clouds and IMU samples are in their sensors' frames;
        odometry is that of the base; fixes are poses in a plane that touches the earth at the first one. Odometry from
        tf has no place in that order, and comes first. Where the plan wants samples first, each scan and cloud is held
        back for them (see `slamcli.pipelines.sensor_order`).
        """
        stream = SensorStream(self.recording, self.plan, self.picks, self.mounts, self.fans, self.log)
        yield from stream.tf_track(self.start_s, self.duration_s)
        read = self.recording.measurements(
            stream.topics, start_s=self.start_s, duration_s=self.duration_s, log_order=True
        )
        began = self.recording.start_ns
        for measurement in self._ordered(read, stream):
            yield measurement
            if isinstance(measurement, (LaserScan, PointCloud)):
                self.log.progress.update((measurement.stamp_ns - began) / 1e9)
        stream.tell()

    def _ordered(self, read: Iterator[Measurement], stream: SensorStream) -> Iterator[Measurement]:
        if not self.plan.samples_first:
            for measurement in read:
                yield from stream.of(measurement)
            return
        order = SensorOrder(self.picks.sample_topics, (), self.log, by_stamp=False)
        now_ns = 0
        for measurement in read:
            now_ns = max(now_ns, measurement.stamp_ns)
            for found in stream.of(measurement):
                yield from order.add(found)
            yield from order.ready(now_ns)
        yield from order.ready(None)


def feed_sensors(
    recording: Recording,
    tier: Tier,
    parameters: Any,
    given: Mapping[str, str],
    names: TopicNames,
    log: RunLog,
    *,
    mode: str | None = None,
    start_s: float | None = None,
    duration_s: float | None = None,
) -> SensorFeed:
    """Pick topics, frames and mounts for a tier.

    Parameters
    ----------
    given
        Where each parameter that the user set stands, by native name.
    names
        Topics and frames that the user names.
    mode
        The tier's mode that the user asks for.
    start_s, duration_s
        The part of the recording to read, seconds.

    Raises
    ------
    RecordingError
        If a topic is missing, empty or of another type.
    UsageError
        If the tier has no such mode or no use for a named topic, or ``--laser-pose`` is to place several scanners.
    """
    check_usage(tier, names, mode)
    offer = replace(offered_sensors(recording, names, tier.roles), mode=mode)
    plan = tier.plan(parameters, given, offer, log)
    return planned_sensors(recording, tier, plan, names, log, start_s=start_s, duration_s=duration_s)


def planned_sensors(
    recording: Recording,
    tier: Tier,
    plan: InputPlan,
    names: TopicNames,
    log: RunLog,
    *,
    camera_frame: str | None = None,
    start_s: float | None = None,
    duration_s: float | None = None,
) -> SensorFeed:
    """Pick topics, frames and mounts as planned.

    Parameters
    ----------
    camera_frame
        From where the base frame is looked for; None: from the first range sensor.

    Raises
    ------
    InputError
        As `feed_sensors`.
    """
    num_scans = plan.num_laser_scans + (plan.num_multi_echo_laser_scans or 0)
    if len(names.scans) > num_scans and names.scans != (NONE,):
        repeated = len(set(names.scans)) < len(names.scans)
        why = "one topic more than once" if repeated else f"{tier.name} takes {_scanners(num_scans)}"
        raise UsageError(f"--scan-topic was given {len(names.scans)} times: {why}")
    picks = pick_sensors(recording, names, plan, tier.roles, camera_frame=camera_frame)
    mounts = _mounts(recording, picks, plan)
    fans: dict[str, Fan] = {}
    for topic in picks.scans:
        first: list[LaserScan] = list(
            islice(recording.measurements([topic], start_s=start_s, duration_s=duration_s), FAN_SAMPLE)
        )
        fan = most_frequent_fan([turn_counter_clockwise(s, mirrored=mounts[topic.name].upside_down) for s in first])
        if fan is not None:
            fans[topic.name] = fan
    base = picks.odometry.base_frame
    return SensorFeed(
        recording=recording,
        plan=plan,
        picks=picks,
        mounts=mounts,
        T_base_sensor={
            topic.name: find_sensor_mount(
                recording, base_frame=base, sensor_frame=picks.frames.get(topic.name, ""), what=OTHERS[role]
            )
            for role, topic in others(picks).items()
        },
        fans=fans,
        start_s=start_s,
        duration_s=duration_s,
        log=log,
    )


def _scanners(number: int) -> str:
    return {0: "no scanner", 1: "one scanner"}.get(number, f"{number} scanners")


def check_usage(tier: Tier, names: TopicNames, mode: str | None) -> None:
    """Refuse a mode that the tier does not have, and topics that it has no use for."""
    if mode is not None and mode not in tier.modes:
        raise UsageError(f"--mode {mode}: {tier.name} has {', '.join(tier.modes) or 'one mode only'}")
    for role, topics in names.named().items():
        if role not in tier.roles:
            raise UsageError(f"{ROLES[role]} {topics[0]}: {tier.name} has no use for it")


def _mounts(recording: Recording, picks: SensorPicks, plan: InputPlan) -> dict[str, LaserMount]:
    """Return where the range sensors sit, by topic."""
    if recording.mends.laser_pose is not None and len(picks.ranges) > 1:
        named = ", ".join(topic.name for topic in picks.ranges)
        raise UsageError(f"--laser-pose places one scanner, and there are {named}: give --static-tf for each of them")
    base = picks.odometry.base_frame
    mounts = {}
    for topic in picks.scans:
        frame = picks.frames[topic.name]
        mounts[topic.name] = find_laser_mount(recording, base_frame=base, laser_frame=frame, planar=not plan.spatial)
    for topic in picks.clouds:
        mounts[topic.name] = find_cloud_mount(recording, base_frame=base, cloud_frame=picks.frames[topic.name])
    return mounts


def _listed(role: str, values: list[Any]) -> dict[str, Any]:
    """Return one entry: the value where there is one, a list where there are several, none where there is none."""
    return {} if not values else {role: values[0] if len(values) == 1 else values}
