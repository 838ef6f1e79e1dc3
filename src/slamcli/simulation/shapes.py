# SPDX-License-Identifier: MIT
"""Walls from larger pieces: polylines, rectangles, boxes, and doors cut into them. Segments are float64 (S, 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ON_WALL_M = 0.05  # how far beside a wall a door's centre may be declared


def stack(parts: Sequence[Array], width: int) -> Array:
    """Return rows of all parts, (N, width)."""
    return np.concatenate([np.zeros((0, width)), *parts])


def polyline(points: Array) -> Array:
    """Return the segments (N - 1, 4) between successive points (N, 2)."""
    return np.column_stack([points[:-1], points[1:]])


def rectangle(corners: Array) -> Array:
    """Return the four sides of the rectangle x0, y0, x1, y1."""
    x0, y0, x1, y1 = corners
    return polyline(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]))


def box(centre: Array, size: Array, yaw_rad: float) -> Array:
    """Return the four sides of a box of `size` (length, width) about `centre`, turned by `yaw_rad`."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * size / 2
    return polyline(corners @ np.array([[c, s], [-s, c]]) + centre)


def cut_door(segments: Array, at: Array, width_m: float) -> tuple[Array, list[Array]]:
    """Return the segments with an opening of `width_m` about `at`, and what was cut out of each wall (4,).

    Every wall that passes within 5 cm of `at` is cut, so that a door through the common wall of two rooms opens both.
    """
    kept: list[Array] = []
    cuts: list[Array] = []
    for segment in segments:
        start, along = segment[:2], segment[2:] - segment[:2]
        length = float(np.hypot(*along))
        direction = along / length if length > 0 else np.array([1.0, 0.0])
        offset = at - start
        middle = float(offset @ direction)
        beside = abs(float(offset[0] * direction[1] - offset[1] * direction[0]))
        low, high = max(middle - width_m / 2, 0.0), min(middle + width_m / 2, length)
        if beside > _ON_WALL_M or high <= low or not 0.0 <= middle <= length:
            kept.append(segment)
            continue
        cuts.append(np.concatenate([start + low * direction, start + high * direction]))
        if low > 0:
            kept.append(np.concatenate([start, start + low * direction]))
        if high < length:
            kept.append(np.concatenate([start + high * direction, segment[2:]]))
    return stack([np.array(kept).reshape(-1, 4)], 4), cuts


def door_leaf(opening: Array, angle_rad: float) -> Array:
    """Return the leaf (1, 4) of a door that hangs at the left (upright: lower) end of `opening` (4,), open by `angle_rad`.

    Angles count counter-clockwise from the closed leaf.
    """
    ends = sorted([opening[:2].round(6).tolist(), opening[2:].round(6).tolist()])
    hinge, leaf = np.array(ends[0]), np.array(ends[1]) - np.array(ends[0])
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.concatenate([hinge, hinge + np.array([c * leaf[0] - s * leaf[1], s * leaf[0] + c * leaf[1]])])[None]
