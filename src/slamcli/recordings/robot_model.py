# SPDX-License-Identifier: MIT
"""Fixed joints of a robot model (URDF)."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.geometry import quaternion
from slamcli.measurements import FrameTransform

_MAX_BYTES = 50_000_000


def read_robot_model(path: str | os.PathLike[str]) -> tuple[FrameTransform, ...]:
    """Return the transforms ``T_parent_child`` of a URDF file's fixed joints.

    Movable joints are left out: the recording's /tf knows where they stood.

    Raises
    ------
    CalibrationError
        If the file is missing, no URDF, or an unexpanded xacro file.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise CalibrationError(f"{path}: larger than any robot model (50 MB)")
        root = ET.fromstring(path.read_bytes())  # noqa: S314 - expat (2.4.1 and later) limits what entities expand to
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror})") from error
    except (ET.ParseError, ValueError, LookupError) as error:
        raise CalibrationError(f"{path}: no URDF file ({error})") from error
    if root.tag != "robot":
        raise CalibrationError(f"{path}: no URDF file: it begins with <{root.tag}>, not <robot>")
    if any("www.ros.org/wiki/xacro" in element.tag or "ros.org/xacro" in element.tag for element in root.iter()):
        raise CalibrationError(f"{path}: a xacro file: expand it first (`xacro {path.name} > robot.urdf`)")
    joints = [joint for joint in root.iter("joint") if joint.get("type") == "fixed"]
    if not joints:
        raise CalibrationError(f"{path}: holds no fixed joint")
    return tuple(_transform(joint, path) for joint in joints)


def _transform(joint: ET.Element, path: Path) -> FrameTransform:
    name = joint.get("name", "?")
    parent, child = (_link(joint, tag) for tag in ("parent", "child"))
    if not parent or not child:
        raise CalibrationError(f"{path}: joint {name!r} names no parent or no child link")
    origin = joint.find("origin")
    position = _triple(origin, "xyz", name, path)
    roll, pitch, yaw = _triple(origin, "rpy", name, path)
    return FrameTransform(
        stamp_ns=0,
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=position,
        quat_xyzw=quaternion.from_roll_pitch_yaw(roll, pitch, yaw),
        static=True,
    )


def _link(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "").lstrip("/")


def _triple(origin: ET.Element | None, key: str, joint: str, path: Path) -> NDArray[np.float64]:
    text = "0 0 0" if origin is None else origin.get(key, "0 0 0")
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise CalibrationError(f'{path}: joint {joint!r}: origin {key}="{text}" is not three numbers')
    return values
