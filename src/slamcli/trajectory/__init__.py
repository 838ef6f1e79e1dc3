# SPDX-License-Identifier: MIT
"""Time-stamped poses, their association and resampling."""

from slamcli.trajectory.association import Matched, associate, match_stamps
from slamcli.trajectory.resampling import crop_time, downsample, interpolate, motion_filter, path_lengths
from slamcli.trajectory.trajectory import Trajectory, seconds

__all__ = [
    "Matched",
    "Trajectory",
    "associate",
    "crop_time",
    "downsample",
    "interpolate",
    "match_stamps",
    "motion_filter",
    "path_lengths",
    "seconds",
]
