# SPDX-License-Identifier: MIT
"""Images together with range sensors and odometry, for a tier that uses both."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError, RecordingError, UsageError
from slamcli.mapper import InputPlan, SensorOffer, Tier
from slamcli.measurements import CameraRig, Image, ImuSample, Measurement, Odometry
from slamcli.pipelines.camera_finding import CameraRequest, FoundCameras, found_cameras
from slamcli.pipelines.camera_input import CameraFeed, planned_cameras
from slamcli.pipelines.config import NativeConfig
from slamcli.pipelines.range_input import SensorFeed, check_usage, planned_sensors
from slamcli.pipelines.reading_ahead import read_ahead
from slamcli.pipelines.sensor_order import SensorOrder
from slamcli.pipelines.sensor_stream import SensorStream
from slamcli.recordings import Recording
from slamcli.recordings.odometry_pick import FROM_TF, pick_odometry
from slamcli.recordings.sensor_picks import NONE, TopicNames, offered_sensors, range_frames
from slamcli.recordings.topic_ranks import usable_odometry
from slamcli.runtime import RunLog

WITHOUT_CAMERAS = "scan"
"""The mode of such a tier in which images are left alone."""


class _Window(TypedDict):
    """The part of the recording to read, seconds."""

    start_s: float | None
    duration_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FusedFeed:
    """Where measurements of all kinds come from; `measurements` may be read once."""

    recording: Recording
    plan: InputPlan
    cameras: CameraFeed
    sensors: SensorFeed
    log: RunLog

    @property
    def rig(self) -> CameraRig:
        """The cameras; with odometry, whose frame is level, the base is known to stand upright."""
        rig = self.cameras.rig
        level = self.sensors.picks.odometry.odometry != "none"
        return replace(rig, base_is_upright=rig.base_is_upright or level)

    @property
    def base_frame(self) -> str:
        """The robot's frame, whose poses are asked for."""
        return self.sensors.base_frame

    @property
    def T_base_laser(self) -> Mapping[str, NDArray[np.float64]]:  # noqa: N802 - frames stand in names
        """Mount of each range sensor by topic, float64 (4, 4)."""
        return self.sensors.T_base_laser

    @property
    def T_base_sensor(self) -> Mapping[str, NDArray[np.float64]]:  # noqa: N802
        """Mount of each other sensor by topic, float64 (4, 4)."""
        return {**self.sensors.T_base_sensor, **self.cameras.T_base_sensor}

    @property
    def topics(self) -> Mapping[str, Any]:
        """What was picked, by role, for ``run.json``."""
        return {**self.cameras.topics, **self.sensors.topics}

    @property
    def frames(self) -> Mapping[str, Any]:
        """The frames that were picked, by role, for ``run.json``."""
        return {**self.cameras.frames, **self.sensors.frames}

    @property
    def length_s(self) -> float:
        """Seconds between the first and the last frame that were read."""
        return self.cameras.length_s

    def measurements(self) -> Iterator[Measurement]:
        """Yield frames, scans and clouds in the order of their stamps, each after its samples of odometry and IMU.

        These are all samples up to its end and the first one after it, unless they pause (see
        `slamcli.pipelines.sensor_order`). All is read and decoded ahead on a thread.

        Raises
        ------
        RecordingError
            If there is not one frame.
        """
        pairing = self.cameras.pairing(None)
        window = _Window(start_s=self.sensors.start_s, duration_s=self.sensors.duration_s)

        def decoded(log: RunLog) -> Iterator[Measurement]:
            picks = self.sensors.picks
            stream = SensorStream(self.recording, self.plan, picks, self.sensors.mounts, self.sensors.fans, log)
            imu = () if self.cameras.imu is None else (self.cameras.imu.name,)
            order = SensorOrder((*picks.sample_topics, *imu), stream.tf_track(**window), log)
            streamed = [topic.name for topic in stream.topics]
            read = self.recording.measurements([*self.cameras.streamed, *streamed], **window, log=log)
            for measurement in self.cameras.whole_imu(read):
                if isinstance(measurement, Image):
                    pairing.take(measurement)
                elif getattr(measurement, "topic", "") in streamed:
                    for found in stream.of(measurement):
                        yield from order.add(found)
                else:
                    yield from order.add(measurement)
                if isinstance(measurement, Image):
                    for frame in pairing.decided(measurement.stamp_ns):
                        yield from order.add(frame)
                if not isinstance(measurement, (Odometry, ImuSample)):  # whose clock may be ahead
                    yield from order.ready(measurement.stamp_ns, pairing.waits_since_ns)
            for frame in pairing.decided(None):
                yield from order.add(frame)
            yield from order.ready(None)
            order.tell()
            stream.tell()

        for measurement in read_ahead(decoded, self.log):
            yield measurement
            self.cameras.note(measurement)
        self.cameras.tell(pairing)


def feed_fused(
    recording: Recording, tier: Tier, config: NativeConfig, names: TopicNames, request: CameraRequest, log: RunLog
) -> SensorFeed | CameraFeed | FusedFeed:
    """Return the feed of a tier that uses images and range sensors: of what the recording holds, as the tier plans it.

    Images alone, or range sensors alone, are fed as to a tier that uses nothing else. What tf does not join with the
    cameras is left out with a warning; if the user named it that is an error.

    Raises
    ------
    RecordingError
        If a topic is missing, empty or of another type, or there is nothing to map with.
    CalibrationError
        If a camera's calibration is unknown, or the place of a sensor that was named.
    UsageError
        If the tier has no such mode, or no use for a named topic.
    """
    check_usage(tier, names, request.mode)
    window = _Window(start_s=request.start_s, duration_s=request.duration_s)
    found = _cameras(recording, request)
    if found is None:
        offer = offered_sensors(recording, names, tier.roles, ranges_needed=False)
        _check_any(recording, offer, request)
    else:
        names = _joined(recording, tier, names, found, log)
        offer = offered_sensors(recording, names, tier.roles, ranges_needed=False)
        seen = found.offer(recording, request)
        images = {"images"} if request.names.named() else set()
        offer = replace(
            offer, cameras=seen.cameras, imu=seen.imu, imu_placed=seen.imu_placed, imu_calibrated=seen.imu_calibrated,
            named=offer.named | images,
        )  # fmt: skip
    plan = tier.plan(config.parameters, config.sources, replace(offer, mode=request.mode), log)
    names = _with_plan(recording, names, plan, log)
    if found is None or plan.camera_mode is None:
        return planned_sensors(recording, tier, plan, names, log, **window)
    ranges = plan.num_laser_scans + (plan.num_multi_echo_laser_scans or 0) + plan.num_point_clouds
    if not (ranges or plan.odometry or plan.fixes or plan.landmarks):
        base = request.base_frame or _carrier(recording, plan.base_frame, found.camera_frame)
        return planned_cameras(recording, plan, replace(request, base_frame=base), found, log)
    # The IMU goes with the cameras: they know its two halves, and its place by calibration files.
    sensors = planned_sensors(
        recording, tier, replace(plan, imu=False), names, log, camera_frame=found.camera_frame, **window
    )
    cameras = planned_cameras(recording, plan, replace(request, base_frame=sensors.base_frame), found, log)
    return FusedFeed(recording=recording, plan=plan, cameras=cameras, sensors=sensors, log=log)


def _with_plan(recording: Recording, names: TopicNames, plan: InputPlan, log: RunLog) -> TopicNames:
    """Return the names with odometry from the transforms of the frame that the configuration names, if it is there."""
    if plan.odom_frame is None or names.odometry is not None or not plan.odometry:
        return names
    if plan.odom_frame not in recording.frames().frames:
        log.warn(f"the configuration's frame of odometry, {plan.odom_frame}, is not in tf: odometry is found by itself")
        return names
    return replace(names, odometry=FROM_TF, odom_frame=names.odom_frame or plan.odom_frame)


def _carrier(recording: Recording, configured: str | None, camera_frame: str) -> str | None:
    """Return the robot's frame as the configuration names it, None where tf does not say where the camera sits on it."""
    tree = recording.frames()
    if configured is None or configured not in tree.frames or not tree.connected(configured, camera_frame):
        return None
    return configured


def _cameras(recording: Recording, request: CameraRequest) -> FoundCameras | None:
    """Return the cameras; None where there are none, or they are not to be used."""
    named = request.names.named()
    if request.mode == WITHOUT_CAMERAS:
        for option, topic in named.items():
            raise UsageError(f"{option} {topic}: --mode {WITHOUT_CAMERAS} takes no images")
        return None
    if not named and not any(topic.count != 0 for topic in recording.topics(Image)):
        return None
    try:
        return found_cameras(recording, request)
    except RecordingError:
        if named or request.mode is not None:
            raise
        return None  # depth without colour, say


def _check_any(recording: Recording, offer: SensorOffer, request: CameraRequest) -> None:
    if offer.num_laser_scans or offer.num_multi_echo_laser_scans or offer.num_point_clouds:
        return
    held = ", ".join(
        f"{topic.name} ({topic.msgtype.replace('/msg/', '/')})" for topic in recording.contents.topics[:12]
    )
    images = "" if request.mode == WITHOUT_CAMERAS else "no images and "
    raise RecordingError(f"{recording.name}: {images}no scans or point clouds (it has {held or 'no topics at all'})")


def _joined(recording: Recording, tier: Tier, names: TopicNames, found: FoundCameras, log: RunLog) -> TopicNames:
    """Return the names, with ``none`` for odometry and range sensors that cannot go together with the cameras.

    Raises
    ------
    CalibrationError
        If one of them was named.
    """
    tree, camera = recording.frames(), found.camera_frame
    named = names.named()
    if names.odometry is None and not _has_odometry(recording, names):
        names = replace(names, odometry=NONE)
    ranges = range_frames(recording, names, tier.roles)
    if names.odometry == NONE and not ranges:
        return names
    base = pick_odometry(
        recording, camera, odom_topic=None if names.odometry == NONE else names.odometry, base_frame=names.base_frame,
        odom_frame=names.odom_frame, wanted=False,
    ).base_frame  # fmt: skip
    place = f"give its place with --static-tf {base},FRAME,x,y,z,yaw,pitch,roll or --urdf"
    if base != camera and not tree.connected(base, camera):
        lost = [*([] if names.odometry == NONE else ["odometry"]), *ranges]
        text = f"tf does not say where the camera ({camera or 'no frame'}) sits on the robot ({base}), so {' and '.join(lost)}"
        if named.keys() & {"odometry", "scans", "points"}:
            raise CalibrationError(f"{recording.name}: {text} cannot be used with its images: {place}")
        log.warn(f"{text} cannot be used with its images: only these are ({place})")
        return replace(names, odometry=NONE, scans=(NONE,), points=(NONE,))
    apart = [topic for topic, frame in ranges.items() if frame != base and not tree.connected(base, frame)]
    if not apart or recording.mends.laser_pose is not None:
        return names
    text = f"tf does not say where {' and '.join(apart)} sits on the robot ({base})"
    if named.keys() & {"scans", "points"}:
        raise CalibrationError(f"{recording.name}: {text}: {place}, or --laser-pose x,y,yaw")
    if len(apart) == len(ranges):
        log.warn(f"{text}: left out ({place}, or --laser-pose x,y,yaw)")
        return replace(names, scans=(NONE,), points=(NONE,))
    return names


def _has_odometry(recording: Recording, names: TopicNames) -> bool:
    """Return whether there is odometry that may be taken without being named: transforms of other frames may be the truth."""
    topics = [topic for topic in recording.topics(Odometry) if topic.count != 0]
    if usable_odometry(topics):
        return True
    moving = [edge.parent for edge in recording.frames().edges if not edge.static]
    return any("odom" in parent.lower() or parent == names.odom_frame for parent in moving)
