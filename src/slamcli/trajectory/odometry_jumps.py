# SPDX-License-Identifier: MIT
"""Odometry freed of steps that no robot makes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.runtime import RunLog

_MAX_SPEED_M_S = 20.0


def without_jumps(stamps_ns: NDArray[np.int64], poses: NDArray[np.float64], log: RunLog) -> NDArray[np.float64]:
    """Return odometry (N, 3) from which steps that no robot makes are taken out: a reset, or a correction from outside.

    Parameters
    ----------
    stamps_ns : int64 (N,), in recorded order.
    poses : float64 (N, 3), x, y in metres, yaw in radians.
    log : gets a warning and a count where there are any.
    """
    steps = se2.between(poses[:-1], poses[1:])
    seconds = np.maximum(np.abs(np.diff(stamps_ns)) / 1e9, 0.05)
    jumps = np.flatnonzero(np.hypot(steps[:, 0], steps[:, 1]) > np.maximum(_MAX_SPEED_M_S * seconds, 1.0))
    if len(jumps) == 0:
        return poses
    log.warn(
        f"the odometry jumps {len(jumps)} times, first by {float(np.hypot(*steps[jumps[0], :2])):.1f} m at {stamps_ns[jumps[0] + 1] / 1e9:.3f} s: "
        "these steps are left out"
    )
    log.counts["jumps of the odometry"] += len(jumps)
    steps[jumps] = 0.0
    return se2.integrate(poses[0], steps)
