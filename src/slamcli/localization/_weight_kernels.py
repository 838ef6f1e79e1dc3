# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.localization.laser_model`: how well particles explain a scan."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def field_cubes(poses, points, frame, field, far, noise, out):
    """Set `out` (N,) to 1 + the sum of cubed likelihoods of beams that end at `points` (B, 2), seen from `poses` (N, 3).

    `frame` is x, y, yaw of the grid and the reciprocal of its resolution; `field` (H, W) the likelihood of a hit in each cell,
    `far` that off the map, `noise` what is added to each.
    """
    height, width = field.shape
    gc, gs, scale = math.cos(frame[2]), math.sin(frame[2]), frame[3]
    outside = (far + noise) * (far + noise) * (far + noise)
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - frame[0], poses[i, 1] - frame[1]
        x, y = (gc * dx + gs * dy) * scale, (gc * dy - gs * dx) * scale
        c, s = math.cos(poses[i, 2] - frame[2]) * scale, math.sin(poses[i, 2] - frame[2]) * scale
        total = 1.0
        for b in range(points.shape[0]):
            column = x + c * points[b, 0] - s * points[b, 1]
            row = y + s * points[b, 0] + c * points[b, 1]
            if column >= 0.0 and row >= 0.0 and column < width and row < height:
                p = np.float64(field[int(row), int(column)]) + noise
                total += p * p * p
            else:
                total += outside
        out[i] = total


@njit(cache=True, nogil=True)
def field_each(poses, points, frame, field, far, near, noise, logs, explained):
    """Set `logs` (N, B) to the logarithms of the likelihoods of `field_cubes`'s beams; count in `explained` (B,) where a hit is > `near`."""
    height, width = field.shape
    gc, gs, scale = math.cos(frame[2]), math.sin(frame[2]), frame[3]
    outside = math.log(max(far + noise, 1e-300))
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - frame[0], poses[i, 1] - frame[1]
        x, y = (gc * dx + gs * dy) * scale, (gc * dy - gs * dx) * scale
        c, s = math.cos(poses[i, 2] - frame[2]) * scale, math.sin(poses[i, 2] - frame[2]) * scale
        for b in range(points.shape[0]):
            column = x + c * points[b, 0] - s * points[b, 1]
            row = y + s * points[b, 0] + c * points[b, 1]
            if column >= 0.0 and row >= 0.0 and column < width and row < height:
                hit = np.float64(field[int(row), int(column)])
                if hit > near:
                    explained[b] += 1
                logs[i, b] = math.log(max(hit + noise, 1e-300))
            else:
                logs[i, b] = outside


@njit(cache=True, nogil=True)
def cast(x, y, dx, dy, reach, room):
    """Return how far, in cells, a ray goes from `x`, `y` along unit `dx`, `dy` until a cell whose `room` is 0; at most `reach`.

    `room` (H, W) is a number of cells around each that are free for certain: where there is much, the ray leaps.
    """
    height, width = room.shape
    at = 0.0
    while at < reach:
        column, row = math.floor(x + at * dx), math.floor(y + at * dy)
        if column < 0 or row < 0 or column >= width or row >= height:
            return reach
        free = np.int64(room[row, column])
        if free == 0:
            return at
        if free > 2:
            at += free - 2
            continue
        # The border through which the ray leaves this cell.
        leave = reach
        if dx > 0.0:
            leave = min(leave, (column + 1 - x) / dx)
        elif dx < 0.0:
            leave = min(leave, (column - x) / dx)
        if dy > 0.0:
            leave = min(leave, (row + 1 - y) / dy)
        elif dy < 0.0:
            leave = min(leave, (row - y) / dy)
        at = max(leave, at) + 1e-9
    return reach


@njit(cache=True, nogil=True)
def beam_cubes(poses, origins, bearings, ranges, frame, room, most, mixture, out):
    """Set `out` (N,) to 1 + the sum of cubed likelihoods of `ranges` (B,) along `bearings` (B,) by ray casting from `poses` (N, 3).

    `origins` (B, 2) are x, y of the scanner on the robot, `most` the range that means no return, `mixture` z_hit, z_short, z_max, z_rand,
    sigma_hit, lambda_short.
    """
    gc, gs, scale = math.cos(frame[2]), math.sin(frame[2]), frame[3]
    z_hit, z_short, z_max, z_rand, sigma, decay = mixture
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - frame[0], poses[i, 1] - frame[1]
        yaw = poses[i, 2] - frame[2]
        c, s = math.cos(yaw), math.sin(yaw)
        x, y = gc * dx + gs * dy, gc * dy - gs * dx
        total = 1.0
        for b in range(ranges.shape[0]):
            reading = ranges[b]
            angle = yaw + bearings[b]
            from_x = (x + c * origins[b, 0] - s * origins[b, 1]) * scale
            from_y = (y + s * origins[b, 0] + c * origins[b, 1]) * scale
            expected = cast(from_x, from_y, math.cos(angle), math.sin(angle), most * scale, room) / scale
            apart = reading - expected
            p = z_hit * math.exp(-apart * apart / (2.0 * sigma * sigma))
            if apart < 0.0:
                p += z_short * decay * math.exp(-decay * reading)
            if reading >= most:
                p += z_max
            else:
                p += z_rand / most
            total += p * p * p
        out[i] = total
