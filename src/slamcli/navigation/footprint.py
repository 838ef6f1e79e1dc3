# SPDX-License-Identifier: MIT
"""The robot's outline as costmap_2d handles it: polygon, padding, inscribed and circumscribed radius."""

from __future__ import annotations

import ast
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError

_CIRCLE_CORNERS = 16


def parse_footprint(value: Any) -> tuple[tuple[float, float], ...]:
    """Return the corners of a footprint given as list or text ``[[x1, y1], [x2, y2], ...]``; empty for none.

    Raises
    ------
    ConfigError
        If it is not a list of at least three points with finite coordinates.
    """
    try:
        corners = ast.literal_eval(value.strip() or "[]") if isinstance(value, str) else value
        points = tuple((float(x), float(y)) for x, y in corners)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError, OverflowError) as error:
        raise ConfigError(f"footprint={value!r}: not a list of points [[x1, y1], [x2, y2], ...]") from error
    if points and (len(points) < 3 or not all(math.isfinite(v) for point in points for v in point)):
        raise ConfigError(f"footprint={value!r}: needs three points or more, with finite coordinates")
    return points


def padded_polygon(
    footprint: Sequence[tuple[float, float]], robot_radius_m: float, padding_m: float
) -> NDArray[np.float64]:
    """Return float64 (N, 2), metres, base frame: the padded outline.

    Without a footprint the robot is a circle, which costmap_2d makes of 16 corners. Padding moves each coordinate of a
    corner away from zero.
    """
    if footprint:
        corners = np.array(footprint, dtype=np.float64)
    else:
        angles = np.arange(_CIRCLE_CORNERS) * 2.0 * np.pi / _CIRCLE_CORNERS
        corners = robot_radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
    return corners + np.sign(corners) * padding_m


def radii(polygon: NDArray[np.float64]) -> tuple[float, float]:
    """Return the inscribed and the circumscribed radius in metres, about the origin of the base frame.

    The inscribed radius is the distance to the nearest edge, whether or not the origin lies inside, as in costmap_2d.
    """
    following = np.roll(polygon, -1, axis=0)
    edges = following - polygon
    squared = np.maximum((edges**2).sum(axis=1), np.finfo(float).tiny)
    along = np.clip(-(polygon * edges).sum(axis=1) / squared, 0.0, 1.0)
    nearest = polygon + along[:, None] * edges
    return float(np.linalg.norm(nearest, axis=1).min()), float(np.linalg.norm(polygon, axis=1).max())
