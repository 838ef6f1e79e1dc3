# SPDX-License-Identifier: MIT
"""Points of a node's images, in the base frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.signature import NodeImages
from slamcli.vision.stereo_depth import stereo_depth

_NEAREST_M = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSettings:
    """Which pixels become points."""

    decimation: int = 4
    """Every how manieth row and column."""
    roi_ratios: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Shares of the image that are left out: left, right, top, bottom."""


class SeenPoints(NamedTuple):
    """Points with their colours."""

    points: NDArray[np.float64]
    """float64 (N, 3), metres, base frame."""
    colours: NDArray[np.uint8]
    """uint8 (N, 3), red, green, blue."""


def depth_points(
    images: NodeImages, settings: DepthSettings, least_m: float = 0.0, most_m: float = 0.0
) -> SeenPoints | None:
    """Return the points of a depth image in the order of its rows; None where there is none.

    Parameters
    ----------
    least_m, most_m
        Least and greatest depth along the optical axis; 0: no limit.
    """
    depth = images.depth
    if depth is None:
        return None
    height, width = depth.shape
    left, right, top, bottom = settings.roi_ratios
    step = max(settings.decimation, 1)
    rows = slice(int(top * height), height - int(bottom * height), step)
    columns = slice(int(left * width), width - int(right * width), step)
    part = depth[rows, columns]
    with np.errstate(invalid="ignore"):
        i, j = np.nonzero((part > 0.0) & (part >= least_m) & (part <= (most_m or np.finfo(np.float32).max)))
    z = part[i, j].astype(np.float64)
    pixels = np.column_stack([columns.start + j * step, rows.start + i * step]).astype(np.float64)
    T = images.T_base_camera
    points = images.camera.back_project(pixels, z) @ T[:3, :3].T + T[:3, 3]
    colours = images.colour[rows, columns][i, j]
    return SeenPoints(points, np.repeat(colours[:, None], 3, axis=1) if colours.ndim == 1 else colours)


def within_range(
    points: NDArray[np.float64], view: NDArray[np.float64], least_m: float, most_m: float
) -> NDArray[np.float64]:
    """Return the finite points (N, 3) whose distance from `view` (3,) lies between two; 0: no limit."""
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(points - view, axis=1)
        kept = np.isfinite(distance) & (distance >= least_m)
        if most_m > 0.0:
            kept &= distance <= most_m
    found: NDArray[np.float64] = points[kept]
    return found


def with_depth(images: NodeImages | None, *, semi_global: bool = False) -> NodeImages | None:
    """Return images with the depth that a stereo pair tells, where they have none of their own; None where there is none at all."""
    if images is None or images.depth is not None:
        return images
    if images.right is None or not images.camera.baseline_m > 0.0:
        return None
    return replace(images, depth=stereo_depth(images.colour, images.right, images.camera, semi_global=semi_global))


def colours_at(points: NDArray[np.float64], images: NodeImages) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the colours (N, 3) of the pixels that points (N, 3), base frame, lie behind, and which points (N,) the image shows.

    What stands in between is not looked for: camera and scanner are taken to see the same.
    """
    T = se3.inverse(images.T_base_camera)
    in_camera = points @ T[:3, :3].T + T[:3, 3]
    seen = in_camera[:, 2] > _NEAREST_M
    height, width = images.colour.shape[:2]
    pixels = np.rint(images.camera.project(np.where(seen[:, None], in_camera, 1.0))).astype(np.int64)
    seen &= (pixels >= 0).all(axis=1) & (pixels < (width, height)).all(axis=1)
    colours = np.zeros((len(points), 3), dtype=np.uint8)
    found = images.colour[pixels[seen, 1], pixels[seen, 0]]
    colours[seen] = found[:, None] if found.ndim == 1 else found
    return colours, seen


def moved(points: NDArray[np.floating], T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 2) or (N, 3) of one frame in another, float64 of the same shape, by the pose T (4, 4)."""
    # By columns: matrix products of so few columns wait for threads longer than they work.
    size = points.shape[1]
    columns = [points[:, axis].astype(np.float64) for axis in range(size)]
    found = np.empty(points.shape)
    for row in range(size):
        found[:, row] = T[row, 3]
        for axis in range(size):
            found[:, row] += T[row, axis] * columns[axis]
    return found
