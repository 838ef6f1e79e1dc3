# SPDX-License-Identifier: MIT
"""Compiled loops of the orientation and the description of key points; see `slamcli.vision.orb`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def centroid_angles(image, columns, rows, half_widths):
    """Return the angles (N,), radians in [0, 2 pi), from key points to the intensity centroids of the discs around them.

    `image` is uint8 (H, W); `half_widths` int64 (R + 1,) says how far the disc of radius R reaches in a row so far from its
    centre; key points lie at least R inside the image.
    """
    angles = np.empty(len(columns))
    radius = len(half_widths) - 1
    for i in range(len(columns)):
        x, y = columns[i], rows[i]
        sum_x, sum_y = np.int64(0), np.int64(0)
        for dy in range(-radius, radius + 1):
            half = half_widths[abs(dy)]
            row = image[y + dy, x - half : x + half + 1]
            total, weighted = np.int32(0), np.int32(0)
            for u in range(len(row)):
                value = np.int32(row[u])
                total += value
                weighted += np.int32(u) * value
            sum_x += np.int64(weighted) - half * np.int64(total)
            sum_y += dy * np.int64(total)
        angle = math.atan2(float(sum_y), float(sum_x))
        angles[i] = angle if angle >= 0.0 else angle + 2.0 * math.pi
    return angles


@njit(cache=True, nogil=True)
def describe(image, columns, rows, angles, pattern_x, pattern_y, out):
    """Fill `out`, uint8 (N, 32), with the bits of N key points of a smoothed image, uint8 (H, W), C-contiguous.

    `pattern_x`, `pattern_y` are float32 (2, 256): where the two pixels of each comparison lie; they are turned by the key point's
    angle and rounded, all in single precision as OpenCV does. Key points lie at least 19 pixels inside.
    """
    stride = np.int32(image.shape[1])
    pixels = image.ravel()
    places = np.empty((2, 256), np.int32)
    for i in range(len(columns)):
        # OpenCV keeps degrees.
        angle = np.float32(np.float32(angles[i] * (180.0 / math.pi)) * np.float32(math.pi / 180.0))
        a, b = np.float32(math.cos(angle)), np.float32(math.sin(angle))
        for side in range(2):
            for k in range(256):
                dx = np.rint(pattern_x[side, k] * a - pattern_y[side, k] * b)
                dy = np.rint(pattern_x[side, k] * b + pattern_y[side, k] * a)
                places[side, k] = np.int32(dy) * stride + np.int32(dx)
        centre = rows[i] * np.int64(stride) + columns[i]
        for byte in range(32):
            bits = 0
            for bit in range(8):
                k = 8 * byte + bit
                if pixels[centre + places[0, k]] < pixels[centre + places[1, k]]:
                    bits |= 1 << bit
            out[i, byte] = bits
