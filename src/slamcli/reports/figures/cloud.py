# SPDX-License-Identifier: MIT
"""Pictures of a point cloud: from above and from the side, coloured by height."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import scales
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.raster import Pixels
from slamcli.trajectory import Trajectory

_SPARSE_PER_PIXEL = 0.15
_AXES = "xyz"


def cloud_view(
    points_m: NDArray[np.float32],
    axes: tuple[int, int],
    *,
    trajectory: Trajectory | None = None,
    max_pixels: int = 1400,
) -> Pixels:
    """Return the picture uint8 (H, W, 3) of points seen along the third axis; where several lie on one pixel the nearest is drawn.

    Parameters
    ----------
    points_m
        float32 (N, 3), map frame.
    axes
        Which of x, y and z (0, 1, 2) run to the right and up: (0, 1) from above, (0, 2) or (1, 2) from the side.
    trajectory
        Where the robot was, drawn black over the points.
    max_pixels
        Most pixels of the longer side (margins come on top).
    """
    first, second = axes
    at = points_m[:, [first, second]].astype(np.float64)
    inner = _without_strays(at)
    line = np.zeros((0, 2)) if trajectory is None else trajectory.positions_m[:, [first, second]]
    view = plane.fit_view(np.concatenate([at[inner], line]), max_pixels)
    picture = np.full((view.height_px, view.width_px, 3), 255, dtype=np.uint8)
    low, high = height_range(points_m)
    _draw(picture, view.pixels(at[inner]), points_m[inner, 2], _depth(points_m[inner], axes), (low, high))
    thin = plane.line_width(picture)
    if len(line):
        raster.stroke(picture, view.pixels(line), plane.PAGE, 2.6 * thin)  # so that it is seen on dark points
        raster.stroke(picture, view.pixels(line), plane.INK, thin)
    legend: list[tuple[str, plane.Colour | None]] = [
        (f"height {scales.number(round(low, 1) + 0.0)} to {scales.number(round(high, 1) + 0.0)} m", None)
    ]
    if len(line):
        legend.append(("trajectory", plane.INK))
    return plane.framed(picture, view, "", legend, (_AXES[first], _AXES[second]), grid=True)


def height_range(points_m: NDArray[np.float32]) -> tuple[float, float]:
    """Return the heights that most points lie between: the 1st and the 99th percentile."""
    if not len(points_m):
        return 0.0, 1.0
    low, high = np.percentile(points_m[:, 2], [1.0, 99.0]).tolist()
    return float(low), float(max(high, low + 1e-3))


def _without_strays(at: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points lie within 1.5 times the range of 99.8 % of them: single far echoes would shrink everything else."""
    if not len(at):
        return np.zeros(0, dtype=bool)
    low, high = np.percentile(at, [0.1, 99.9], axis=0)
    room = 0.25 * (high - low) + 0.5
    return ((at >= low - room) & (at <= high + room)).all(axis=1)


def _depth(points_m: NDArray[np.float32], axes: tuple[int, int]) -> NDArray[np.float64]:
    """Return how near each point is to who looks: height from above, else along the axis that is not drawn."""
    hidden = ({0, 1, 2} - set(axes)).pop()
    towards = 1.0 if hidden in (0, 2) else -1.0  # x to the right and z up look along +y: small y is near
    return towards * points_m[:, hidden].astype(np.float64)


def _draw(
    picture: Pixels,
    at_px: NDArray[np.float64],
    heights: NDArray[np.float32],
    depth: NDArray[np.float64],
    between: tuple[float, float],
) -> None:
    """Colour the pixels that hold points by the height of the nearest; few points are drawn larger."""
    height, width = picture.shape[:2]
    at = np.floor(at_px).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    order = np.flatnonzero(inside)[np.argsort(depth[inside], kind="stable")]
    share = (heights[order].astype(np.float64) - between[0]) / (between[1] - between[0])
    colours = np.round(scales.time_colours(share)).astype(np.uint8)
    x, y = at[order].T
    reach = 1 if len(order) < _SPARSE_PER_PIXEL * width * height else 0
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            picture[np.clip(y + dy, 0, height - 1), np.clip(x + dx, 0, width - 1)] = colours
