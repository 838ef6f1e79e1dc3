# SPDX-License-Identifier: MIT
"""Where the robot is, as a controller knows it at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotState:
    """Pose and velocity of the base frame, from odometry and a localiser.

    The odometry frame moves smoothly and drifts; the map frame is where goals and global plans are, and jumps when the
    localiser changes its mind. Local planners work in the odometry frame, as the local costmap does.
    """

    time_s: float
    """Simulated seconds."""
    pose_odom: NDArray[np.float64]
    """float64 (3,): x, y (metres), yaw (radians) of base_link in odom."""
    T_map_odom: NDArray[np.float64]
    """float64 (3,): the localiser's correction."""
    twist: NDArray[np.float64]
    """float64 (3,): forward and leftward m/s and turn rad/s in the base frame, as odometry measured them."""

    @property
    def pose_map(self) -> NDArray[np.float64]:
        """float64 (3,): the pose in the map frame."""
        return se2.compose(self.T_map_odom, self.pose_odom)

    @property
    def T_odom_map(self) -> NDArray[np.float64]:  # noqa: N802 - frames as everywhere
        """float64 (3,): brings plans of the map frame into the odometry frame."""
        return se2.inverse(self.T_map_odom)
