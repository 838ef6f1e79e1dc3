# SPDX-License-Identifier: MIT
"""What the known direction of gravity leaves open of a correction: the turn about it, and the position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.similarities import as_similarity, inverse, rigid_of

Floats = NDArray[np.float64]


def upright_correction(
    T_camera_map: Floats, S_camera_map: Floats, up_map: Floats, settings: PlaceSettings
) -> Floats | None:
    """Return where a camera should be (4, 4) if only its turn about the vertical and its position may change.

    None where the correction tilts the map by more than the bound, or turns it by more than its own: a bad loop (section VI-B).
    """
    correction = inverse(T_camera_map) @ rigid_of(S_camera_map)  # of the map about itself
    turn = correction[:3, :3]
    swing = turn @ up_map
    tilt = float(np.arccos(np.clip(swing @ up_map, -1.0, 1.0)))
    quat = quaternion.from_matrix(turn)
    yaw = 2.0 * float(np.arctan2(quat[:3] @ up_map, quat[3]))
    yaw = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    if tilt > np.sqrt(2.0) * settings.gravity_bound_rad or abs(yaw) > settings.yaw_bound_rad:
        return None
    about = np.concatenate([np.sin(0.5 * yaw) * up_map, [np.cos(0.5 * yaw)]])
    upright = quaternion.to_matrix(about)
    # the point of the map where the camera is believed to be goes to the same place as before
    centre = inverse(rigid_of(S_camera_map))[:3, 3]
    moved = turn @ centre + correction[:3, 3]
    return T_camera_map @ se3.from_rotation_translation(upright, moved - upright @ centre)


def upright_joint(
    S_first_second: Floats, up_first: Floats, up_second: Floats, settings: PlaceSettings
) -> Floats | None:
    """Return the similarity (4, 4) of two inertial maps that lays the vertical of one exactly on the other's.

    None where the verticals differ by more than the bound, or the scale is out of its range. The origin of the second map
    goes to the same place as before: begin with the origin where the maps meet.
    """
    similarity = as_similarity(S_first_second)
    low, high = settings.scale_range
    swing = similarity.rotation @ up_second
    tilt = float(np.arccos(np.clip(swing @ up_first, -1.0, 1.0)))
    if not low <= similarity.scale <= high or tilt > np.sqrt(2.0) * settings.gravity_bound_rad:
        return None
    axis = np.cross(swing, up_first)  # (swing x up, 1 + swing . up) is the quaternion of the least turn between them
    righted = quaternion.to_matrix(quaternion.normalise([*axis, 1.0 + swing @ up_first])) @ similarity.rotation
    return se3.from_rotation_translation(similarity.scale * righted, similarity.translation_m)
