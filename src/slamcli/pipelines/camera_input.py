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
from slamcli.mapper import InputPlan, Tier
from slamcli.measurements import (
    CameraRig,
    Image,
    Measurement,
    RgbdFrame,
    StereoPair,
)
from slamcli.pipelines.camera_finding import CameraRequest, FoundCameras, found_cameras
from slamcli.pipelines.camera_rig import BuiltRig, RigSources, build_rig
from slamcli.pipelines.frame_pairing import DEPTH_TOLERANCE_S, STEREO_TOLERANCE_S, FramePairing
from slamcli.pipelines.imu_halves import united
from slamcli.pipelines.reading_ahead import read_ahead
from slamcli.recordings import Recording, Topic
from slamcli.recordings.camera_topics import CameraNames, CameraTopics
from slamcli.recordings.raw import RawMessage
from slamcli.recordings.stamps import stamp_reader
from slamcli.runtime import RunLog

_RATE_SAMPLE = 40
_DEFAULT_RATE_HZ = 30.0


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
    def cameras(self) -> CameraFeed:
        """The part of a feed that gives images: all of this one."""
        return self

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
        pairing = self.pairing(self._imu_name())

        def decoded(log: RunLog) -> Iterator[Measurement]:
            read = self.recording.measurements(
                self.streamed, start_s=self.request.start_s, duration_s=self.request.duration_s, log=log
            )
            return pairing.run(self.whole_imu(read))

        for measurement in read_ahead(decoded, self.log):
            yield measurement
            self.note(measurement)
        self.tell(pairing)

    @property
    def streamed(self) -> list[str]:
        """Names of the topics that are read."""
        imu = [topic.name for topic in (self.imu, self.accelerometer) if topic is not None]
        return [name for name in (self.main, self.partner) if name is not None] + imu

    def pairing(self, imu: str | None) -> FramePairing:
        """Return what makes frames of images, for one reading of the recording."""
        return FramePairing(self.main, self.partner, self._tolerance_ns(), imu, self.log)

    def whole_imu(self, read: Iterator[Measurement]) -> Iterator[Measurement]:
        """Return measurements with the two halves of the IMU as one, where they come apart."""
        if self.imu is None or self.accelerometer is None:
            return read
        return united(read, self.imu.name, self.accelerometer.name)

    def note(self, measurement: Measurement) -> None:
        """Take note of what was handed over."""
        if isinstance(measurement, (Image, StereoPair, RgbdFrame)):
            self._stamps_ns[1:] = [measurement.stamp_ns]
            self.log.progress.update((measurement.stamp_ns - self.recording.start_ns) / 1e9)

    def tell(self, pairing: FramePairing) -> None:
        """Say what came of a reading, once it is over.

        Raises
        ------
        RecordingError
            If there is not one frame.
        """
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
    found = found_cameras(recording, request)
    plan = tier.plan(parameters, given, found.offer(recording, request), log)
    return planned_cameras(recording, plan, request, found, log)


def planned_cameras(
    recording: Recording, plan: InputPlan, request: CameraRequest, found: FoundCameras, log: RunLog
) -> CameraFeed:
    """Pick the topics of the planned mode, and build the rig.

    Raises
    ------
    CalibrationError
        If a camera's calibration or place is unknown or does not fit.
    """
    mode = plan.camera_mode or "mono"
    main, partner = found.topics.of(mode)
    _tell_choice(found.topics, mode, main, partner, request.names, log)
    used = found.imu if plan.imu else None
    sources = RigSources(
        mode=mode, main=main, partner=partner, imu_frame=found.imu_frame if used is not None else None,
        imu_noise=found.imu_noise, given=request.calibration, camera_info=request.names.camera_info,
        base_frame=request.base_frame, rate_hz=_rate_hz(recording, main.topic),
    )  # fmt: skip
    for note in request.calibration.notes if request.calibration is not None else ():
        log.warn(note)
    built = build_rig(recording, sources)
    return CameraFeed(
        recording=recording, plan=plan, request=request, main=main.topic,
        partner=None if partner is None else partner.topic, imu=used,
        accelerometer=found.accelerometer if used is not None else None, built=built, log=log,
    )  # fmt: skip


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
