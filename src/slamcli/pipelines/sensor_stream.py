# SPDX-License-Identifier: MIT
"""Range sensors, odometry and other sensors' messages as a mapper takes them: cleaned, sampled, of the base frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from slamcli.mapper import InputPlan
from slamcli.measurements import LaserScan, Measurement, Odometry, PointCloud
from slamcli.pipelines.blind_spells import BlindSpells
from slamcli.pipelines.fixed_frame import FixedFrame
from slamcli.pipelines.message_sampling import FixedRatioSampler, sampler_by_topic
from slamcli.pipelines.odometry_input import moved_to, odometry_from_tf
from slamcli.pipelines.scan_cloud import cloud_of, scan_of
from slamcli.recordings import Recording, Topic
from slamcli.recordings.laser_mount import LaserMount
from slamcli.recordings.scan_normalisation import Fan, ScanNormaliser
from slamcli.recordings.sensor_picks import SensorPicks
from slamcli.runtime import RunLog

OTHERS = {"imu": "IMU", "fixes": "receiver", "landmarks": "landmark detector"}
"""Roles of sensors that are neither scanners nor odometry, and what they are called."""


class SensorStream:
    """Turns the messages of the topics that were picked into measurements, one by one in the order in which they come.

    Parameters
    ----------
    mounts
        Of each range sensor, by topic.
    fans
        Of each planar scanner, by topic; those without scans have none.
    log
        Takes what there is to say; the thread's own, where the recording is read on another one.
    """

    def __init__(
        self, recording: Recording, plan: InputPlan, picks: SensorPicks, mounts: Mapping[str, LaserMount],
        fans: Mapping[str, Fan], log: RunLog,
    ) -> None:  # fmt: skip
        self._recording, self._plan, self._picks = recording, plan, picks
        self._sampler = sampler_by_topic(picks, plan.ratios)
        self._child_to_base = moved_to(recording, picks.odometry)
        self._fixed, self._blind = FixedFrame(log), BlindSpells(log)
        self._normalisers = {
            name: ScanNormaliser(
                fan, mirrored=mounts[name].upside_down, log=log, name=name if len(fans) > 1 else ""
            )
            for name, fan in fans.items()
        }  # fmt: skip
        self._clouds_of_scans = plan.spatial and not plan.keep_scans

    @property
    def topics(self) -> list[Topic]:
        """Every topic that is read message by message."""
        picks = self._picks
        scans = [topic for topic in picks.scans if topic.name in self._normalisers]
        odometry = [picks.odometry.odom_topic] if picks.odometry.odom_topic is not None else []
        return [*scans, *picks.clouds, *odometry, *others(picks).values()]

    def tf_track(self, start_s: float | None, duration_s: float | None) -> Iterator[Odometry]:
        """Yield the odometry that the transforms hold, where it is taken from them, in the order of its stamps."""
        if self._picks.odometry.odometry != "tf":
            return
        sampler = FixedRatioSampler(self._plan.ratios.get("odometry", 1.0))
        track = odometry_from_tf(
            self._recording, self._picks.odometry, spatial=self._plan.spatial, start_s=start_s, duration_s=duration_s
        )
        yield from (measurement for measurement in track if sampler.pulse())

    def of(self, measurement: Measurement) -> Iterator[Measurement]:
        """Yield what becomes of the next message: nothing where it is left out."""
        topic = getattr(measurement, "topic", "")
        if not self._sampler[topic].pulse():
            return
        fixes = self._picks.fixes
        if isinstance(measurement, LaserScan):
            scan = self._normalisers[topic].normalise(measurement)
            self._blind.see(scan)
            yield cloud_of(scan) if self._clouds_of_scans else scan
        elif fixes is not None and topic == fixes.name:
            yield from self._fixed.poses(measurement)  # type: ignore[arg-type]
        elif isinstance(measurement, Odometry):
            yield self._child_to_base(measurement)
        else:
            if isinstance(measurement, PointCloud):
                self._blind.see(measurement)
            yield self._flat(measurement) if isinstance(measurement, PointCloud) else measurement

    def _flat(self, cloud: PointCloud) -> PointCloud | LaserScan:
        if not self._plan.clouds_as_scans:
            return cloud
        return scan_of(
            cloud.points_m[:, :2].astype(np.float64), stamp_ns=cloud.stamp_ns, frame_id=cloud.frame_id, topic=cloud.topic,
            offset_ns=cloud.offset_ns,
        )  # fmt: skip

    def tell(self) -> None:
        """Say what was noticed, once everything was read."""
        self._blind.tell()
        for normaliser in self._normalisers.values():
            normaliser.tell()


def others(picks: SensorPicks) -> dict[str, Topic]:
    """Return the topics of sensors that are neither scanners nor odometry, by role."""
    found = {role: getattr(picks, role) for role in OTHERS}
    return {role: topic for role, topic in found.items() if topic is not None}
