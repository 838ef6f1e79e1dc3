# SPDX-License-Identifier: MIT
"""Kernels that paint the pictures on surfaces and shrink them. Arrays and scalars only."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _covers(kind, a, b, pattern):
    """Return whether the figure `kind` covers (a, b) of its box, both from -1 to 1."""
    if kind == 1:  # ellipse
        return a * a + b * b <= 1.0
    if kind == 2:  # ring
        return 0.4 <= a * a + b * b <= 1.0
    if kind == 3:  # triangle
        return abs(a) <= (1.0 - b) / 2
    if kind == 4:  # stripes
        return int((a + 1.0) * 3.5) % 2 == 0
    if kind == 5:  # checks
        return (int((a + 1.0) * 2) + int((b + 1.0) * 2)) % 2 == 0
    if kind == 6:  # a letter of 3 x 5 cells
        column, row = min(int((a + 1.0) * 1.5), 2), min(int((b + 1.0) * 2.5), 4)
        return (pattern >> (row * 3 + column)) & 1 == 1
    if kind == 7:  # cross
        return abs(a) <= 0.3 or abs(b) <= 0.3
    return True


@njit(cache=True, nogil=True)
def add_octave(canvas, lattice, step, weight):
    """Add noise with one value of `lattice` (h, w) every `step` texels, smooth between, to `canvas` (H, W, 3)."""
    height, width = canvas.shape[0], canvas.shape[1]
    for row in range(height):
        y = row / step
        top = int(y)
        fy = y - top
        fy = fy * fy * (3.0 - 2.0 * fy)
        for column in range(width):
            x = column / step
            left = int(x)
            fx = x - left
            fx = fx * fx * (3.0 - 2.0 * fx)
            upper = lattice[top, left] * (1.0 - fx) + lattice[top, left + 1] * fx
            lower = lattice[top + 1, left] * (1.0 - fx) + lattice[top + 1, left + 1] * fx
            value = weight * (upper * (1.0 - fy) + lower * fy)
            for channel in range(3):
                canvas[row, column, channel] += value


@njit(cache=True, nogil=True)
def paint(canvas, figures):
    """Paint `figures` (D, 12) one over the other on `canvas` (H, W, 3), with four samples a texel.

    A figure is: kind, x, y of its centre and its half width and height in texels, cosine and sine of its turn, three
    colours, opacity, and the cells of a letter as bits.
    """
    height, width = canvas.shape[0], canvas.shape[1]
    for i in range(figures.shape[0]):
        kind, pattern = int(figures[i, 0]), int(figures[i, 11])
        x, y, half_w, half_h, c, s = figures[i, 1:7]
        reach_x = abs(c) * half_w + abs(s) * half_h + 1.0
        reach_y = abs(s) * half_w + abs(c) * half_h + 1.0
        for row in range(max(int(y - reach_y), 0), min(int(y + reach_y) + 2, height)):
            for column in range(max(int(x - reach_x), 0), min(int(x + reach_x) + 2, width)):
                covered = 0
                for k in range(4):
                    dx = column + 0.25 + 0.5 * (k % 2) - x
                    dy = row + 0.25 + 0.5 * (k // 2) - y
                    a, b = (c * dx + s * dy) / half_w, (c * dy - s * dx) / half_h
                    if abs(a) <= 1.0 and abs(b) <= 1.0 and _covers(kind, a, b, pattern):
                        covered += 1
                if covered:
                    share = figures[i, 10] * covered / 4
                    for channel in range(3):
                        old = canvas[row, column, channel]
                        canvas[row, column, channel] = old + share * (figures[i, 7 + channel] - old)


@njit(cache=True, nogil=True)
def shrink(fine, coarse):
    """Fill `coarse` (h, w, C) with means of 2 x 2 of `fine` (H, W, C), uint8; the last row or column stands for a missing one."""
    for row in range(coarse.shape[0]):
        low = min(2 * row + 1, fine.shape[0] - 1)
        for column in range(coarse.shape[1]):
            right = min(2 * column + 1, fine.shape[1] - 1)
            for channel in range(coarse.shape[2]):
                total = (
                    np.int64(fine[2 * row, 2 * column, channel])
                    + np.int64(fine[2 * row, right, channel])
                    + np.int64(fine[low, 2 * column, channel])
                    + np.int64(fine[low, right, channel])
                )
                coarse[row, column, channel] = (total + 2) // 4


@njit(cache=True, nogil=True)
def to_bytes(canvas, picture):
    """Round `canvas` (H, W, 3) into `picture`, uint8 of the same shape."""
    for row in range(canvas.shape[0]):
        for column in range(canvas.shape[1]):
            for channel in range(3):
                picture[row, column, channel] = math.floor(min(max(canvas[row, column, channel], 0.0), 255.0) + 0.5)
