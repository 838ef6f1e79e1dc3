# SPDX-License-Identifier: MIT
"""The picture of trajectories, and of what was seen from them, where there is no map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import scales
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.raster import Pixels
from slamcli.trajectory import Trajectory

_OTHERS = (scales.BLUE, scales.VERMILION, scales.PURPLE, scales.SKY, scales.ORANGE)
_FEW_POINTS = 5000
_POINTS = (96, 104, 115)
_AXES = "xyz"


def track_image(
    trajectory: Trajectory,
    others: Sequence[tuple[str, Trajectory]] = (),
    *,
    truth: tuple[str, Trajectory] | None = None,
    points_m: NDArray[np.float64] | None = None,
    label: str = "trajectory",
    title: str = "",
    max_pixels: int = 2000,
) -> Pixels:
    """Return the picture uint8 (H, W, 3) of a trajectory coloured by time, with others in one colour each below it.

    Planar trajectories are seen from above; of one that uses its height more than x or y (a camera's frame looks along
    z), the two axes that it uses most are drawn.

    Parameters
    ----------
    trajectory
        The trajectory to show.
    others
        Label and trajectory, up to five.
    truth
        Label and trajectory of ground truth, green as in every figure.
    points_m
        float64 (N, 2), metres: what scanners saw, drawn grey (only where x and y are drawn).
    label
        What `trajectory` is.
    title
        One line above the picture.
    max_pixels
        Most pixels of the longer side (margins come on top).
    """
    beside = [(*truth, scales.GREEN)] if truth is not None else []
    beside += [(name, t, colour) for (name, t), colour in zip(others, _OTHERS, strict=False)]
    first, second = choose_axes([trajectory, *(t for _, t, _ in beside)])
    lines = [t.positions_m[:, [first, second]] for t in (trajectory, *(t for _, t, _ in beside))]
    seen = points_m if points_m is not None and (first, second) == (0, 1) else np.zeros((0, 2))
    view = plane.fit_view(np.concatenate([*lines, seen]), max_pixels)
    picture = np.full((view.height_px, view.width_px, 3), 255, dtype=np.uint8)
    _draw_points(picture, view.pixels(seen))
    thin = plane.line_width(picture)
    for line, (_, _, colour) in zip(lines[1:], beside, strict=True):
        raster.stroke(picture, view.pixels(line), colour, 1.8 * thin, opacity=0.6)
    plane.draw_trajectory(picture, view.pixels(lines[0]), trajectory.stamps_ns, thin)
    legend: list[tuple[str, plane.Colour | None]] = [plane.time_legend(label, trajectory)] if len(trajectory) else []
    legend += [(name, colour) for name, _, colour in beside]
    return plane.framed(picture, view, title, legend, (_AXES[first], _AXES[second]), grid=True)


def choose_axes(trajectories: Sequence[Trajectory]) -> tuple[int, int]:
    """Return the two of the axes 0, 1 and 2 to draw: x and y unless z is used more than one of them."""
    points = np.concatenate([t.positions_m for t in trajectories])
    if not len(points):
        return 0, 1
    spans = np.ptp(points, axis=0)
    if spans[2] <= max(min(spans[0], spans[1]), 0.05 * spans.max()):
        return 0, 1
    return (0, 2) if spans[0] >= spans[1] else (1, 2)


def _draw_points(picture: Pixels, at_px: NDArray[np.float64]) -> None:
    """Darken the pixels that hold points, the more the more points they hold; few points become dots."""
    if len(at_px) <= _FEW_POINTS:
        raster.dots(picture, at_px, 1.5, _POINTS)
        return
    height, width = picture.shape[:2]
    at = np.floor(at_px[np.isfinite(at_px).all(axis=1)]).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    count = np.bincount(at[inside, 1] * width + at[inside, 0], minlength=height * width).reshape(height, width)
    share = (1 - 0.55**count)[..., None]
    picture[:] = np.round(255 + (np.array(_POINTS) - 255) * share).astype(np.uint8)
