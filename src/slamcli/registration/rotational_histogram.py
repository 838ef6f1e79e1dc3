# SPDX-License-Identifier: MIT
"""Which way the walls of a cloud run, as a histogram, and by which rotation one such histogram fits another.

This is the filter that Cartographer puts before its 3D branch and bound (``rotational_scan_matcher``): few yaws are worth a
search. Directions are taken modulo half a turn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.registration import _rotation_kernels as kernels

SLICE_M = 0.2
"""Height of the slices in which successive points are looked for."""


def rotational_histogram(points_m: NDArray[np.float64], size: int) -> NDArray[np.float32]:
    """Return float32 (size,): weight by direction, 0 to pi, of the walls among points (N, 3), metres, z up.

    In each slice of height the points are sorted by their angle about the slice's centroid; the direction from one point to
    the next counts if they are 0.2 to 0.9 m apart, the more the more it crosses the line of sight from the centroid.
    """
    histogram = np.zeros(size)
    if len(points_m):
        layers = np.floor(points_m[:, 2] / SLICE_M + 0.5).astype(np.int64)
        by_layer = np.argsort(layers, kind="stable")
        ends = np.append(np.flatnonzero(np.diff(layers[by_layer])) + 1, len(by_layer))
        kernels.add_slices(np.ascontiguousarray(points_m, dtype=np.float64), by_layer, ends, histogram)
    return histogram.astype(np.float32)


def rotate_histogram(histogram: NDArray[np.float32], angle_rad: float) -> NDArray[np.float32]:
    """Return the histogram of the same points turned about z by `angle_rad`."""
    out = np.empty(len(histogram))
    kernels.rotated(histogram.astype(np.float64), float(angle_rad), out)
    return out.astype(np.float32)


def rotation_scores(
    submap: NDArray[np.float32], cloud: NDArray[np.float32], angles_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how well a cloud's histogram, turned by each of the angles (K,), fits a submap's: 0 to 1, (K,)."""
    out = np.empty(len(angles_rad))
    kernels.scores(submap.astype(np.float64), cloud.astype(np.float64), angles_rad, out)
    return out


def warm() -> None:
    """Compile the kernels of this module."""
    points = np.array([[1.0, 0, 0], [0.9, 0.4, 0], [0.0, 1.0, 0], [-1.0, 0, 0]])
    histogram = rotational_histogram(points, 8)
    rotation_scores(histogram, rotate_histogram(histogram, 0.1), np.zeros(1))
