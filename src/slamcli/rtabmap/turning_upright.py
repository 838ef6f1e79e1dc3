# SPDX-License-Identifier: MIT
"""The map of cameras that nobody said how they were held, turned so that z points up."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.grids.floor import find_floor
from slamcli.grids.upright import Upright, upright
from slamcli.rtabmap.signature import NodeImages, NodeScan

Floats = NDArray[np.float64]
Sensors = Callable[[int], tuple[NodeImages | None, NodeScan | None]]

_MOST_NODES = 40
"""Whose depth images are looked at, spread over the map."""
_STEP = 8
"""One pixel in so many along both sides is looked at."""
_TILT_RAD = 0.1
"""How far a level floor may slope, and what told up may be wrong."""


def find_upright(
    ids: Sequence[int], T_map_base: Floats, T_base_camera: Floats,
    sensors: Sensors, seed: int,
) -> tuple[Floats, Upright]:  # fmt: skip
    """Return how a map is to be turned, T_up_map (4, 4), so that z is up and the first camera looks along x; what told it.

    Parameters
    ----------
    ids
        Of the nodes, N.
    T_map_base
        float64 (N, 4, 4).
    T_base_camera
        float64 (4, 4).
    sensors
        What a node saw, by its id.
    """
    T_map_camera = T_map_base @ T_base_camera
    T_first_map = se3.inverse(T_map_camera[0])
    points = _seen(ids, T_map_base, sensors) @ T_first_map[:3, :3].T + T_first_map[:3, 3]
    T_camera_first = se3.inverse(T_first_map @ T_map_camera)
    found = upright(T_camera_first, points, T_base_camera=None, gravity=None, seed=seed)
    return found.T_map_start @ T_first_map, found


def find_level_floor(ids: Sequence[int], T_map_base: Floats, sensors: Sensors, seed: int) -> float | None:
    """Return z of the floor of a map whose z is up; None where none is seen. Arguments as of `find_upright`."""
    found = find_floor(_seen(ids, T_map_base, sensors), np.array([0.0, 0.0, 1.0]), tilt_rad=_TILT_RAD, seed=seed)
    return None if found is None else found.height_m


def _seen(ids: Sequence[int], T_map_base: Floats, sensors: Sensors) -> Floats:
    """Return what the depth images of some nodes show, (M, 3), metres, map frame."""
    rows = np.unique(np.rint(np.linspace(0, len(ids) - 1, min(_MOST_NODES, len(ids)))).astype(np.int64))
    seen = [_points(sensors(ids[row])[0]) @ T_map_base[row][:3, :3].T + T_map_base[row][:3, 3] for row in rows.tolist()]
    return np.concatenate(seen)


def _points(images: NodeImages | None) -> Floats:
    """Return what a depth image shows, (M, 3), metres, base frame; nothing of stereo images."""
    if images is None or images.depth is None:
        return np.zeros((0, 3))
    depth = images.depth[::_STEP, ::_STEP].astype(np.float64)
    v, u = np.mgrid[0 : images.depth.shape[0] : _STEP, 0 : images.depth.shape[1] : _STEP]
    good = np.isfinite(depth) & (depth > 0.0)
    pixels = np.column_stack([u[good], v[good]]).astype(np.float64)
    T = images.T_base_camera
    return images.camera.back_project(pixels, depth[good]) @ T[:3, :3].T + T[:3, 3]
