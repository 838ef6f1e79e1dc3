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
from slamcli.measurements import LaserScan, Measurement, Odometry, PointCloud
from slamcli.pipelines.blind_spells import BlindSpells
from slamcli.pipelines.fixed_frame import FixedFrame
from slamcli.pipelines.message_sampling import FixedRatioSampler, sampler_by_topic
from slamcli.pipelines.odometry_input import moved_to, odometry_from_tf
from slamcli.pipelines.scan_cloud import cloud_of
from slamcli.recordings import Recording, Topic
from slamcli.recordings.laser_mount import LaserMount, find_cloud_mount, find_laser_mount, find_sensor_mount
from slamcli.recordings.scan_normalisation import (
    FAN_SAMPLE,
    Fan,
    ScanNormaliser,
    most_frequent_fan,
    turn_counter_clockwise,
)
from slamcli.recordings.sensor_picks import ROLES, SensorPicks, TopicNames, offered_sensors, pick_sensors
from slamcli.runtime import RunLog

_SENSORS = {"imu": "IMU", "fixes": "receiver", "landmarks": "landmark detector"}


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
    def rig(self) -> None:
        """No cameras."""
        return None

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
            **{role: found.name for role, found in self._others().items()},
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
            **{role: picks.frames.get(found.name) for role, found in self._others().items()},
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
        tf has no place in that order, and comes first.
        """
        sampler = sampler_by_topic(self.picks, self.plan.ratios)
        odometry = self.picks.odometry
        if odometry.odometry == "tf":
            tf_sampler = FixedRatioSampler(self.plan.ratios.get("odometry", 1.0))
            track = odometry_from_tf(
                self.recording, odometry, spatial=self.plan.spatial, start_s=self.start_s, duration_s=self.duration_s
            )
            yield from (measurement for measurement in track if tf_sampler.pulse())
        child_to_base = moved_to(self.recording, odometry)
        fixed = FixedFrame(self.log)
        normalisers, blind = self._normalisers(), BlindSpells(self.log)
        began = self.recording.start_ns
        for measurement in self.recording.measurements(
            self._streamed(), start_s=self.start_s, duration_s=self.duration_s, log_order=True
        ):
            if not sampler[measurement.topic].pulse():
                continue
            if isinstance(measurement, LaserScan):
                scan = normalisers[measurement.topic].normalise(measurement)
                blind.see(scan)
                yield cloud_of(scan) if self.plan.spatial and not self.plan.keep_scans else scan
            elif self.picks.fixes is not None and measurement.topic == self.picks.fixes.name:
                yield from fixed.poses(measurement)
            elif isinstance(measurement, Odometry):
                yield child_to_base(measurement)
            else:
                yield measurement
            if isinstance(measurement, PointCloud):
                blind.see(measurement)
            if isinstance(measurement, (LaserScan, PointCloud)):
                self.log.progress.update((measurement.stamp_ns - began) / 1e9)
        blind.tell()
        for normaliser in normalisers.values():
            normaliser.tell()

    def _streamed(self) -> list[Topic]:
        """Return every topic that is read message by message."""
        scans = [topic for topic in self.picks.scans if topic.name in self.fans]
        odometry = [self.picks.odometry.odom_topic] if self.picks.odometry.odom_topic is not None else []
        return [*scans, *self.picks.clouds, *odometry, *self._others().values()]

    def _normalisers(self) -> dict[str, ScanNormaliser]:
        return {
            name: ScanNormaliser(
                fan, mirrored=self.mounts[name].upside_down, log=self.log, name=name if len(self.fans) > 1 else ""
            )
            for name, fan in self.fans.items()
        }

    def _others(self) -> dict[str, Topic]:
        """Return the topics of sensors that are neither scanners nor odometry, by role."""
        found = {role: getattr(self.picks, role) for role in _SENSORS}
        return {role: topic for role, topic in found.items() if topic is not None}


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
    _check_usage(tier, names, mode)
    offer = replace(offered_sensors(recording, names, tier.roles), mode=mode)
    plan = tier.plan(parameters, given, offer, log)
    num_scans = plan.num_laser_scans + (plan.num_multi_echo_laser_scans or 0)
    if len(names.scans) > num_scans:
        repeated = len(set(names.scans)) < len(names.scans)
        why = "one topic more than once" if repeated else f"{tier.name} takes one scanner"
        raise UsageError(f"--scan-topic was given {len(names.scans)} times: {why}")
    picks = pick_sensors(recording, names, plan, tier.roles)
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
    others = {role: topic for role in _SENSORS if (topic := getattr(picks, role)) is not None}
    return SensorFeed(
        recording=recording,
        plan=plan,
        picks=picks,
        mounts=mounts,
        T_base_sensor={
            topic.name: find_sensor_mount(
                recording, base_frame=base, sensor_frame=picks.frames.get(topic.name, ""), what=_SENSORS[role]
            )
            for role, topic in others.items()
        },
        fans=fans,
        start_s=start_s,
        duration_s=duration_s,
        log=log,
    )


def _check_usage(tier: Tier, names: TopicNames, mode: str | None) -> None:
    """Refuse a mode that the tier does not have, and topics that it has no use for."""
    if mode is not None and mode not in tier.modes:
        raise UsageError(f"--mode {mode}: {tier.name} has {' and '.join(tier.modes) or 'one mode only'}")
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
