# SPDX-License-Identifier: MIT
"""Images that belong together, and how their cameras sit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements.camera import CameraModel
from slamcli.measurements.image import Image


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StereoPair:
    """Left and right image of one moment, as the cameras gave them (not rectified unless they come so)."""

    left: Image
    right: Image

    @property
    def stamp_ns(self) -> int:
        """Stamp of the left image."""
        return self.left.stamp_ns

    @property
    def topic(self) -> str:
        """Topic of the left image."""
        return self.left.topic


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RgbdFrame:
    """A colour (or grey) image and the depth seen from the same camera, pixel by pixel."""

    colour: Image
    depth: Image
    """Of the same size, encoding "depth"."""

    def __post_init__(self) -> None:
        if self.depth.encoding != "depth":
            raise DataError(
                f"RGB-D frame at {self.colour.stamp_ns} ns: {self.depth.topic} is {self.depth.encoding}, not depth"
            )

    @property
    def stamp_ns(self) -> int:
        """Stamp of the colour image."""
        return self.colour.stamp_ns

    @property
    def topic(self) -> str:
        """Topic of the colour image."""
        return self.colour.topic


def _identity() -> NDArray[np.float64]:
    return np.eye(4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuNoise:
    """Continuous-time noise of an IMU; the defaults are those of EuRoC's (ADIS16448)."""

    gyroscope: float = 1.7e-4
    """rad/s/sqrt(Hz)."""
    accelerometer: float = 2.0e-3
    """m/s^2/sqrt(Hz)."""
    gyroscope_walk: float = 1.9393e-5
    """rad/s^2/sqrt(Hz)."""
    accelerometer_walk: float = 3.0e-3
    """m/s^3/sqrt(Hz)."""
    frequency_hz: float = 200.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraRig:
    """The cameras (and IMU) of a robot: what `StereoPair`, `RgbdFrame`, `Image` and `ImuSample` are to be read with."""

    mode: Literal["mono", "stereo", "rgbd"]
    main: CameraModel
    """The left or only camera, or the colour camera of RGB-D."""
    right: CameraModel | None = None
    T_main_right: NDArray[np.float64] | None = None
    """float64 (4, 4), pose of the right camera in the main camera's optical frame; None: both models are rectified, and the
    baseline stands in ``right.projection[0, 3]``."""
    baseline_m: float | None = None
    """Given baseline (RGB-D: the virtual one); None: from `right`, or the tier's own virtual baseline."""
    T_base_main: NDArray[np.float64] = field(default_factory=_identity)
    """float64 (4, 4), pose of the main camera's optical frame in the base frame."""
    inertial: bool = False
    """Whether IMU samples come along."""
    T_main_imu: NDArray[np.float64] | None = None
    """float64 (4, 4), pose of the IMU in the main camera's optical frame."""
    imu_noise: ImuNoise = field(default_factory=ImuNoise)
    rate_hz: float = 30.0
    """Frames per second, as recorded."""
    base_is_upright: bool = False
    """Whether the base frame's z is known to point up (tf of a robot); if not, the base is the camera or IMU itself."""
