# SPDX-License-Identifier: MIT
"""Images, and the IMU samples that belong to them, as a tier that sees takes them from a recording."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import RecordingError, UsageError
from slamcli.mapper import InputPlan, SensorOffer, Tier
from slamcli.measurements import (
    CameraRig,
    Image,
    ImuNoise,
    ImuSample,
    Measurement,
    RgbdFrame,
    RigCalibration,
    StereoPair,
)
from slamcli.pipelines.camera_rig import BuiltRig, RigSources, build_rig, has_imu_place
from slamcli.pipelines.frame_pairing import DEPTH_TOLERANCE_S, STEREO_TOLERANCE_S, FramePairing
from slamcli.pipelines.imu_halves import find_halves, united
from slamcli.pipelines.reading_ahead import read_ahead
from slamcli.recordings import Recording, Topic
from slamcli.recordings.camera_topics import CameraNames, CameraTopics, find_camera_topics
from slamcli.recordings.imu_noise import recorded_noise
from slamcli.recordings.raw import RawMessage
from slamcli.recordings.sensor_picks import NONE
from slamcli.recordings.stamps import stamp_reader
from slamcli.recordings.topic_ranks import IMUS, best_topics
from slamcli.runtime import RunLog

_RATE_SAMPLE = 40
_DEFAULT_RATE_HZ = 30.0


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
class CameraFeed:
    """Where frames come from; `measurements` may be read once."""

    recording: Recording
    plan: InputPlan
    request: CameraRequest
    main: str
    """Topic of the left, colour or only camera."""
    partner: str | None
    imu: Topic | None
    accelerometer: Topic | None
    """Where the accelerometer has a topic of its own: `imu` is the gyroscope's then."""
    built: BuiltRig
    log: RunLog
    _stamps_ns: list[int] = field(default_factory=list)
    """Of the first and the last frame so far."""

    @property
    def rig(self) -> CameraRig:
        """The cameras."""
        return self.built.rig

    @property
    def base_frame(self) -> str:
        """The frame whose poses are asked for."""
        return self.built.base_frame

    @property
    def T_base_laser(self) -> Mapping[str, NDArray[np.float64]]:  # noqa: N802 - frames stand in names
        """No range sensors."""
        return {}

    @property
    def T_base_sensor(self) -> Mapping[str, NDArray[np.float64]]:  # noqa: N802
        """Mount of the IMU by topic, float64 (4, 4)."""
        rig = self.rig
        if self.imu is None or rig.T_main_imu is None:
            return {}
        return {self.imu.name: rig.T_base_main @ rig.T_main_imu}

    @property
    def topics(self) -> Mapping[str, Any]:
        """What was picked, by role, for ``run.json``."""
        names = {"stereo": ("left", "right"), "rgbd": ("rgb", "depth"), "mono": ("rgb", "")}[self.rig.mode]
        found: dict[str, Any] = {names[0]: self.main}
        if self.partner is not None:
            found[names[1]] = self.partner
        if self.imu is not None:
            names_of_imu = [topic.name for topic in (self.imu, self.accelerometer) if topic is not None]
            found["imu"] = names_of_imu[0] if len(names_of_imu) == 1 else names_of_imu
        return found

    @property
    def frames(self) -> Mapping[str, Any]:
        """The frames that were picked, by role, for ``run.json``."""
        return {"base": self.base_frame, "camera": self.built.camera_frame}

    @property
    def length_s(self) -> float:
        """Seconds between the first and the last frame that were read: an IMU may go on for longer."""
        return (self._stamps_ns[-1] - self._stamps_ns[0]) / 1e9 if self._stamps_ns else 0.0

    def measurements(self) -> Iterator[Measurement]:
        """Yield frames in the order of their stamps, each after its IMU samples; they are decoded ahead on a thread.

        Raises
        ------
        RecordingError
            If there is not one frame.
        """
        pairing = FramePairing(self.main, self.partner, self._tolerance_ns(), self._imu_name(), self.log)
        accelerometer = None if self.accelerometer is None else self.accelerometer.name
        topics = [name for name in (self.main, self.partner, self._imu_name(), accelerometer) if name is not None]

        def decoded(log: RunLog) -> Iterator[Measurement]:
            read = self.recording.measurements(
                topics, start_s=self.request.start_s, duration_s=self.request.duration_s, log=log
            )
            if self.imu is not None and accelerometer is not None:
                return pairing.run(united(read, self.imu.name, accelerometer))
            return pairing.run(read)

        began = self.recording.start_ns
        for measurement in read_ahead(decoded, self.log):
            yield measurement
            if isinstance(measurement, (Image, StereoPair, RgbdFrame)):
                self._stamps_ns[1:] = [measurement.stamp_ns]
                self.log.progress.update((measurement.stamp_ns - began) / 1e9)
        if pairing.figures.num_frames == 0:
            raise RecordingError(f"{self.recording.name}: {self._why_none(pairing)}")
        pairing.tell("depth image" if self.rig.mode == "rgbd" else "right image")

    def _imu_name(self) -> str | None:
        return None if self.imu is None else self.imu.name

    def _tolerance_ns(self) -> int:
        given = self.request.pairing_tolerance_s
        if given is None:
            given = STEREO_TOLERANCE_S if self.rig.mode == "stereo" else DEPTH_TOLERANCE_S
            given = min(given, 0.5 / self.rig.rate_hz) if self.rig.mode == "stereo" else given
        return round(given * 1e9)

    def _why_none(self, pairing: FramePairing) -> str:
        if self.partner is None or pairing.figures.num_alone == 0:
            return f"no image on {self.main} can be used"
        firsts = [_first_stamp(self.recording, name) for name in (self.main, self.partner)]
        apart = "" if None in firsts else f" (the first ones are {(firsts[1] - firsts[0]) / 1e9:+.3f} s apart)"  # type: ignore[operator]
        return (
            f"no image on {self.partner} was taken within {self._tolerance_ns() / 1e6:g} ms of one on {self.main}{apart}:"
            f" shift the stamps with --time-offset {self.partner}=SECONDS, or allow more with --set slamcli.pairing_tolerance=SECONDS"
        )


def feed_cameras(
    recording: Recording, tier: Tier, parameters: Any, given: Collection[str], request: CameraRequest, log: RunLog
) -> CameraFeed:
    """Pick topics, the mode and the rig for a tier that sees.

    Parameters
    ----------
    given
        The parameters that the user set, by native name.

    Raises
    ------
    RecordingError
        If a topic is missing, empty or of another type, or there are no images.
    CalibrationError
        If a camera's calibration or place is unknown or does not fit.
    UsageError
        If the tier has no such mode.
    """
    if request.mode is not None and request.mode not in tier.modes:
        raise UsageError(f"--mode {request.mode}: {tier.name} has {', '.join(tier.modes) or 'one mode only'}")
    cameras = find_camera_topics(recording, request.names)
    imu, accelerometer = _imu_topics(recording, request)
    imu_frame = _frame_of(recording, imu)
    noise = None if imu is None else recorded_noise(recording.raw, imu.name)
    plan = tier.plan(parameters, given, _offer(recording, request, cameras, imu_frame, noise), log)
    mode = plan.camera_mode or "mono"
    main, partner = cameras.of(mode)
    _tell_choice(cameras, mode, main, partner, request.names, log)
    used = imu if plan.imu else None
    sources = RigSources(
        mode=mode, main=main, partner=partner, imu_frame=imu_frame if used is not None else None, imu_noise=noise,
        given=request.calibration, camera_info=request.names.camera_info, base_frame=request.base_frame,
        rate_hz=_rate_hz(recording, main.topic),
    )  # fmt: skip
    for note in request.calibration.notes if request.calibration is not None else ():
        log.warn(note)
    built = build_rig(recording, sources)
    return CameraFeed(
        recording=recording, plan=plan, request=request, main=main.topic,
        partner=None if partner is None else partner.topic, imu=used,
        accelerometer=accelerometer if used is not None else None, built=built, log=log,
    )  # fmt: skip


def _offer(
    recording: Recording, request: CameraRequest, cameras: CameraTopics, imu_frame: str | None, noise: ImuNoise | None
) -> SensorOffer:
    """Return what the tier can choose from."""
    given = request.calibration
    noisy = noise is not None or (given is not None and given.imu_noise is not None)
    camera_frame = cameras.colour[0].frame_id
    place = imu_frame is not None and has_imu_place(recording, camera_frame, imu_frame, given)
    return SensorOffer(
        num_laser_scans=0,
        cameras=cameras.modes,
        imu=imu_frame is not None,
        imu_calibrated=noisy and place,
        named=frozenset({"imu"} if request.imu not in (None, NONE) else ()),
        mode=request.mode,
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


def _tell_choice(
    cameras: CameraTopics, mode: str, main: Image, partner: Image | None, names: CameraNames, log: RunLog
) -> None:
    if names.named():
        return
    others = [image.topic for image in (*cameras.colour, *cameras.depth) if image not in (main, partner)]
    if others:
        used = main.topic if partner is None else f"{main.topic} and {partner.topic}"
        options = {
            "stereo": "--left-topic and --right-topic",
            "rgbd": "--rgb-topic and --depth-topic",
            "mono": "--rgb-topic",
        }
        log.note(f"images: {used} (also there: {', '.join(others)}; choose with {options[mode]})")


def _stamps(recording: Recording, topic_name: str, number: int) -> list[int]:
    """Return the stamps of the first messages of a topic, undecoded."""
    topic = recording.topic(topic_name)
    read = stamp_reader("header", topic.encoding)

    def stamp(message: RawMessage) -> int:
        return read(message.data) or message.log_time_ns

    offset = recording.mends.time_offsets_ns.get(topic.name, 0)
    return [stamp(message) + offset for message in islice(recording.raw.messages((topic.name,)), number)]


def _first_stamp(recording: Recording, topic_name: str) -> int | None:
    return next(iter(_stamps(recording, topic_name, 1)), None)


def _rate_hz(recording: Recording, topic_name: str) -> float:
    """Return the frames per second of a topic, by its first stamps."""
    steps = np.diff(np.array(_stamps(recording, topic_name, _RATE_SAMPLE), dtype=np.int64))
    steps = steps[steps > 0]
    return _DEFAULT_RATE_HZ if len(steps) == 0 else 1e9 / float(np.median(steps))
