# SPDX-License-Identifier: MIT
"""Kernel of one scan: beams from a moving robot through walls and moving things, with the scanner's errors."""

import math

import numpy as np
from numba import njit

_SLACK = 1e-9  # share of a segment: rays through a corner that two walls share must not slip between them


@njit(cache=True, nogil=True)
def _mover(ox, oy, dx, dy, movers, j, time):
    """Distance along a ray to what moves (9,) as row j is `time` s later: a disc, or a box; inf without a hit."""
    ax, ay = ox - movers[j, 0] - movers[j, 7] * time, oy - movers[j, 1] - movers[j, 8] * time
    if movers[j, 4] == 0.0 and movers[j, 5] == 0.0:
        along, across = -(ax * dx + ay * dy), ax * dy - ay * dx
        half = movers[j, 6] * movers[j, 6] - across * across
        if half < 0.0:
            return np.inf
        root = math.sqrt(half)
        if along - root >= 0.0:
            return along - root
        return along + root if along + root >= 0.0 else np.inf
    c, s = movers[j, 2], movers[j, 3]
    px, py = c * ax + s * ay, c * ay - s * ax
    qx, qy = c * dx + s * dy, c * dy - s * dx
    enter, leave = -np.inf, np.inf
    for at, way, half in ((px, qx, movers[j, 4]), (py, qy, movers[j, 5])):
        if way == 0.0:
            if abs(at) > half:
                return np.inf
        else:
            one, two = (-half - at) / way, (half - at) / way
            enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
    if enter > leave or leave < 0.0:
        return np.inf
    return enter if enter >= 0.0 else leave


@njit(cache=True, nogil=True)
def _shape(ox, oy, dx, dy, segments, circles, j, best):
    """Distance along a ray to shape j, counted through segments (S, 4) and circles (C, 3); `best` without a nearer hit."""
    if j < segments.shape[0]:
        ax, ay = segments[j, 0] - ox, segments[j, 1] - oy
        ex, ey = segments[j, 2] - segments[j, 0], segments[j, 3] - segments[j, 1]
        denominator = dx * ey - dy * ex
        if abs(denominator) < 1e-12:
            return best
        distance = (ax * ey - ay * ex) / denominator
        along = (ax * dy - ay * dx) / denominator
        return distance if 0.0 <= distance < best and -_SLACK <= along <= 1.0 + _SLACK else best
    circle = circles[j - segments.shape[0]]
    ax, ay = circle[0] - ox, circle[1] - oy
    along, across = ax * dx + ay * dy, ax * dy - ay * dx
    half = circle[2] * circle[2] - across * across
    if half < 0.0:
        return best
    root = math.sqrt(half)
    hit = along - root if along - root >= 0.0 else along + root
    return hit if 0.0 <= hit < best else best


@njit(cache=True, nogil=True)
def _walls(ox, oy, dx, dy, segments, circles, starts, members, layout, best):
    """Distance along a ray to the first segment or circle, `best` without a nearer one.

    Without `members` all are tried; else only those that stand in the cells of a coarse grid that the ray passes
    (Amanatides and Woo 1987). `layout` is its corner x, y, its cell size, and its numbers of columns and rows.
    """
    if members.shape[0] == 0:
        for j in range(segments.shape[0] + circles.shape[0]):
            best = _shape(ox, oy, dx, dy, segments, circles, j, best)
        return best
    size, columns, rows = layout[2], np.int64(layout[3]), np.int64(layout[4])
    gx, gy = ox - layout[0], oy - layout[1]
    enter, leave = 0.0, best
    for at, way, wide in ((gx, dx, columns * size), (gy, dy, rows * size)):
        if way == 0.0:
            if at < 0.0 or at > wide:
                return best
        else:
            one, two = -at / way, (wide - at) / way
            enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
    if enter > leave:
        return best
    column = min(max(np.int64(math.floor((gx + enter * dx) / size)), 0), columns - 1)
    row = min(max(np.int64(math.floor((gy + enter * dy) / size)), 0), rows - 1)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    next_x = ((column + (1 if dx > 0 else 0)) * size - gx) / dx if dx != 0.0 else np.inf
    next_y = ((row + (1 if dy > 0 else 0)) * size - gy) / dy if dy != 0.0 else np.inf
    per_x = abs(size / dx) if dx != 0.0 else np.inf
    per_y = abs(size / dy) if dy != 0.0 else np.inf
    while True:
        cell = row * columns + column
        for k in range(starts[cell], starts[cell + 1]):
            best = _shape(ox, oy, dx, dy, segments, circles, members[k], best)
        until = min(next_x, next_y)
        if best <= until or until >= leave:
            return best
        if next_x < next_y:
            next_x += per_x
            column += step_x
        else:
            next_y += per_y
            row += step_y
        if row < 0 or column < 0 or row >= rows or column >= columns:
            return best


@njit(cache=True, nogil=True)
def _cells(gx, gy, dx, dy, field, best):
    """Distance in cells along a ray to where it enters the first wall cell, `best` without a nearer one.

    Where no wall is near the ray jumps as far as the field says that there is none, elsewhere it walks from cell to cell
    (Amanatides and Woo 1987). Every crossing of a cell's side is computed from the ray's origin, so jumps add no error.
    """
    height, width = field.shape
    enter, leave = 0.0, best
    for at, way, size in ((gx, dx, float(width)), (gy, dy, float(height))):
        if way == 0.0:
            if at < 0.0 or at > size:
                return best
        else:
            one, two = -at / way, (size - at) / way
            enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
    if enter > leave or enter >= best:
        return best
    per_x = 1.0 / dx if dx != 0.0 else np.inf
    per_y = 1.0 / dy if dy != 0.0 else np.inf
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    side_x, side_y = (1 if dx > 0 else 0), (1 if dy > 0 else 0)
    at = enter
    column = min(max(np.int64(math.floor(gx + at * dx)), 0), width - 1)
    row = min(max(np.int64(math.floor(gy + at * dy)), 0), height - 1)
    while at < leave:
        value = np.int64(field[row, column])
        if value == 0:
            return at
        if value > 3:
            at += value - 1.0
            if at >= leave:
                return best
            column = min(max(np.int64(math.floor(gx + at * dx)), 0), width - 1)
            row = min(max(np.int64(math.floor(gy + at * dy)), 0), height - 1)
            continue
        next_x = (column + side_x - gx) * per_x if dx != 0.0 else np.inf
        next_y = (row + side_y - gy) * per_y if dy != 0.0 else np.inf
        if next_x < next_y:
            at = next_x
            column += step_x
        else:
            at = next_y
            row += step_y
        if row < 0 or column < 0 or row >= height or column >= width:
            return best
    return best


@njit(cache=True, nogil=True)
def true_ranges(
    poses, mount, angles, times, field, frame, segments, circles, starts, members, layout, movers, limit, ranges
):
    """Fill `ranges` (N,), metres, inf beyond `limit`.

    `poses` (N, 3) are those of base_link in the map at each beam, `mount` x, y of the scanner on it, `angles` (N,) those
    of the beams in base_link, `times` (N,) seconds of the beams from the moment at which `movers` (M, 9) are there.
    """
    size = frame[4]
    for i in range(angles.shape[0]):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        ox, oy = poses[i, 0] + c * mount[0] - s * mount[1], poses[i, 1] + s * mount[0] + c * mount[1]
        dx, dy = math.cos(poses[i, 2] + angles[i]), math.sin(poses[i, 2] + angles[i])
        best = limit
        for j in range(movers.shape[0]):
            hit = _mover(ox, oy, dx, dy, movers, j, times[i])
            if hit < best:
                best = hit
        best = _walls(ox, oy, dx, dy, segments, circles, starts, members, layout, best)
        if field.shape[0] > 0:
            gx = (frame[2] * (ox - frame[0]) + frame[3] * (oy - frame[1])) / size
            gy = (frame[2] * (oy - frame[1]) - frame[3] * (ox - frame[0])) / size
            best = size * _cells(
                gx, gy, frame[2] * dx + frame[3] * dy, frame[2] * dy - frame[3] * dx, field, best / size
            )
        ranges[i] = np.inf if best >= limit * (1.0 - 1e-12) else best


@njit(cache=True, nogil=True)
def poses_at(history, first, share, newest, oldest, step, poses):
    """Fill `poses` (N, 3): row i is where the robot was `share` + i * `step` ticks after tick `first`.

    `history` (T, 3) holds the pose of tick k in row k modulo T, of ticks `oldest` to `newest`; beyond them the nearest.
    """
    size = history.shape[0]
    for i in range(poses.shape[0]):
        at = share + i * step
        whole = np.int64(math.floor(at))
        a = min(max(first + whole, oldest), newest)
        b = min(max(first + whole + 1, oldest), newest)
        part = at - whole
        for k in range(3):
            poses[i, k] = (1.0 - part) * history[a % size, k] + part * history[b % size, k]


@njit(cache=True, nogil=True)
def measure(ranges, noise, lost, scanner, out):
    """Fill `out` float32 (N,) with what a scanner says of true `ranges` (N,): `laser.Scanner` explains each step.

    `scanner` holds the nearest and farthest range, noise, noise per range, resolution, share of dropouts, and what a beam
    without an answer and one beyond the farthest range read.
    """
    nearest, farthest, resolution = scanner[0], scanner[1], scanner[4]
    for i in range(ranges.shape[0]):
        true = ranges[i]
        if lost[i] < scanner[5]:
            out[i] = scanner[6]
            continue
        if true == np.inf:
            out[i] = scanner[7]
            continue
        if true < nearest:
            out[i] = -np.inf
            continue
        told = true + noise[i] * math.hypot(scanner[2], scanner[3] * true)
        if resolution > 0.0:
            told = np.rint(told / resolution) * resolution
        told = max(told, nearest)
        out[i] = scanner[7] if told > farthest else told
