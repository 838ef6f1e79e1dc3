# SPDX-License-Identifier: MIT
"""What a data-set folder holds, as streams of messages that are made one at a time when they are asked for.

A stream keeps stamps and file names, never pixels, and opens a file anew for every message: several threads may read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, RecordingError
from slamcli.measurements import CameraModel, FrameTransform, ImuNoise, ImuSample, StampedPose
from slamcli.recordings.adapters import encoder_for, message_factory
from slamcli.recordings.adapters.compressed_image import damage_of, image_format, uncompress
from slamcli.recordings.adapters.tf_message import encode_transforms
from slamcli.recordings.imu_noise import NOISE_SUFFIX, noise_text

MILLIMETRES_PER_M = 1000.0
_NO_DEPTH = 65535
"""What several data sets write where the sensor saw nothing; 0 means the same."""


class Stream(Protocol):
    """The messages of one topic."""

    @property
    def topic(self) -> str: ...  # noqa: D102

    @property
    def msgtype(self) -> str: ...  # noqa: D102

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """int64 (N,), not decreasing, none of them 0."""

    def message(self, index: int) -> Any:
        """Return one message (of `message_factory("cdr")`).

        Raises
        ------
        RecordingError
            If the file that it lies in cannot be read.
        """


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageFiles:
    """Images as the bytes of their files: nothing is encoded anew."""

    topic: str
    frame_id: str
    stamps_ns: NDArray[np.int64]
    paths: Sequence[Path]
    msgtype: ClassVar[str] = "sensor_msgs/msg/CompressedImage"

    def message(self, index: int) -> Any:
        """Return the CompressedImage of one file."""
        messages = message_factory("cdr")
        data = read_image_file(self.paths[index])
        kind = image_format(data, self.paths[index].suffix)
        header = messages.header(int(self.stamps_ns[index]), self.frame_id)
        return messages.make(self.msgtype, header, kind, np.frombuffer(data, dtype=np.uint8))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthFiles:
    """Depth images of 16 bit, as the two encodings that ROS knows (REP 118): millimetres, else metres.

    Both say in every tool the depth that the files hold: a bag of them gives the same map as the folder.
    """

    topic: str
    frame_id: str
    stamps_ns: NDArray[np.int64]
    paths: Sequence[Path]
    units_per_m: float
    """Value of one metre in the files."""
    msgtype: ClassVar[str] = "sensor_msgs/msg/Image"

    def message(self, index: int) -> Any:
        """Return the Image of one file: 16UC1 where the files hold millimetres, else 32FC1 in metres; 0 is no depth."""
        path = self.paths[index]
        try:
            raw = uncompress(read_image_file(path))
        except DataError as error:
            raise RecordingError(f"{path}: {error}") from error
        if raw.ndim != 2 or raw.dtype != np.uint16:
            raise RecordingError(f"{path}: {raw.dtype} pixels of shape {raw.shape} are no depth: 16 bit grey is")
        raw[raw == _NO_DEPTH] = 0
        metres = self.units_per_m != MILLIMETRES_PER_M
        pixels = raw.astype(np.float32) / np.float32(self.units_per_m) if metres else raw
        messages = message_factory("cdr")
        return messages.make(
            self.msgtype,
            messages.header(int(self.stamps_ns[index]), self.frame_id),
            pixels.shape[0],
            pixels.shape[1],
            "32FC1" if metres else "16UC1",
            0,
            pixels.shape[1] * pixels.dtype.itemsize,
            np.ascontiguousarray(pixels).reshape(-1).view(np.uint8),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraInfos:
    """One calibration, said again with every image."""

    topic: str
    model: CameraModel
    stamps_ns: NDArray[np.int64]
    msgtype: ClassVar[str] = "sensor_msgs/msg/CameraInfo"

    def message(self, index: int) -> Any:
        """Return the CameraInfo of one image."""
        return _encoded(replace(self.model, stamp_ns=int(self.stamps_ns[index])))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Poses:
    """Ground truth."""

    topic: str
    frame_id: str
    stamps_ns: NDArray[np.int64]
    positions_m: NDArray[np.float64]
    """float64 (N, 3)."""
    quats_xyzw: NDArray[np.float64]
    """float64 (N, 4)."""
    msgtype: ClassVar[str] = "geometry_msgs/msg/PoseStamped"

    def message(self, index: int) -> Any:
        """Return one PoseStamped."""
        return _encoded(
            StampedPose(
                stamp_ns=int(self.stamps_ns[index]),
                frame_id=self.frame_id,
                position_m=self.positions_m[index],
                quat_xyzw=self.quats_xyzw[index],
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuRows:
    """Readings of an IMU."""

    topic: str
    frame_id: str
    stamps_ns: NDArray[np.int64]
    angular_rad_s: NDArray[np.float64]
    """float64 (N, 3)."""
    acceleration_m_s2: NDArray[np.float64]
    """float64 (N, 3)."""
    msgtype: ClassVar[str] = "sensor_msgs/msg/Imu"

    def message(self, index: int) -> Any:
        """Return one Imu."""
        return _encoded(
            ImuSample(
                stamp_ns=int(self.stamps_ns[index]),
                frame_id=self.frame_id,
                angular_rad_s=self.angular_rad_s[index],
                acceleration_m_s2=self.acceleration_m_s2[index],
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixedFrames:
    """Where the sensors sit: one message of all static transforms."""

    transforms: tuple[FrameTransform, ...]
    stamps_ns: NDArray[np.int64]
    """int64 (1,)."""
    topic: ClassVar[str] = "/tf_static"
    msgtype: ClassVar[str] = "tf2_msgs/msg/TFMessage"

    def message(self, index: int) -> Any:
        """Return the TFMessage."""
        stamp_ns = int(self.stamps_ns[index])
        return encode_transforms(
            [replace(transform, stamp_ns=stamp_ns) for transform in self.transforms], message_factory("cdr")
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuNoiseText:
    """Noise of an IMU, for which ROS has no message: said once, in the words of Kalibr's file of an IMU."""

    topic: str
    text: str
    stamps_ns: NDArray[np.int64]
    """int64 (1,)."""
    msgtype: ClassVar[str] = "std_msgs/msg/String"

    @classmethod
    def of(cls, imu_topic: str, noise: ImuNoise, stamps_ns: NDArray[np.int64]) -> Self:
        """Return the noise of the IMU of a topic."""
        return cls(topic=imu_topic + NOISE_SUFFIX, text=noise_text(noise), stamps_ns=stamps_ns)

    def message(self, index: int) -> Any:  # noqa: ARG002 (there is one)
        """Return the String."""
        return message_factory("cdr").make(self.msgtype, self.text)


def read_image_file(path: Path) -> bytes:
    """Return the bytes of an image file.

    Raises
    ------
    RecordingError
        If it cannot be read, is empty, damaged, or ends before its image does.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not data:
        raise RecordingError(f"{path}: the file is empty")
    damage = damage_of(data)
    if damage:
        raise RecordingError(f"{path}: {damage}")
    return data


def _encoded(measurement: Any) -> Any:
    return encoder_for(measurement).encode(measurement, message_factory("cdr"))
