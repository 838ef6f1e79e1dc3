# SPDX-License-Identifier: MIT
"""The beams of one scan as matching and drawing take them, and their correction for the robot's motion during a sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import LaserScan


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """One scan in the base frame, metres."""

    points: NDArray[np.float64]
    """float64 (M, 2), end points that are matched."""
    directions: NDArray[np.float64]
    """float64 (M, 2), unit vectors of the matched beams."""
    start: NDArray[np.float64]
    """float64 (1, 2), where all beams start."""
    ends: NDArray[np.float64]
    """float64 (B, 2), where drawn beams end."""
    hit: NDArray[np.bool_]
    """bool (B,), whether a drawn beam ended at an obstacle."""


def sweep_times(scan: LaserScan) -> NDArray[np.float64]:
    """Return when each beam was measured, float64 (N,), seconds after the stamp; a negative increment is a reversed sweep."""
    order = np.arange(scan.num_beams, dtype=np.float64)
    return (order if scan.time_increment_s > 0 else order[::-1]) * abs(scan.time_increment_s)


def turned(vectors: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (N, 2) turned by angles (N,), radians."""
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]], axis=1)


def moved(points: NDArray[np.float64], times: NDArray[np.float64], twist: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 2), each seen by the base at its time, in the base at time 0; the velocity is constant."""
    return turned(points, times * twist[2]) + times[:, None] * twist[:2]
