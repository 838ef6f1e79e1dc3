# SPDX-License-Identifier: MIT
"""Kalibr's results: ``camchain.yaml`` (cameras, and the IMU's place) and ``imu.yaml`` (noise)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from slamcli.errors import CalibrationError, ConfigError
from slamcli.geometry import se3
from slamcli.measurements import CameraModel, ImuNoise, RigCalibration
from slamcli.native.settings import read_text

_MODELS = {"radtan": ("plumb_bob", 4), "equidistant": ("equidistant", 4), "none": ("plumb_bob", 0)}
_NOISE = {
    "gyroscope": "gyroscope_noise_density", "accelerometer": "accelerometer_noise_density",
    "gyroscope_walk": "gyroscope_random_walk", "accelerometer_walk": "accelerometer_random_walk",
    "frequency_hz": "update_rate",
}  # fmt: skip


def is_kalibr(document: Any) -> bool:
    """Return whether a YAML document is a camera chain or an IMU of Kalibr."""
    return isinstance(document, Mapping) and ("cam0" in document or _imu_of(document) is not None)


def read_kalibr_yaml(path: Path) -> RigCalibration:
    """Return the rig in a camera chain (its first camera is the left or only one), or the noise in an IMU file.

    Raises
    ------
    CalibrationError
        If it is neither, or something in it is missing or of the wrong size.
    """
    path = Path(path)
    try:
        document = yaml.safe_load(read_text(path))
    except (ConfigError, yaml.YAMLError, ValueError, RecursionError) as error:
        raise CalibrationError(f"{path}: no Kalibr file ({str(error).splitlines()[0]})") from error
    if not is_kalibr(document):
        raise CalibrationError(f"{path}: no Kalibr file: expected cam0 (camchain) or gyroscope_noise_density (imu)")
    imu = _imu_of(document)
    if "cam0" not in document:
        return RigCalibration(source=str(path), imu_noise=_noise(imu or {}, path))
    main = document["cam0"]
    right = document.get("cam1")
    shift = main.get("timeshift_cam_imu") if isinstance(main, Mapping) else None
    notes: tuple[str, ...] = ()
    if isinstance(shift, (int, float)) and abs(shift) > 1e-4:
        notes = (
            f"{path}: timeshift_cam_imu {shift:g} s is not followed: give it by --time-offset IMU_TOPIC={-shift:g}",
        )
    return RigCalibration(
        source=str(path), main=_camera(main, "cam0", path), right=None if right is None else _camera(right, "cam1", path),
        T_main_right=None if right is None else se3.inverse(_pose(right, "T_cn_cnm1", "cam1", path)),
        T_main_imu=_pose(main, "T_cam_imu", "cam0", path) if "T_cam_imu" in main else None,
        imu_noise=None if imu is None else _noise(imu, path), notes=notes,
    )  # fmt: skip


def _imu_of(document: Mapping[str, Any]) -> Mapping[str, Any] | None:
    inside = document.get("imu0", document)
    return inside if isinstance(inside, Mapping) and "gyroscope_noise_density" in inside else None


def _noise(imu: Mapping[str, Any], path: Path) -> ImuNoise:
    values = {}
    for field, key in _NOISE.items():
        if key not in imu:
            continue
        value = imu[key]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
            raise CalibrationError(f"{path}: {key} is {value!r}, not a number above 0")
        values[field] = float(value)
    return ImuNoise(**values)


def _camera(held: Any, name: str, path: Path) -> CameraModel:
    if not isinstance(held, Mapping):
        raise CalibrationError(f"{path}: {name} is no table")
    if held.get("camera_model", "pinhole") != "pinhole":
        raise CalibrationError(f"{path}: {name}: camera_model {held['camera_model']!r} is not read, pinhole is")
    fx, fy, cx, cy = _numbers(held, "intrinsics", 4, name, path)
    width, height = _numbers(held, "resolution", 2, name, path)
    kind = str(held.get("distortion_model", "none"))
    if kind not in _MODELS:
        raise CalibrationError(f"{path}: {name}: distortion_model {kind!r} is not read; radtan and equidistant are")
    model, count = _MODELS[kind]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return CameraModel(
        stamp_ns=0, frame_id=name, width=int(width), height=int(height), distortion_model=model,
        distortion=_numbers(held, "distortion_coeffs", count, name, path) if count else np.zeros(4), intrinsics=K,
        rectification=np.eye(3), projection=np.hstack([K, np.zeros((3, 1))]), topic=str(held.get("rostopic", "")),
    )  # fmt: skip


def _pose(held: Mapping[str, Any], key: str, name: str, path: Path) -> NDArray[np.float64]:
    T = _numbers(held, key, 16, name, path).reshape(4, 4)
    if np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-3:
        raise CalibrationError(f"{path}: {name}: {key} is no rigid transform")
    return T


def _numbers(held: Mapping[str, Any], key: str, count: int, name: str, path: Path) -> NDArray[np.float64]:
    try:
        values = np.array(held[key], dtype=np.float64).reshape(-1)
    except KeyError as error:
        raise CalibrationError(f"{path}: {name} has no {key}") from error
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: {name}: {key} holds no list of numbers") from error
    if values.size != count or not np.isfinite(values).all():
        raise CalibrationError(f"{path}: {name}: {key} holds {values.size} values, not {count} finite numbers")
    return values
