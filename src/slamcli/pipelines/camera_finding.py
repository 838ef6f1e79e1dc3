# SPDX-License-Identifier: MIT
"""Which cameras and which IMU of a recording a tier that sees can choose from."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.mapper import SensorOffer
from slamcli.measurements import ImuNoise, ImuSample, RigCalibration
from slamcli.pipelines.camera_rig import has_imu_place
from slamcli.pipelines.imu_halves import find_halves
from slamcli.recordings import Recording, Topic
from slamcli.recordings.camera_topics import CameraNames, CameraTopics, find_camera_topics
from slamcli.recordings.imu_noise import recorded_noise
from slamcli.recordings.sensor_picks import NONE
from slamcli.recordings.topic_ranks import IMUS, best_topics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraRequest:
    """What of a recording's cameras to use; None: found from the recording."""

    names: CameraNames
    imu: str | None = None
    """IMU topic, or ``none``."""
    mode: str | None = None
    base_frame: str | None = None
    calibration: RigCalibration | None = None
    """By files: goes before what the recording says."""
    pairing_tolerance_s: float | None = None
    start_s: float | None = None
    duration_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundCameras:
    """The cameras and the IMU of a recording."""

    topics: CameraTopics
    imu: Topic | None
    accelerometer: Topic | None
    """Where the accelerometer has a topic of its own."""
    imu_frame: str | None
    imu_noise: ImuNoise | None
    """As the recording says it."""

    @property
    def camera_frame(self) -> str:
        """Frame of the main camera, as its images name it."""
        return self.topics.colour[0].frame_id

    def offer(self, recording: Recording, request: CameraRequest) -> SensorOffer:
        """Return what a tier can choose from."""
        given = request.calibration
        noisy = self.imu_noise is not None or (given is not None and given.imu_noise is not None)
        place = self.imu_frame is not None and has_imu_place(recording, self.camera_frame, self.imu_frame, given)
        return SensorOffer(
            num_laser_scans=0,
            cameras=self.topics.modes,
            imu=self.imu_frame is not None,
            imu_placed=place,
            imu_calibrated=noisy and place,
            named=frozenset({"imu"} if request.imu not in (None, NONE) else ()),
            mode=request.mode,
        )


def found_cameras(recording: Recording, request: CameraRequest) -> FoundCameras:
    """Return the cameras and the IMU of a recording.

    Raises
    ------
    RecordingError
        If a topic is missing, empty or of another type, or there are no images.
    """
    topics = find_camera_topics(recording, request.names)
    imu, accelerometer = _imu_topics(recording, request)
    noise = None if imu is None else recorded_noise(recording.raw, imu.name)
    return FoundCameras(
        topics=topics, imu=imu, accelerometer=accelerometer, imu_frame=_frame_of(recording, imu), imu_noise=noise
    )


def _imu_topics(recording: Recording, request: CameraRequest) -> tuple[Topic | None, Topic | None]:
    """Return the topic of the IMU, and that of its accelerometer where the two halves come apart."""
    if request.imu == NONE:
        return None, None
    if request.imu is not None:
        return recording.topic(request.imu, ImuSample), None
    found = [topic for topic in recording.topics(ImuSample) if topic.count != 0]
    halves = find_halves(found)
    if halves is not None:
        recording.log.note(
            f"IMU: gyroscope on {halves[0].name}, accelerometer on {halves[1].name}, interpolated to its stamps"
        )
        return halves
    return next(iter(best_topics(recording, found, 1, IMUS)), None), None


def _frame_of(recording: Recording, topic: Topic | None) -> str | None:
    if topic is None:
        return None
    first = next(iter(recording.measurements([topic])), None)
    return None if first is None else str(first.frame_id)
