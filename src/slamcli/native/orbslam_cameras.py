# SPDX-License-Identifier: MIT
"""The rig of cameras that ORB-SLAM's settings describe, of both schemas."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.geometry import se3
from slamcli.measurements import CameraModel, ImuNoise, RigCalibration

_MOST_PX = 100_000
_PINHOLE, _RECTIFIED, _FISHEYE = "PinHole", "Rectified", "KannalaBrandt8"
_TYPES = {name.lower(): name for name in (_PINHOLE, _RECTIFIED, _FISHEYE)} | {"kannalabrandt": _FISHEYE}
_NOISE = {
    "gyroscope": "IMU.NoiseGyro", "accelerometer": "IMU.NoiseAcc", "gyroscope_walk": "IMU.GyroWalk",
    "accelerometer_walk": "IMU.AccWalk", "frequency_hz": "IMU.Frequency",
}  # fmt: skip


def rig_calibration(values: Mapping[str, Any], source: str) -> RigCalibration:
    """Return the rig in settings by their names in schema 1.0 (see `slamcli.native.orbslam_names`).

    Parameters
    ----------
    values
        Numbers, and matrices as the text of their numbers; None or "" for what is not given.
    source
        The file, for messages.

    Raises
    ------
    CalibrationError
        If a camera is given in part, or a matrix is not what it should be.
    """
    given = {name: value for name, value in values.items() if value is not None and value != ""}
    reader = _Reader(given, source)
    main = reader.camera("Camera1") if "Camera1.fx" in given or "Camera1.fy" in given else None
    T_b_c1 = reader.pose("IMU.T_b_c1")
    noise = {field: reader.value(name) for field, name in _NOISE.items() if name in given}
    for field, value in noise.items():
        if not value > 0.0:
            raise CalibrationError(f"{source}: {_NOISE[field]} is {value:g}: must be more than 0")
    baseline_m = reader.baseline_m(main)
    bf = reader.value("Camera.bf") if baseline_m is None and "Camera.bf" in given else None
    rig: dict[str, Any] = {"main": main, "baseline_m": baseline_m, "bf": bf}
    if "LEFT.K" in given or "RIGHT.K" in given:
        rig |= {"main": reader.legacy("LEFT"), "right": reader.legacy("RIGHT")}
    elif "Camera2.fx" in given or "Stereo.T_c1_c2" in given:
        rig |= {"right": reader.camera("Camera2"), "T_main_right": reader.pose("Stereo.T_c1_c2", needed=True)}
    elif main is not None and baseline_m is not None:
        rig |= {"right": _beside(main, baseline_m)}
    return RigCalibration(
        source=source, imu_noise=ImuNoise(**noise) if noise else None,
        T_main_imu=None if T_b_c1 is None else se3.inverse(T_b_c1), **rig,
    )  # fmt: skip


def _beside(main: CameraModel, baseline_m: float) -> CameraModel:
    """Return the right camera of a pair that is rectified: as the left one, with the baseline in P."""
    P = main.projection.copy()
    P[0, 3] = -P[0, 0] * baseline_m
    return CameraModel(
        stamp_ns=0, frame_id="right", width=main.width, height=main.height, distortion_model=main.distortion_model,
        distortion=main.distortion, intrinsics=main.intrinsics, rectification=main.rectification, projection=P,
    )  # fmt: skip


class _Reader:
    """Reads cameras and matrices from settings that are given."""

    def __init__(self, given: Mapping[str, Any], source: str) -> None:
        self._given = given
        self._source = source

    def camera(self, group: str) -> CameraModel:
        """Return the camera of ``Camera1`` or ``Camera2``."""
        kind = str(self._given.get("Camera.type", _PINHOLE))
        if kind.lower() not in _TYPES:
            raise CalibrationError(f"{self._source}: Camera.type {kind!r}: PinHole, Rectified or KannalaBrandt8")
        kind = _TYPES[kind.lower()]
        fx, fy, cx, cy = (self._number(f"{group}.{name}", group) for name in ("fx", "fy", "cx", "cy"))
        if not (fx > 0.0 and fy > 0.0):
            raise CalibrationError(f"{self._source}: {group}.fx and fy are {fx:g} and {fy:g} px: must be more than 0")
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        if kind == _FISHEYE:
            model, distortion = "equidistant", [self._number(f"{group}.k{i}", group) for i in (1, 2, 3, 4)]
        else:
            names = ("k1", "k2", "p1", "p2", "k3")
            model, distortion = "plumb_bob", [self.value(f"{group}.{name}", 0.0) for name in names]
        if kind == _RECTIFIED:
            distortion = [0.0] * 5
        return CameraModel(
            stamp_ns=0, frame_id="left" if group == "Camera1" else "right", width=self._size("width"),
            height=self._size("height"), distortion_model=model, distortion=np.array(distortion), intrinsics=K,
            rectification=np.eye(3), projection=np.hstack([K, np.zeros((3, 1))]),
        )  # fmt: skip

    def legacy(self, side: str) -> CameraModel:
        """Return the camera of ``LEFT`` or ``RIGHT``: raw intrinsics and how it is rectified."""
        K, R, P = (
            self._matrix(f"{side}.{name}", shape) for name, shape in (("K", (3, 3)), ("R", (3, 3)), ("P", (3, 4)))
        )
        D = self._numbers(f"{side}.D") if f"{side}.D" in self._given else np.zeros(5)
        return CameraModel(
            stamp_ns=0, frame_id=side.lower(), width=self._size("width", side), height=self._size("height", side),
            distortion_model="rational_polynomial" if len(D) > 5 else "plumb_bob", distortion=D, intrinsics=K,
            rectification=R, projection=P,
        )  # fmt: skip

    def baseline_m(self, main: CameraModel | None) -> float | None:
        """Return ``Stereo.b``, or ``Camera.bf`` over the focal length, metres."""
        if "Stereo.b" in self._given:
            return self.value("Stereo.b")
        if "Camera.bf" in self._given and main is not None:
            return self.value("Camera.bf") / float(main.intrinsics[0, 0])
        return None

    def pose(self, name: str, *, needed: bool = False) -> NDArray[np.float64] | None:
        """Return a rigid transform (4, 4), of 12 or 16 numbers."""
        if name not in self._given:
            if needed:
                raise CalibrationError(f"{self._source}: {name} is missing: where does the second camera sit?")
            return None
        values = self._numbers(name)
        T = np.eye(4)
        if values.size not in (12, 16):
            raise CalibrationError(f"{self._source}: {name} holds {values.size} numbers, not 4 x 4")
        T[:3] = values[:12].reshape(3, 4)
        turn = T[:3, :3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-2 or np.linalg.det(turn) < 0.0:
            raise CalibrationError(f"{self._source}: {name} is no rigid transform: its rotation is not orthogonal")
        u, _, vt = np.linalg.svd(turn)  # printed with few digits
        T[:3, :3] = u @ vt
        return T

    def _number(self, name: str, group: str) -> float:
        if name not in self._given:
            raise CalibrationError(f"{self._source}: {name} is missing: {group} is calibrated in part")
        return self.value(name)

    def value(self, name: str, default: float = 0.0) -> float:
        """Return a finite number."""
        held = self._given.get(name, default)
        try:
            number = float(held)
        except (TypeError, ValueError, OverflowError):
            number = float("nan")
        if isinstance(held, bool) or not np.isfinite(number):
            raise CalibrationError(f"{self._source}: {name} is {held!r}, not a finite number")
        return number

    def _size(self, which: str, side: str | None = None) -> int:
        name = f"{side}.{which}" if f"{side}.{which}" in self._given else f"Camera.{which}"
        pixels = self.value(name)
        if not 0 <= pixels <= _MOST_PX:
            raise CalibrationError(f"{self._source}: {name} is {pixels:g}, not a number of pixels")
        return int(pixels)

    def _matrix(self, name: str, shape: tuple[int, int]) -> NDArray[np.float64]:
        if name not in self._given:
            raise CalibrationError(f"{self._source}: {name} is missing: LEFT and RIGHT each need K, R and P")
        values = self._numbers(name)
        if values.size != shape[0] * shape[1]:
            raise CalibrationError(f"{self._source}: {name} holds {values.size} numbers, not {shape[0]} x {shape[1]}")
        return values.reshape(shape)

    def _numbers(self, name: str) -> NDArray[np.float64]:
        try:
            values = np.array([float(word) for word in str(self._given[name]).replace(",", " ").split()])
        except ValueError as error:
            raise CalibrationError(f"{self._source}: {name} holds more than numbers") from error
        if not np.isfinite(values).all():
            raise CalibrationError(f"{self._source}: {name} holds numbers that are not finite")
        return values
