# SPDX-License-Identifier: MIT
"""Cameras and IMU: ``Camera``, ``Camera1``, ``Camera2``, ``Stereo``, ``RGBD``, ``LEFT``, ``RIGHT``, ``IMU``.

What is not given here comes from the recording (CameraInfo, transforms, calibration files of a data set) or from
``--camera``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.parameters import group, parameter

_MOST_PX = 100_000
_MATRIX = "numbers row by row"


def _focal(axis: str) -> Any:
    return parameter(
        None,
        f"focal length along {axis}; default: from the recording",
        kind=float,
        unit="px",
        minimum=1e-3,
        maximum=1e6,
    )


def _centre(axis: str) -> Any:
    return parameter(
        None,
        f"principal point along {axis}; default: from the recording",
        kind=float,
        unit="px",
        minimum=-1e6,
        maximum=1e6,
    )


def _coefficient(what: str) -> Any:
    return parameter(None, what, kind=float, minimum=-1e6, maximum=1e6)


def _pixels(what: str) -> Any:
    return parameter(None, what, kind=int, unit="px", minimum=1, maximum=_MOST_PX)


def _column(what: str) -> Any:
    return parameter(
        None, f"{what} column that both fisheye cameras see: such pairs are rectified here, and matched in all columns",
        kind=int, unit="px", minimum=0, maximum=_MOST_PX, effective=False,
    )  # fmt: skip


def _matrix(what: str, unit: str = "") -> Any:
    return parameter("", f"{what}, {_MATRIX}; default: none", unit=unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class LensParameters:
    """``Camera1`` (legacy: ``Camera``) and ``Camera2``: intrinsics and distortion of the raw image."""

    fx: float | None = _focal("x")
    fy: float | None = _focal("y")
    cx: float | None = _centre("x")
    cy: float | None = _centre("y")
    k1: float | None = _coefficient("first radial coefficient, or first of the fisheye; default: none")
    k2: float | None = _coefficient("second radial coefficient, or second of the fisheye")
    p1: float | None = _coefficient("first tangential coefficient (PinHole)")
    p2: float | None = _coefficient("second tangential coefficient (PinHole)")
    k3: float | None = _coefficient("third radial coefficient, or third of the fisheye")
    k4: float | None = _coefficient("fourth coefficient of the fisheye")
    overlappingBegin: int | None = _column("first")  # noqa: N815 - as the system spells it
    overlappingEnd: int | None = _column("last")  # noqa: N815


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraParameters:
    """``Camera``: what both cameras have in common."""

    type: str | None = parameter(
        None, "camera model: PinHole (radial-tangential), Rectified, or KannalaBrandt8 (fisheye); default: from the recording",
        kind=str, choices=("PinHole", "Rectified", "KannalaBrandt8"),
    )  # fmt: skip
    width: int | None = _pixels("columns of the image that the calibration is for")
    height: int | None = _pixels("rows of the image that the calibration is for")
    new_width: int | None = parameter(
        None, "resize images to this many columns, the calibration along with them; default: as they are",
        name="newWidth", kind=int, unit="px", minimum=16, maximum=_MOST_PX,
    )  # fmt: skip
    new_height: int | None = parameter(
        None, "resize images to this many rows; default: as they are", name="newHeight", kind=int, unit="px", minimum=16,
        maximum=_MOST_PX,
    )  # fmt: skip
    image_scale: float = parameter(
        1.0, "resize images by this factor (legacy files); newWidth and newHeight go before it", name="imageScale",
        minimum=0.05, maximum=8.0,
    )  # fmt: skip
    fps: float | None = parameter(
        None, "frames per second: a keyframe is due after so many frames; default: as recorded", kind=float, unit="Hz",
        minimum=0.01, maximum=1e4,
    )  # fmt: skip
    bf: float | None = parameter(
        None, "baseline times fx (legacy; of RGB-D a virtual baseline); default: from the recording, or slamcli.virtual_baseline",
        kind=float, unit="px m", minimum=1e-6, maximum=1e6,
    )  # fmt: skip
    fisheye: int | None = parameter(
        None, "1: fisheye, in files of ORB-SLAM3's first version: type says it", name="bFishEye", kind=int, minimum=0,
        maximum=1, effective=False,
    )  # fmt: skip
    rgb: int | None = parameter(
        None, "1: colours come red first: a recording says itself how its colours come", name="RGB", kind=int, minimum=0,
        maximum=1, effective=False,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoParameters:
    """``Stereo``."""

    b: float | None = parameter(
        None, "baseline of rectified stereo, or virtual one of RGB-D; default: from the recording", kind=float, unit="m",
        minimum=1e-6, maximum=1e4,
    )  # fmt: skip
    T_c1_c2: str = _matrix("pose of the right camera in the left camera's frame, 4 x 4 (legacy: Tlr, 3 x 4)", "m")
    th_depth: float = parameter(
        40.0, "points nearer than this many baselines are close: they are made of one frame and hold the position",
        name="ThDepth", unit="baselines", minimum=1e-3, maximum=1e6,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class RgbdParameters:
    """``RGBD``."""

    depth_map_factor: float | None = parameter(
        None, "raw units per metre of depth in whole numbers: 1000 for millimetres, 5000 for TUM RGB-D; 32FC1 stays in metres",
        name="DepthMapFactor", kind=float, unit="1/m", minimum=1e-6, maximum=1e9,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class RectificationParameters:
    """``LEFT`` and ``RIGHT``: calibration of a stereo camera that is to be rectified (legacy files)."""

    width: int | None = _pixels("columns of the raw image")
    height: int | None = _pixels("rows of the raw image")
    D: str = _matrix("distortion k1 k2 p1 p2 k3")
    K: str = _matrix("intrinsics of the raw image, 3 x 3", "px")
    R: str = _matrix("rectifying rotation, 3 x 3")
    P: str = _matrix("projection of the rectified image, 3 x 4", "px")


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuParameters:
    """``IMU``."""

    noise_gyro: float = parameter(
        1.7e-4, "noise density of the gyroscope", name="NoiseGyro", unit="rad/s/sqrt(Hz)", minimum=1e-9, maximum=10.0
    )
    noise_acc: float = parameter(
        2.0e-3,
        "noise density of the accelerometer",
        name="NoiseAcc",
        unit="m/s^2/sqrt(Hz)",
        minimum=1e-9,
        maximum=100.0,
    )
    gyro_walk: float = parameter(
        1.9393e-5, "random walk of the gyroscope's bias", name="GyroWalk", unit="rad/s^2/sqrt(Hz)", minimum=1e-12,
        maximum=10.0,
    )  # fmt: skip
    acc_walk: float = parameter(
        3.0e-3, "random walk of the accelerometer's bias", name="AccWalk", unit="m/s^3/sqrt(Hz)", minimum=1e-12,
        maximum=100.0,
    )  # fmt: skip
    frequency: float = parameter(
        200.0, "samples per second: the recording's own stamps say it", name="Frequency", unit="Hz", minimum=1.0,
        maximum=1e5, effective=False,
    )  # fmt: skip
    T_b_c1: str = _matrix("pose of the left or only camera in the IMU's frame, 4 x 4 (legacy: Tbc)", "m")
    insert_keyframes_when_lost: bool = parameter(
        True, "whether keyframes are made while only the IMU tells the motion", name="InsertKFsWhenLost"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceParameters:
    """All groups of this file; it is the part that a calibration is made of."""

    camera: CameraParameters = group(CameraParameters(), name="Camera")
    camera1: LensParameters = group(LensParameters(), name="Camera1")
    camera2: LensParameters = group(LensParameters(), name="Camera2")
    stereo: StereoParameters = group(StereoParameters(), name="Stereo")
    rgbd: RgbdParameters = group(RgbdParameters(), name="RGBD")
    left: RectificationParameters = group(RectificationParameters(), name="LEFT")
    right: RectificationParameters = group(RectificationParameters(), name="RIGHT")
    imu: ImuParameters = group(ImuParameters(), name="IMU")
