# SPDX-License-Identifier: MIT
"""Which way is up in a map that began with whatever the first camera looked at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.grids.floor import find_floor

_DOWN = np.array([0.0, 1.0, 0.0])
"""Of the image, in the optical frame."""


class Upright(NamedTuple):
    """A map frame with z up."""

    T_map_start: NDArray[np.float64]
    """float64 (4, 4), pose of the first camera."""
    floor_m: float | None
    """z of the floor; None where none was found."""
    source: str
    """What told it: atlas, base, gravity, floor or cameras."""


def upright(
    T_camera_start: NDArray[np.float64],
    points: NDArray[np.float64],
    *,
    T_base_camera: NDArray[np.float64] | None,
    gravity: NDArray[np.float64] | None,
    seed: int,
    known: NDArray[np.float64] | None = None,
) -> Upright:
    """Return a frame whose z is up and whose x is where the first camera looks, or the base frame at the start.

    Parameters
    ----------
    T_camera_start
        float64 (N, 4, 4), poses of cameras; held upright on the whole.
    points
        float64 (M, 3), metres, in the frame of the first camera; may be empty.
    T_base_camera
        Pose of the camera on a base that is known to be upright; None where it is not.
    gravity
        float64 (3,), where things fall, in the frame of the first camera, where an IMU told; else None.
    seed
        Of the search for the floor.
    known
        float64 (4, 4), pose of the map's frame where it is known from an earlier run, whose results it must fit.
    """
    if known is not None:
        return Upright(known, _height(points, known, seed), "atlas")
    if T_base_camera is not None:
        floor = _height(points, T_base_camera, seed)
        return Upright(T_base_camera, 0.0 if floor is None else floor, "base")
    if gravity is not None:
        T_map_start = _turned(-gravity)
        return Upright(T_map_start, _height(points, T_map_start, seed), "gravity")
    up = -np.mean(np.einsum("nji,j->ni", T_camera_start[:, :3, :3], _DOWN), axis=0)
    found = find_floor(points, up, seed=seed)
    if found is None:
        return Upright(_turned(up), None, "cameras")
    T_map_start = _turned(found.normal)
    return Upright(T_map_start, found.height_m, "floor")


def _height(points: NDArray[np.float64], T_map_start: NDArray[np.float64], seed: int) -> float | None:
    """Return z of a floor that lies level."""
    level = points @ T_map_start[:3, :3].T + T_map_start[:3, 3]
    found = find_floor(level, np.array([0.0, 0.0, 1.0]), tilt_rad=0.1, seed=seed)
    return None if found is None else found.height_m


def _turned(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pose of the first camera in a frame with z along `up` and x ahead of the camera, as far as it is level."""
    z = up / np.linalg.norm(up)
    ahead = np.array([0.0, 0.0, 1.0])
    if abs(ahead @ z) > 0.95:  # it looks up or down: the top of the image is ahead
        ahead = np.array([0.0, -1.0, 0.0])
    x = ahead - (ahead @ z) * z
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    return se3.from_rotation_translation(rotation, np.zeros(3))
