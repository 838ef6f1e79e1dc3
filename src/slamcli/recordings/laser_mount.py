# SPDX-License-Identifier: MIT
"""Where a sensor sits on the robot: from a given pose, the recording's transforms, or a robot model."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.recordings.recording import Recording

_TILT_TOLERANCE_RAD = math.radians(5.0)
# A half turn about x: what turns an upside-down scanner's frame upright.
_HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserMount:
    """Mount of a planar scanner.

    `T_base_laser` is that of the upright scan frame: for an upside-down scanner its own frame turned by half a turn
    about x, in which a beam at angle a of the scanner points to -a (see `slamcli.recordings.scan_normalisation`).
    """

    T_base_laser: NDArray[np.float64]
    """float64 (4, 4)."""
    upside_down: bool
    source: str
    """``given``, ``tf`` or ``none`` (taken to be the base frame itself)."""


def find_laser_mount(recording: Recording, *, base_frame: str, laser_frame: str, planar: bool = True) -> LaserMount:
    """Return the mount: ``--laser-pose`` before the frame tree (tf, ``--static-tf``, ``--urdf``) before the base frame.

    The last one is said as a warning, and so is a scanner that is tilted out of the plane by more than 5 degrees where
    the map is `planar`.
    """
    given = recording.mends.laser_pose
    if given is not None:
        return LaserMount(T_base_laser=se3.from_se2(given), upside_down=False, source="given")
    tree = recording.frames()
    if laser_frame == base_frame:
        if not tree.frames:
            recording.log.warn(
                f"the recording holds no transforms: poses are those of the scanner itself ({laser_frame}); "
                "give its place on the robot with --laser-pose x,y,yaw, --static-tf or --urdf"
            )
        return LaserMount(T_base_laser=np.eye(4), upside_down=False, source="tf")
    if not tree.connected(base_frame, laser_frame):
        recording.log.warn(
            f"no transform {base_frame} -> {laser_frame}: the scanner is taken to sit at {base_frame}; "
            "give its place with --laser-pose x,y,yaw, --static-tf or --urdf"
        )
        return LaserMount(T_base_laser=np.eye(4), upside_down=False, source="none")
    T = tree.lookup(base_frame, laser_frame)
    if not tree.is_static(base_frame, laser_frame):
        recording.log.warn(
            f"{base_frame} -> {laser_frame} moves during the recording: its last pose is used throughout"
        )
    up = float(T[2, 2])
    tilt = math.acos(min(1.0, abs(up)))
    if tilt > _TILT_TOLERANCE_RAD and planar:
        recording.log.warn(
            f"{laser_frame} is tilted by {math.degrees(tilt):.0f}° against {base_frame}: scans are not planar"
        )
    if up < 0:
        recording.log.note(f"{laser_frame} is mounted upside down: scans are turned")
        T = T @ _HALF_TURN
    return LaserMount(T_base_laser=T, upside_down=up < 0, source="tf")


def find_cloud_mount(recording: Recording, *, base_frame: str, cloud_frame: str) -> LaserMount:
    """Return the mount of a sensor whose points are in its own frame: found as that of a scanner, never turned."""
    mount = find_laser_mount(recording, base_frame=base_frame, laser_frame=cloud_frame, planar=False)
    if not mount.upside_down:
        return mount
    return LaserMount(T_base_laser=mount.T_base_laser @ _HALF_TURN, upside_down=False, source=mount.source)


def find_sensor_mount(recording: Recording, *, base_frame: str, sensor_frame: str, what: str) -> NDArray[np.float64]:
    """Return the mount of a sensor other than a scanner, float64 (4, 4), by the frame tree.

    Where the tree does not tell it the sensor is taken to sit in the base frame, turned as it is, with a warning that
    names `what` it is. A mount that moves is read at the end of the recording.
    """
    tree = recording.frames()
    if sensor_frame == base_frame:
        return np.eye(4)
    if not sensor_frame or not tree.connected(base_frame, sensor_frame):
        recording.log.warn(
            f"no transform {base_frame} -> {sensor_frame or '(no frame)'}: the {what} is taken to sit at {base_frame}, "
            "with the same axes; give its place with --static-tf or --urdf"
        )
        return np.eye(4)
    if not tree.is_static(base_frame, sensor_frame):
        recording.log.warn(
            f"{base_frame} -> {sensor_frame} moves during the recording: its last pose is used throughout"
        )
    return tree.lookup(base_frame, sensor_frame)
