# SPDX-License-Identifier: MIT
"""Camera calibration files as ROS's camera_calibration writes them (YAML)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.measurements import CameraModel

_MAX_BYTES = 1_000_000


def read_camera_info(path: str | os.PathLike[str]) -> CameraModel:
    """Return the camera model in a calibration file (image_width, camera_matrix, distortion_coefficients, …).

    rectification_matrix and projection_matrix may be left out: then the image is taken as not rectified (identity, and
    K with no baseline).

    Raises
    ------
    CalibrationError
        If the file is missing, no such file, or a matrix has the wrong size.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise CalibrationError(f"{path}: larger than any camera calibration (1 MB)")
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror})") from error
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        first = str(error).splitlines()[0]
        raise CalibrationError(f"{path}: no camera calibration file ({first})") from error
    if not isinstance(document, Mapping) or "camera_matrix" not in document:
        raise CalibrationError(
            f"{path}: no camera calibration file: expected image_width, image_height, camera_matrix and "
            "distortion_coefficients, as ROS's camera_calibration writes them"
        )
    intrinsics = _matrix(document, "camera_matrix", (3, 3), path)
    projection = np.hstack([intrinsics, np.zeros((3, 1))])
    return CameraModel(
        stamp_ns=0,
        frame_id=str(document.get("camera_name", "")),
        width=_size(document, "image_width", path),
        height=_size(document, "image_height", path),
        distortion_model=str(document.get("distortion_model", document.get("camera_model", "plumb_bob"))),
        distortion=_matrix(document, "distortion_coefficients", None, path, np.zeros(0)).reshape(-1),
        intrinsics=intrinsics,
        rectification=_matrix(document, "rectification_matrix", (3, 3), path, np.eye(3)),
        projection=_matrix(document, "projection_matrix", (3, 4), path, projection),
    )


def _size(document: Mapping[str, Any], key: str, path: Path) -> int:
    value = document.get(key)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 < value <= 100_000:
        raise CalibrationError(f"{path}: {key} is {value!r}, not a number of pixels")
    return value


def _matrix(
    document: Mapping[str, Any],
    key: str,
    shape: tuple[int, int] | None,
    path: Path,
    default: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    if key not in document and default is not None:
        return default
    held = document.get(key)
    data = held.get("data") if isinstance(held, Mapping) else held
    try:
        values = np.array(data, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: {key} holds no list of numbers") from error
    if not np.isfinite(values).all() or (shape is not None and values.size != shape[0] * shape[1]):
        wanted = f"{shape[0]} x {shape[1]} " if shape else ""
        raise CalibrationError(f"{path}: {key} holds {values.size} values, not {wanted}finite numbers")
    return values.reshape(shape) if shape is not None else values
