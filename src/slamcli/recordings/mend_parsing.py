# SPDX-License-Identifier: MIT
"""Mends as users write them."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from slamcli.errors import UsageError
from slamcli.geometry import quaternion
from slamcli.measurements import CameraModel, FrameTransform
from slamcli.recordings.calibration_file import read_camera_info
from slamcli.recordings.mends import NO_RETURN_POLICIES, Mends
from slamcli.recordings.robot_model import read_robot_model


def parse_mends(
    *,
    time_offsets: Iterable[str] = (),
    renamed_frames: Iterable[str] = (),
    static_transforms: Iterable[str] = (),
    robot_model: str | os.PathLike[str] | None = None,
    camera_infos: Iterable[str] = (),
    flip_scan: bool = False,
    depth_units_per_m: float | None = None,
    no_return: str = "ignore",
    laser_pose: str | None = None,
) -> Mends:
    """Return the mends that a user's words describe.

    Parameters
    ----------
    time_offsets
        ``TOPIC=SECONDS``.
    renamed_frames
        ``OLD=NEW``.
    static_transforms
        ``parent,child,x,y,z,yaw,pitch,roll`` in metres and radians, or ``parent,child,x,y,z,qx,qy,qz,qw``.
    robot_model
        A URDF file.
    camera_infos
        ``FILE`` or ``TOPIC=FILE``.
    laser_pose
        ``x,y,yaw`` in metres and radians.

    Raises
    ------
    UsageError
        If one of them cannot be understood; the message shows how it is written.
    CalibrationError
        If a file cannot be used.
    """
    if no_return not in NO_RETURN_POLICIES:
        raise UsageError(f"--no-return {no_return}: choose one of {', '.join(NO_RETURN_POLICIES)}")
    if depth_units_per_m is not None and not (math.isfinite(depth_units_per_m) and depth_units_per_m > 0):
        raise UsageError(f"--depth-scale {depth_units_per_m:g}: must be more than 0 raw units per metre")
    return Mends(
        time_offsets_ns=dict(_time_offset(text) for text in time_offsets),
        renamed_frames=dict(_renamed_frame(text) for text in renamed_frames),
        static_transforms=tuple(_static_transform(text) for text in static_transforms),
        model_transforms=read_robot_model(robot_model) if robot_model is not None else (),
        camera_models=dict(_camera_info(text) for text in camera_infos),
        flip_scan=flip_scan,
        depth_units_per_m=depth_units_per_m,
        no_return=no_return,
        laser_pose=None if laser_pose is None else np.array(_numbers("--laser-pose", laser_pose, "x,y,yaw", (3,))),
    )


def _time_offset(text: str) -> tuple[str, int]:
    topic, equals, seconds = text.rpartition("=")
    try:
        offset_s = float(seconds)
    except ValueError:
        offset_s = math.nan
    if not equals or not topic or not math.isfinite(offset_s) or abs(offset_s) > 1e10:
        raise UsageError(f"--time-offset {text}: write TOPIC=SECONDS, for example /scan=-0.05")
    return topic, round(offset_s * 1e9)


def _renamed_frame(text: str) -> tuple[str, str]:
    old, equals, new = text.partition("=")
    old, new = old.strip().lstrip("/"), new.strip().lstrip("/")
    if not equals or not old or not new:
        raise UsageError(f"--rename-frame {text}: write OLD=NEW, for example base_laser=laser")
    return old, new


def _static_transform(text: str) -> FrameTransform:
    how = "parent,child,x,y,z,yaw,pitch,roll"
    parent, _, rest = text.partition(",")
    child, _, rest = rest.partition(",")
    parent, child = parent.strip().lstrip("/"), child.strip().lstrip("/")
    if not parent or not child or parent == child:
        raise UsageError(
            f"--static-tf {text}: write {how} (metres, radians), for example base_link,laser,0.2,0,0.3,0,0,0"
        )
    numbers = _numbers("--static-tf", rest, how, (6, 7), whole=text)
    if len(numbers) == 6:
        yaw, pitch, roll = numbers[3:]
        quat = quaternion.from_roll_pitch_yaw(roll, pitch, yaw)
    else:
        quat = np.array(numbers[3:])
        if abs(float(np.linalg.norm(quat)) - 1.0) > 0.01:
            raise UsageError(f"--static-tf {text}: the quaternion qx,qy,qz,qw has not length 1")
        quat = quaternion.normalise(quat)
    return FrameTransform(
        stamp_ns=0,
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=np.array(numbers[:3]),
        quat_xyzw=quat,
        static=True,
    )


def _camera_info(text: str) -> tuple[str, CameraModel]:
    topic, _, file = text.rpartition("=")
    # A file name may hold an equals sign: it is one if there is such a file.
    if topic and Path(text).is_file():
        topic, file = "", text
    return topic, read_camera_info(file)


def _numbers(option: str, text: str, how: str, counts: tuple[int, ...], whole: str | None = None) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(math.isfinite(number) for number in numbers):
        raise UsageError(f"{option} {whole or text}: write {how} as numbers in metres and radians")
    return numbers
