# SPDX-License-Identifier: MIT
"""Calibration files of cameras, whatever wrote them: camera_calibration, ORB-SLAM or Kalibr."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from slamcli.errors import CalibrationError, ConfigError, UsageError
from slamcli.measurements import RigCalibration
from slamcli.native.kalibr_yaml import is_kalibr, read_kalibr_yaml
from slamcli.native.opencv_yaml import is_opencv_yaml, read_opencv_yaml
from slamcli.native.orbslam_cameras import rig_calibration
from slamcli.native.orbslam_names import canonical
from slamcli.native.settings import find_native, read_text
from slamcli.recordings.calibration_file import read_camera_info

_KINDS = (
    "a camera_calibration file (camera_matrix …), settings of ORB-SLAM (Camera.fx or Camera1.fx …) or Kalibr's (cam0 …)"
)


def read_calibration(path: Path) -> RigCalibration:
    """Return what a calibration file says, its kind told by its content.

    Raises
    ------
    CalibrationError
        If it cannot be read or is none of these kinds.
    """
    path = find_native(path)
    try:
        text = read_text(path)
    except ConfigError as error:
        raise CalibrationError(str(error)) from error
    if is_opencv_yaml(text):
        try:
            settings = {canonical(setting.name): setting.value for setting in read_opencv_yaml(path)}
        except ConfigError as error:
            raise CalibrationError(str(error)) from error
        found = rig_calibration(settings, str(path))
        if found.main is None:
            raise CalibrationError(f"{path}: settings without a camera: Camera.fx or Camera1.fx is missing")
        return found
    try:
        document = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise CalibrationError(
            f"{path}: no calibration file ({str(error).splitlines()[0]}); known are {_KINDS}"
        ) from error
    if is_kalibr(document):
        return read_kalibr_yaml(path)
    if isinstance(document, dict) and "camera_matrix" in document:
        model = read_camera_info(path)
        return RigCalibration(source=str(path), main=model)
    raise CalibrationError(f"{path}: no calibration file; known are {_KINDS}")


def load_calibration(files: Sequence[Path]) -> RigCalibration | None:
    """Return what ``--camera`` files say together; of two files with one camera each the second is the right one.

    Raises
    ------
    CalibrationError, UsageError
        If one cannot be read, or there are more cameras than two.
    """
    found = [read_calibration(Path(file)) for file in files]
    if not found:
        return None
    cameras = [rig for rig in found if rig.main is not None]
    facts: dict[str, Any] = {"source": ", ".join(rig.source for rig in found)}
    if len(cameras) > 2 or (len(cameras) == 2 and any(rig.T_main_right is not None for rig in cameras)):
        raise UsageError(
            f"--camera was given {len(cameras)} files with cameras: one for the rig, or one each for left and right"
        )
    for rig in found:
        for field in ("T_main_right", "T_main_imu", "imu_noise", "baseline_m", "bf"):
            if (value := getattr(rig, field)) is not None:
                facts[field] = value
    if cameras:
        facts |= {"main": cameras[0].main, "right": cameras[0].right}
    if len(cameras) == 2:
        facts["right"] = cameras[1].main
    return RigCalibration(**facts, notes=tuple(note for rig in found for note in rig.notes))


def overlaid(base: RigCalibration | None, over: RigCalibration | None) -> RigCalibration | None:
    """Return `base` with everything that `over` says."""
    if base is None or over is None:
        return over or base
    changes = {f.name: value for f in dataclasses.fields(over) if (value := getattr(over, f.name)) is not None}
    if over.main is not None:  # cameras come as one
        changes |= {
            "right": over.right,
            "T_main_right": over.T_main_right,
            "baseline_m": over.baseline_m,
            "bf": over.bf,
        }
    return dataclasses.replace(base, **{**changes, "notes": (*base.notes, *over.notes)})
