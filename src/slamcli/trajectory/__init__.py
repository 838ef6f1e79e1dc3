# SPDX-License-Identifier: MIT
"""Time-stamped poses, their association and resampling."""

from slamcli.trajectory.trajectory import Trajectory

__all__ = ["Trajectory"]
