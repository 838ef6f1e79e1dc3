# SPDX-License-Identifier: MIT
"""Every pixel's depth behind the ideal camera: as points, or as an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements import RgbdFrame
from slamcli.vision.preparation import Preparation

_JUMP = 0.04
"""Share of the depth by which a pixel next to it may differ; beyond, it may hang between what is near and what is far."""


class DenseDepth:
    """Depth images of a rig as points and images of the ideal camera.

    Parameters
    ----------
    preparation
        Of an RGB-D rig.
    range_m
        Depths beyond are left out: their error grows with the square of the distance.
    """

    def __init__(self, preparation: Preparation, range_m: float) -> None:
        self._preparation, self._range = preparation, range_m
        v, u = np.mgrid[0 : preparation.height, 0 : preparation.width]
        self._pixels = preparation.to_pinhole(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)).pixels

    def points(self, frame: RgbdFrame) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
        """Return points (N, 3) in the camera's optical frame, metres, and their colours (N, 3)."""
        depth, colour = self._images(frame)
        rows = np.flatnonzero((depth.ravel() > 0) & np.isfinite(self._pixels[:, 0]))
        metres = depth.ravel()[rows].astype(np.float64)
        return self._preparation.camera.back_project(self._pixels[rows], metres), colour.reshape(-1, 3)[rows]

    def images(self, frame: RgbdFrame) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Return depth (H, W), metres, 0 where unknown, and colours (H, W, 3) as the ideal camera would see them, to the nearest pixel."""
        depth, colour = self._images(frame)
        ideal_depth, ideal_colour = np.zeros_like(depth), np.zeros_like(colour)
        rows = np.flatnonzero((depth.ravel() > 0) & np.isfinite(self._pixels[:, 0]))
        rows = rows[np.argsort(-depth.ravel()[rows], kind="stable")]  # the nearest is written last
        column, row = np.rint(self._pixels[rows]).astype(np.int64).T
        inside = (column >= 0) & (column < depth.shape[1]) & (row >= 0) & (row < depth.shape[0])
        rows, row, column = rows[inside], row[inside], column[inside]
        ideal_depth[row, column] = depth.ravel()[rows]
        ideal_colour[row, column] = colour.reshape(-1, 3)[rows]
        return ideal_depth, ideal_colour

    def _images(self, frame: RgbdFrame) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Return the prepared depth without what is unknown, far or at an edge (0), and the colours."""
        prepared = self._preparation.prepare(frame)
        if prepared.depth is None:
            raise DataError(f"frame at {frame.stamp_ns} ns has no depth")
        grey = prepared.grey
        colour = np.repeat(grey[..., None], 3, axis=2) if prepared.colour is None else prepared.colour
        return usable_depth(prepared.depth, self._range), np.ascontiguousarray(colour)


def usable_depth(depth: NDArray[np.float32], range_m: float) -> NDArray[np.float32]:
    """Return a depth image (H, W) with 0 where it is unknown, beyond the range or at an edge."""
    depth = np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0)
    return np.where((depth > 0) & (depth <= range_m) & ~_edges(depth), depth, np.float32(0)).astype(np.float32)


def _edges(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the pixels (H, W) beside which the depth jumps."""
    edges = np.zeros(depth.shape, dtype=np.bool_)
    for axis in (0, 1):
        first, second = (depth[:-1], depth[1:]) if axis == 0 else (depth[:, :-1], depth[:, 1:])
        jump = (np.abs(first - second) > _JUMP * np.minimum(first, second)) & (first > 0) & (second > 0)
        if axis == 0:
            edges[:-1] |= jump
            edges[1:] |= jump
        else:
            edges[:, :-1] |= jump
            edges[:, 1:] |= jump
    return edges
