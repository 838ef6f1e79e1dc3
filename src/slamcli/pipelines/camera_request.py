# SPDX-License-Identifier: MIT
"""What options and native files say of the cameras, before the recording is looked at."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.mapper import Tier
from slamcli.measurements import RigCalibration
from slamcli.native.orbslam_cameras import rig_calibration
from slamcli.parameters import as_dict
from slamcli.pipelines.camera_calibration import load_calibration, overlaid
from slamcli.pipelines.camera_finding import CameraRequest
from slamcli.pipelines.camera_input import CameraFeed, feed_cameras
from slamcli.pipelines.config import NativeConfig
from slamcli.recordings import Mends, Recording
from slamcli.recordings.camera_topics import CameraNames
from slamcli.recordings.sensor_picks import ROLES, TopicNames
from slamcli.runtime import RunLog

_DEPTH_FACTOR = "RGBD.DepthMapFactor"
_CAMERA_GROUPS = ("Camera.", "Camera1.", "Camera2.", "Stereo.", "LEFT.", "RIGHT.", "IMU.")


def depth_unit(mends: Mends, config: NativeConfig) -> Mends:
    """Return the mends with the depth unit that the tier's parameters give; an option goes before it."""
    factor = as_dict(config.parameters).get(_DEPTH_FACTOR)
    if factor is None or mends.depth_units_per_m is not None:
        return mends
    return dataclasses.replace(mends, settings_depth_units_per_m=float(factor))


def check_no_cameras(names: CameraNames, files: Sequence[Path], tier: str) -> None:
    """Refuse options of cameras for a tier that does not see.

    Raises
    ------
    UsageError
        If there is one.
    """
    for option, topic in names.named().items():
        raise UsageError(f"{option} {topic}: {tier} has no use for it")
    if files:
        raise UsageError(f"--camera {files[0]}: {tier} has no use for it")


def feed_of(
    recording: Recording,
    tier: Tier,
    config: NativeConfig,
    names: TopicNames,
    cameras: CameraNames,
    files: Sequence[Path],
    log: RunLog,
    *,
    mode: str | None,
    start_s: float | None,
    duration_s: float | None,
) -> CameraFeed:
    """Return the feed of a tier that sees: calibration by ``--camera``, else by the tier's parameters, else recorded.

    Raises
    ------
    UsageError
        If topics are named that the tier has no use for.
    InputError
        As `slamcli.pipelines.camera_input.feed_cameras`.
    """
    for role, topics in names.named().items():
        if role not in tier.roles:
            raise UsageError(f"{ROLES[role]} {topics[0]}: {tier.name} has no use for it")
    request = request_of(recording, config, names, cameras, files, mode=mode, start_s=start_s, duration_s=duration_s)
    return feed_cameras(recording, tier, config.parameters, config.sources, request, log)


def request_of(
    recording: Recording,
    config: NativeConfig,
    names: TopicNames,
    cameras: CameraNames,
    files: Sequence[Path],
    *,
    mode: str | None,
    start_s: float | None,
    duration_s: float | None,
) -> CameraRequest:
    """Return what options and native files ask for: calibration by ``--camera`` before that of the tier's parameters.

    Raises
    ------
    InputError
        If a file is no calibration.
    """
    return CameraRequest(
        names=_with_remaps(cameras, config, recording), imu=names.imu, mode=mode, base_frame=names.base_frame,
        calibration=overlaid(_configured(config), load_calibration(files)),
        pairing_tolerance_s=_pairing_tolerance(as_dict(config.parameters)),
        start_s=start_s, duration_s=duration_s,
    )  # fmt: skip


def _pairing_tolerance(values: Mapping[str, Any]) -> float | None:
    """Return by how much stamps of two cameras may differ, s; None: not said (0 is no bound for RTAB-Map's node)."""
    given: float | None = values.get("slamcli.pairing_tolerance")
    return given if given is not None else values.get("approx_sync_max_interval") or None


def _configured(config: NativeConfig) -> RigCalibration | None:
    """Return the rig that the tier's parameters describe, where one was given."""
    given = [name for name in config.sources if name.startswith(_CAMERA_GROUPS)]
    if not given:
        return None
    values = as_dict(config.parameters)
    places = dict.fromkeys(
        source.rpartition(":")[0] or source for name, source in config.sources.items() if name in given
    )
    return rig_calibration({name: values[name] for name in given}, ", ".join(places))


def _with_remaps(cameras: CameraNames, config: NativeConfig, recording: Recording) -> CameraNames:
    """Return the names with those that a launch file gives, where the recording has such topics."""
    if cameras.named():
        return cameras
    recorded = {topic.name.strip("/") for topic in recording.contents.topics}
    found = {
        role: next((name for name in config.topics(role) if name.strip("/") in recorded), None)
        for role in ("left", "right", "rgb", "depth")
    }
    pair, rgbd = (found["left"], found["right"]), (found["rgb"], found["depth"])
    for role in ("left", "rgb"):
        for name in config.topics(role):
            if name.strip("/") not in recorded:
                recording.log.note(
                    f"the launch file's topic {name} is not in the recording: images are found by themselves"
                )
    if all(pair):
        return CameraNames(left=pair[0], right=pair[1])
    return CameraNames(rgb=rgbd[0], depth=rgbd[1])
