# SPDX-License-Identifier: MIT
"""Kernels that turn the faces that rays meet into light. Arrays and scalars only."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_TAPS = 8  # most samples along the longer side of a pixel's footprint


@njit(cache=True, nogil=True)
def make_rays(directions, pixels, rotations, positions, rays):
    """Fill `rays` (N, 6) float32 for `directions` (N, 3) of a camera at `pixels` (N,), by the pose of each image row.

    `pixels` are row numbers; `rotations` (H, 3, 3) and `positions` (H, 3) say where the camera is at each row.
    """
    for i in range(directions.shape[0]):
        row = pixels[i]
        for k in range(3):
            rays[i, k] = positions[row, k]
            rays[i, 3 + k] = (
                rotations[row, k, 0] * directions[i, 0]
                + rotations[row, k, 1] * directions[i, 1]
                + rotations[row, k, 2] * directions[i, 2]
            )


@njit(cache=True, nogil=True)
def _read(texels, levels, picture, level, x, y, weight, colour):
    """Add `weight` times picture `picture` at `level` and (x, y), texels of the finest level, to `colour` (C,)."""
    begin, width, height = levels[picture, level, 0], levels[picture, level, 1], levels[picture, level, 2]
    scale = 1.0 / (1 << level)
    px = min(max(x * scale - 0.5, 0.0), width - 1.0)
    py = min(max(y * scale - 0.5, 0.0), height - 1.0)
    left, top = int(px), int(py)
    fx, fy = px - left, py - top
    right, low = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = begin + top * width + left, begin + top * width + right
    c, d = begin + low * width + left, begin + low * width + right
    wa, wb = weight * (1.0 - fx) * (1.0 - fy), weight * fx * (1.0 - fy)
    wc, wd = weight * (1.0 - fx) * fy, weight * fx * fy
    for channel in range(colour.shape[0]):
        colour[channel] += (
            wa * texels[a, channel] + wb * texels[b, channel] + wc * texels[c, channel] + wd * texels[d, channel]
        )


@njit(cache=True, nogil=True)
def shade(
    faces, directions, right, down, pixels, rotations, positions, planes, maps, pictures, brightness, texels, levels,
    texel_m, light, distances, slants,
):  # fmt: skip
    """Fill `light` (N, C) with what each ray sees, `distances` (N,) in lengths of its direction, and `slants` (N,).

    `faces` (N,) is the face that a ray meets, -1 the sky (distance inf). `right` and `down` (N, 3) are what a direction
    changes by from one pixel to the next. The footprint of a pixel on its picture is a parallelogram: the mip level follows its
    shorter side, and samples are spread along the longer one (anisotropic filtering, Williams 1983, Heckbert 1989).
    Slants are cosines of the angle between ray and normal.
    """
    channels = light.shape[1]
    ray, turned, step, mean = np.empty(3), np.empty(3), np.empty((2, 2)), np.empty(channels)
    for i in range(faces.shape[0]):
        face, row = faces[i], pixels[i]
        for k in range(3):
            ray[k] = (
                rotations[row, k, 0] * directions[i, 0]
                + rotations[row, k, 1] * directions[i, 1]
                + rotations[row, k, 2] * directions[i, 2]
            )
        length = math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
        if face < 0:
            distances[i], slants[i] = np.inf, 1.0
            for channel in range(channels):
                light[i, channel] = 190.0 + 45.0 * min(max(ray[2] / length, 0.0), 1.0)
            continue
        nx, ny, nz, offset = planes[face, 0], planes[face, 1], planes[face, 2], planes[face, 3]
        towards = nx * ray[0] + ny * ray[1] + nz * ray[2]
        gap = offset - nx * positions[row, 0] - ny * positions[row, 1] - nz * positions[row, 2]
        if abs(towards) < 1e-9 * length:
            towards = 1e-9 * length if towards >= 0.0 else -1e-9 * length
        distance = gap / towards
        distances[i], slants[i] = distance, abs(towards) / length
        u, v = maps[face, 0, 3], maps[face, 1, 3]
        for k in range(3):
            at = positions[row, k] + distance * ray[k]
            u += maps[face, 0, k] * at
            v += maps[face, 1, k] * at
        for j in range(2):
            change = right if j == 0 else down
            sx, sy, sz = change[i, 0], change[i, 1], change[i, 2]
            turned[0] = rotations[row, 0, 0] * sx + rotations[row, 0, 1] * sy + rotations[row, 0, 2] * sz
            turned[1] = rotations[row, 1, 0] * sx + rotations[row, 1, 1] * sy + rotations[row, 1, 2] * sz
            turned[2] = rotations[row, 2, 0] * sx + rotations[row, 2, 1] * sy + rotations[row, 2, 2] * sz
            turn = (nx * turned[0] + ny * turned[1] + nz * turned[2]) / towards
            step[j, 0] = step[j, 1] = 0.0
            for k in range(3):
                moved = distance * (turned[k] - ray[k] * turn) / texel_m
                step[j, 0] += maps[face, 0, k] * moved
                step[j, 1] += maps[face, 1, k] * moved
        wide = math.sqrt(step[0, 0] ** 2 + step[0, 1] ** 2)
        tall = math.sqrt(step[1, 0] ** 2 + step[1, 1] ** 2)
        longer = 0 if wide >= tall else 1
        most, least = max(wide, tall, 1e-9), max(min(wide, tall), 1e-9)
        taps = min(max(math.ceil(most / max(least, 1.0)), 1), _TAPS)
        level = max(math.log2(max(most / taps, least)), 0.0)
        level = min(level, levels.shape[1] - 1.001)
        base = int(level)
        share = level - base
        for channel in range(channels):
            mean[channel] = 0.0
        for tap in range(taps):
            along = (tap + 0.5) / taps - 0.5
            x = u / texel_m + along * step[longer, 0]
            y = v / texel_m + along * step[longer, 1]
            _read(texels, levels, pictures[face], base, x, y, (1.0 - share) / taps, mean)
            if share > 0.0:
                _read(texels, levels, pictures[face], base + 1, x, y, share / taps, mean)
        for channel in range(channels):
            light[i, channel] = mean[channel] * brightness[face]


@njit(cache=True, nogil=True)
def find_edges(surfaces, edges):
    """Mark in `edges` (H, W) the pixels beside which another surface (H, W) is seen."""
    height, width = surfaces.shape
    for row in range(height):
        for column in range(width):
            here = surfaces[row, column]
            if column + 1 < width and surfaces[row, column + 1] != here:
                edges[row, column] = edges[row, column + 1] = True
            if row + 1 < height and surfaces[row + 1, column] != here:
                edges[row, column] = edges[row + 1, column] = True
