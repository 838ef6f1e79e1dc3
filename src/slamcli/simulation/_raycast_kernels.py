# SPDX-License-Identifier: MIT
"""Kernels: exact intersections of rays with segments, circles, moving discs and grid cells."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SLACK = 1e-9  # metres or share of a segment: rays through a corner that two walls share must not slip between them


@njit(cache=True)
def cast_shapes(origins: Floats, directions: Floats, segments: Floats, circles: Floats, ranges: Floats) -> None:
    """Lower `ranges` (N,) to the nearest hit of rays (N, 2), unit directions, with segments (S, 4) and circles (C, 3)."""
    for i in range(origins.shape[0]):
        ox, oy, dx, dy = origins[i, 0], origins[i, 1], directions[i, 0], directions[i, 1]
        best = ranges[i]
        for j in range(segments.shape[0]):
            ax, ay = segments[j, 0] - ox, segments[j, 1] - oy
            ex, ey = segments[j, 2] - segments[j, 0], segments[j, 3] - segments[j, 1]
            denominator = dx * ey - dy * ex
            if abs(denominator) < 1e-12:
                continue
            distance = (ax * ey - ay * ex) / denominator
            if distance < 0.0 or distance >= best:
                continue
            along = (ax * dy - ay * dx) / denominator
            if -_SLACK <= along <= 1.0 + _SLACK:
                best = distance
        for j in range(circles.shape[0]):
            hit = _circle(circles[j, 0] - ox, circles[j, 1] - oy, circles[j, 2], dx, dy)
            if hit < best:
                best = hit
        ranges[i] = best


@njit(cache=True)
def cast_discs(origins: Floats, directions: Floats, times: Floats, discs: Floats, ranges: Floats) -> None:
    """Lower `ranges` (N,) to the nearest hit with discs (D, 5) x, y, radius, vx, vy that move; ray i is cast at times[i]."""
    for i in range(origins.shape[0]):
        ox, oy, dx, dy = origins[i, 0], origins[i, 1], directions[i, 0], directions[i, 1]
        for j in range(discs.shape[0]):
            cx = discs[j, 0] + discs[j, 3] * times[i] - ox
            cy = discs[j, 1] + discs[j, 4] * times[i] - oy
            hit = _circle(cx, cy, discs[j, 2], dx, dy)
            if hit < ranges[i]:
                ranges[i] = hit


@njit(cache=True)
def _circle(cx: float, cy: float, radius: float, dx: float, dy: float) -> float:
    """Distance along a ray from the origin to a circle's line (from inside: to its far side), inf without a hit."""
    along = cx * dx + cy * dy
    across = cx * dy - cy * dx
    half = radius * radius - across * across
    if half < 0.0:
        return np.inf
    root = np.sqrt(half)
    if along - root >= 0.0:
        return along - root
    if along + root >= 0.0:
        return along + root
    return np.inf


@njit(cache=True)
def cast_grid(origins: Floats, directions: Floats, occupied: NDArray[np.uint8], ranges: Floats) -> None:
    """Lower `ranges` (N,), in cells, to where rays enter the first occupied cell of uint8 (H, W).

    Origins (N, 2) are x, y in cells from the lower left corner and may lie outside. A ray that starts in an occupied
    cell has range 0. Amanatides and Woo, A fast voxel traversal algorithm for ray tracing, Eurographics 1987.
    """
    height, width = occupied.shape
    for i in range(origins.shape[0]):
        ox, oy, dx, dy = origins[i, 0], origins[i, 1], directions[i, 0], directions[i, 1]
        enter, leave = _through_box(ox, oy, dx, dy, float(width), float(height))
        if enter > leave or enter >= ranges[i]:
            continue
        limit = min(leave, ranges[i])
        column = min(max(np.int64(np.floor(ox + enter * dx)), 0), width - 1)
        row = min(max(np.int64(np.floor(oy + enter * dy)), 0), height - 1)
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        next_x = (column + (dx > 0) - ox) / dx if dx != 0.0 else np.inf
        next_y = (row + (dy > 0) - oy) / dy if dy != 0.0 else np.inf
        per_x = abs(1.0 / dx) if dx != 0.0 else np.inf
        per_y = abs(1.0 / dy) if dy != 0.0 else np.inf
        at = enter
        while at < limit:
            if occupied[row, column]:
                ranges[i] = at
                break
            if next_x < next_y:
                at = next_x
                next_x += per_x
                column += step_x
            else:
                at = next_y
                next_y += per_y
                row += step_y
            if row < 0 or column < 0 or row >= height or column >= width:
                break


@njit(cache=True)
def _through_box(ox: float, oy: float, dx: float, dy: float, width: float, height: float) -> tuple[float, float]:
    """Part of a ray inside the box [0, width] x [0, height]: where it enters (at least 0) and leaves."""
    enter, leave = 0.0, np.inf
    for origin, direction, size in ((ox, dx, width), (oy, dy, height)):
        if direction == 0.0:
            if origin < 0.0 or origin > size:
                return 1.0, 0.0
        else:
            a, b = -origin / direction, (size - origin) / direction
            enter = max(enter, min(a, b))
            leave = min(leave, max(a, b))
    return enter, leave


@njit(cache=True)
def distances_to_shapes(points: Floats, segments: Floats, circles: Floats, distances: Floats) -> None:
    """Lower `distances` (N,) to those of points (N, 2) to the nearest segment (S, 4) or into the nearest circle (C, 3)."""
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        best = distances[i]
        for j in range(segments.shape[0]):
            ax, ay = segments[j, 0], segments[j, 1]
            ex, ey = segments[j, 2] - ax, segments[j, 3] - ay
            length = ex * ex + ey * ey
            along = 0.0
            if length > 0.0:
                along = min(max(((x - ax) * ex + (y - ay) * ey) / length, 0.0), 1.0)
            best = min(best, np.hypot(ax + along * ex - x, ay + along * ey - y))
        for j in range(circles.shape[0]):
            best = min(best, max(np.hypot(circles[j, 0] - x, circles[j, 1] - y) - circles[j, 2], 0.0))
        distances[i] = best
