# SPDX-License-Identifier: MIT
"""Stamps of scans and odometry that increase, whatever their clocks did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.trajectory.wheel_odometry import WheelOdometry, smooth_stamps

BAD_CLOCK = 0.01
"""Share of backward stamps from which on a clock is not believed."""


def align_clocks(
    scans_ns: NDArray[np.int64],
    odometry_ns: NDArray[np.int64],
    places: NDArray[np.int64],
    odometry_poses: NDArray[np.float64],
) -> tuple[NDArray[np.int64], WheelOdometry, bool]:
    """Return increasing stamps of the scans, the odometry with increasing stamps, and whether the recorded order decided.

    Where a clock runs backwards again and again its stamps do not tell what came first; the recorded order does.

    Parameters
    ----------
    scans_ns, odometry_ns : int64 (N,) and (M,), stamps in recorded order.
    places : int64 (M,), how many scans were recorded before each odometry message.
    odometry_poses : float64 (M, 3).
    """
    if max(_share_backward(scans_ns), _share_backward(odometry_ns)) < BAD_CLOCK:
        return smooth_stamps(scans_ns), WheelOdometry(smooth_stamps(odometry_ns), odometry_poses), False
    both = smooth_stamps(np.insert(scans_ns, places, odometry_ns))
    is_odometry = np.insert(np.zeros(len(scans_ns), np.bool_), places, True)
    return both[~is_odometry], WheelOdometry(both[is_odometry], odometry_poses), True


def _share_backward(stamps_ns: NDArray[np.int64]) -> float:
    return float((np.diff(stamps_ns) < 0).mean()) if len(stamps_ns) > 1 else 0.0
