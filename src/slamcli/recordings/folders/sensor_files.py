# SPDX-License-Identifier: MIT
"""Calibration of cameras and IMUs as EuRoC's ``sensor.yaml`` and Kalibr's camchain and IMU files hold it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.geometry import se3
from slamcli.measurements import CameraModel, ImuNoise
from slamcli.recordings.containers.damage import Damage
from slamcli.recordings.folders.camera_models import pinhole

_MAX_BYTES = 1_000_000
_ORTHOGONAL = 1e-3
_DISTORTIONS = {
    "radial-tangential": "plumb_bob", "radtan": "plumb_bob", "plumb_bob": "plumb_bob", "none": "plumb_bob",
    "equidistant": "equidistant", "kannala-brandt": "equidistant", "kb4": "equidistant",
}  # fmt: skip
_NUM_COEFFICIENTS = {"plumb_bob": (0, 4, 5), "equidistant": (4,)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorModel:
    """What a data set says of one sensor."""

    T_body_sensor: NDArray[np.float64] | None = None
    """float64 (4, 4)."""
    camera: CameraModel | None = None
    noise: ImuNoise | None = None


def read_sensor_yaml(path: Path, damage: Damage) -> SensorModel | None:
    """Return what a ``sensor.yaml`` says; None where it is missing or broken, which is told."""
    if not path.is_file():
        return None
    try:
        document = read_yaml(path)
        is_camera = str(document.get("sensor_type")) == "camera" or "camera_model" in document
        return SensorModel(
            T_body_sensor=transform(document["T_BS"], path) if "T_BS" in document else None,
            camera=camera_model(document, path, path.parent.name) if is_camera else None,
            noise=imu_noise(document, path),
        )
    except CalibrationError as error:
        damage.add(str(error))
        return None


def read_camchain(path: Path, reading_noise_from: Path | None, damage: Damage) -> dict[str, SensorModel]:
    """Return the cameras (``cam0``, …) of a Kalibr camchain, and ``imu0``, whose frame is the body's.

    ``T_cam_imu`` places a camera; where a camera has ``T_cn_cnm1`` alone, it hangs on the one before it.
    """
    found: dict[str, SensorModel] = {}
    try:
        document = read_yaml(path)
        T_body_before: NDArray[np.float64] | None = None
        for name in sorted(key for key in document if re.fullmatch(r"cam\d+", str(key))):
            entry = document[name]
            if not isinstance(entry, Mapping):
                raise CalibrationError(f"{path}: {name} holds no camera")  # noqa: TRY301
            T_body_camera: NDArray[np.float64] | None = None
            if "T_cam_imu" in entry:
                T_body_camera = se3.inverse(transform(entry["T_cam_imu"], path))
            elif "T_cn_cnm1" in entry and T_body_before is not None:
                T_body_camera = T_body_before @ se3.inverse(transform(entry["T_cn_cnm1"], path))
            found[name] = SensorModel(T_body_sensor=T_body_camera, camera=camera_model(entry, path, name))
            T_body_before = T_body_camera
        if reading_noise_from is not None and reading_noise_from.is_file():
            noise_file = read_yaml(reading_noise_from)
            noise_file = noise_file.get("imu0", noise_file)
            found["imu0"] = SensorModel(T_body_sensor=np.eye(4), noise=imu_noise(noise_file, reading_noise_from))
    except CalibrationError as error:
        damage.add(str(error))
    if found:
        found.setdefault("imu0", SensorModel(T_body_sensor=np.eye(4)))
    return found


def read_yaml(path: Path) -> Mapping[str, Any]:
    """Return a YAML document, also as OpenCV writes it (``%YAML:1.0``).

    Raises
    ------
    CalibrationError
        If the file cannot be read or is no mapping.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise CalibrationError(f"{path}: larger than any calibration (1 MB)")
        text = path.read_text(encoding="utf-8")
        document = yaml.safe_load("\n".join(line for line in text.splitlines() if not line.startswith("%")))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror})") from error
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise CalibrationError(f"{path}: no calibration ({str(error).splitlines()[0]})") from error
    if not isinstance(document, Mapping):
        raise CalibrationError(f"{path}: no calibration: it holds no names and values")
    return document


def camera_model(document: Mapping[str, Any], path: Path, frame_id: str) -> CameraModel:
    """Return a camera from the keys that EuRoC and Kalibr share.

    Raises
    ------
    CalibrationError
        If a value is missing, no number, or a model is unknown.
    """
    model = str(document.get("camera_model", "pinhole"))
    if model != "pinhole":
        raise CalibrationError(f"{path}: camera_model {model!r} is not read: pinhole is")
    name = str(document.get("distortion_model", "none")).lower()
    if name not in _DISTORTIONS:
        raise CalibrationError(f"{path}: distortion_model {name!r} is not read: {', '.join(_DISTORTIONS)} are")
    kind = _DISTORTIONS[name]
    coefficients = _numbers(
        document.get("distortion_coefficients", document.get("distortion_coeffs", [])), path, "distortion coefficients"
    )
    focal_and_centre = _numbers(document.get("intrinsics"), path, "intrinsics")
    size = _numbers(document.get("resolution"), path, "resolution")
    if len(coefficients) not in _NUM_COEFFICIENTS[kind]:
        raise CalibrationError(f"{path}: {len(coefficients)} distortion coefficients do not fit {name}")
    if len(focal_and_centre) != 4 or not (focal_and_centre[:2] > 0).all():
        raise CalibrationError(f"{path}: intrinsics are not fu, fv, cu, cv")
    if len(size) != 2 or not ((size >= 1) & (size <= 100_000)).all():
        raise CalibrationError(f"{path}: resolution is not width and height")
    if kind == "plumb_bob" and len(coefficients) == 4:
        coefficients = np.append(coefficients, 0.0)  # ROS's plumb_bob has k3
    return pinhole(frame_id, (int(size[0]), int(size[1])), focal_and_centre.tolist(), coefficients.tolist(), kind)


def imu_noise(document: Mapping[str, Any], path: Path) -> ImuNoise | None:
    """Return the noise of an IMU by the names that EuRoC and Kalibr share, None where there is none.

    Raises
    ------
    CalibrationError
        If a value is no number over 0.
    """
    names = {
        "gyroscope": "gyroscope_noise_density", "accelerometer": "accelerometer_noise_density",
        "gyroscope_walk": "gyroscope_random_walk", "accelerometer_walk": "accelerometer_random_walk",
    }  # fmt: skip
    if not any(name in document for name in names.values()):
        return None
    found = {field: _numbers([document[name]], path, name) for field, name in names.items() if name in document}
    for rate in ("rate_hz", "update_rate"):
        if rate in document:
            found["frequency_hz"] = _numbers([document[rate]], path, rate)
    if any(value.size != 1 or not value[0] > 0 for value in found.values()):
        raise CalibrationError(f"{path}: noise and rate of an IMU must be numbers over 0")
    return ImuNoise(**{field: float(value[0]) for field, value in found.items()})


def transform(value: Any, path: Path) -> NDArray[np.float64]:
    """Return a rigid transform, float64 (4, 4), from a list of rows or from OpenCV's ``data``.

    Raises
    ------
    CalibrationError
        If it is none.
    """
    numbers = _numbers(value.get("data") if isinstance(value, Mapping) else value, path, "transform")
    matrix = numbers.reshape(4, 4) if numbers.size == 16 else np.zeros((4, 4))
    rotation = np.clip(matrix[:3, :3], -10.0, 10.0)  # whose squares do not overflow
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ORTHOGONAL or np.linalg.det(rotation) < 0:
        raise CalibrationError(f"{path}: a transform is no 4 x 4 matrix of rotation and translation")
    return matrix


def _numbers(value: Any, path: Path, what: str) -> NDArray[np.float64]:
    try:
        numbers = np.array(value, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: {what}: {str(value)[:60]!r} are no numbers") from error
    if not np.isfinite(numbers).all():
        raise CalibrationError(
            f"{path}: {what} {'is missing' if value is None else 'holds numbers that are not finite'}"
        )
    return numbers
