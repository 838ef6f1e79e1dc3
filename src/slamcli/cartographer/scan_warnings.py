# SPDX-License-Identifier: MIT
"""What is said aloud of a recording whose scans do not tell how the robot moved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.registration.scan_odometry import ScanStep
from slamcli.runtime import RunLog

_UNKNOWN_M = 0.012
"""A scan that tells the position along some direction worse than this leaves it to wheels or a guess."""
_LONG_M = 5.0


def warn_of_corridors(
    stamps_ns: NDArray[np.int64],
    motions: NDArray[np.float64],
    steps: Sequence[ScanStep],
    has_odometry: bool,
    log: RunLog,
) -> None:
    """Warn where scans fit anywhere along a corridor (or a wall), and say for how long."""
    unknown = np.array([_largest_sigma(step) > _UNKNOWN_M for step in steps])
    way = np.hypot(motions[:, 0], motions[:, 1])
    lost = float(way[unknown].sum())
    if lost < _LONG_M:
        return
    first = stamps_ns[int(np.flatnonzero(unknown & (way > 0.0))[0])]
    knows = "the odometry alone tells" if has_odometry else "nothing tells, and the last speed is kept,"
    log.warn(
        f"for {lost:.0f} of {way.sum():.0f} m the scans fit anywhere along one direction (a corridor, a single wall), first at "
        f"{first / 1e9:.3f} s: there {knows} how far the robot went"
    )


def _largest_sigma(step: ScanStep) -> float:
    """Return how well the points tell the position in the direction in which they tell it worst, metres."""
    if step.information is None:
        return 0.0  # nothing was seen at all, which is another warning
    least = float(np.linalg.eigvalsh(step.information[:2, :2])[0])
    return 1.0 / np.sqrt(max(least, 1e-9))
