# SPDX-License-Identifier: MIT
"""Which feed a tier gets of a recording: images, range sensors, or both."""

from __future__ import annotations

from dataclasses import replace

from slamcli.mapper import Tier
from slamcli.pipelines.camera_input import CameraFeed
from slamcli.pipelines.camera_request import check_no_cameras, feed_of, request_of
from slamcli.pipelines.config import NativeConfig
from slamcli.pipelines.database_feed import DatabaseFeed
from slamcli.pipelines.fused_input import FusedFeed, feed_fused
from slamcli.pipelines.range_input import SensorFeed, feed_sensors
from slamcli.pipelines.sensor_request import SensorRequest
from slamcli.recordings import Recording
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.runtime import RunLog

Feed = SensorFeed | CameraFeed | FusedFeed | DatabaseFeed


def find_feed(recording: Recording, tier: Tier, config: NativeConfig, asked: SensorRequest, log: RunLog) -> Feed:
    """Return where the tier's measurements come from.

    Raises
    ------
    InputError
        If a topic, a frame, a calibration or an option does not fit.
    """
    names = remapped_names(asked.names, config, recording)
    start_s, duration_s = asked.start_s, asked.duration_s
    sees, ranges = "images" in tier.roles, bool({"scans", "points"} & tier.roles)
    if sees and ranges:
        request = request_of(
            recording, config, names, asked.cameras, asked.camera_files,
            mode=asked.mode, start_s=start_s, duration_s=duration_s,
        )  # fmt: skip
        return feed_fused(recording, tier, config, names, request, log)
    if sees:
        return feed_of(
            recording, tier, config, names, asked.cameras, asked.camera_files, log,
            mode=asked.mode, start_s=start_s, duration_s=duration_s,
        )  # fmt: skip
    check_no_cameras(asked.cameras, asked.camera_files, tier.name)
    return feed_sensors(
        recording, tier, config.parameters, config.sources, names, log,
        mode=asked.mode, start_s=start_s, duration_s=duration_s,
    )  # fmt: skip


def remapped_names(names: TopicNames, config: NativeConfig, recording: Recording) -> TopicNames:
    """Return the topics and frames that are named: by flags, else by native files.

    A scanner's topic that a launch file names must be there; other sensors' topics are taken if the recording has them.
    """
    recorded = {topic.name.lstrip("/") for topic in recording.contents.topics}

    def remapped(role: str) -> str | None:
        return next((name for name in config.topics(role) if name.lstrip("/") in recorded), None)

    return replace(
        names,
        scans=names.scans or config.topics("scans"),
        points=names.points or config.topics("points"),
        odometry=names.odometry or remapped("odometry"),
        imu=names.imu or remapped("imu"),
        fixes=names.fixes or remapped("fixes"),
        landmarks=names.landmarks or remapped("landmarks"),
    )
