# SPDX-License-Identifier: MIT
"""The map of cameras that nobody said how they were held, turned so that z points up."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.grids.upright import Upright, upright
from slamcli.rtabmap.signature import NodeImages, NodeScan

Floats = NDArray[np.float64]

_MOST_NODES = 40
"""Whose depth images are looked at, spread over the map."""
_STEP = 8
"""One pixel in so many along both sides is looked at."""


def find_upright(
    ids: Sequence[int], T_map_base: Floats, T_base_camera: Floats,
    sensors: Callable[[int], tuple[NodeImages | None, NodeScan | None]], seed: int,
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
    rows = np.unique(np.rint(np.linspace(0, len(ids) - 1, min(_MOST_NODES, len(ids)))).astype(np.int64))
    seen = [_points(sensors(ids[row])[0]) @ T_map_base[row][:3, :3].T + T_map_base[row][:3, 3] for row in rows.tolist()]
    points = np.concatenate(seen) @ T_first_map[:3, :3].T + T_first_map[:3, 3]
    T_camera_first = se3.inverse(T_first_map @ T_map_camera)
    found = upright(T_camera_first, points, T_base_camera=None, gravity=None, seed=seed)
    return found.T_map_start @ T_first_map, found


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
