# SPDX-License-Identifier: MIT
"""What odometry hands to the memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.signature import NodeImages, NodeScan
from slamcli.vision.features import Features


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OdometryStep:
    """How the robot moved up to a frame or scan."""

    stamp_ns: int
    T_odom_base: NDArray[np.float64] | None
    """float64 (4, 4), pose in the odometry's frame; None: lost."""
    covariance: NDArray[np.float64]
    """float64 (6, 6), of the motion since the previous step (m^2, rad^2; translation before rotation vector); zeros for the first."""
    adds_up: bool = True
    """Whether `covariance` adds to those of the steps before; if not, the pose was measured in a map that those steps left as it
    was, and it is all that is unknown since the last step that did add up."""
    began_anew: bool = False
    """Whether the odometry began anew here: the pose says nothing about where the robot is beside earlier ones."""
    num_features: int = 0
    """Key points of the frame, or points of the scan."""
    num_inliers: int = 0
    """Of them, those that the motion explains."""
    keyframe: bool = False
    """Whether the local map took it in."""
    carried: bool = False
    """Whether own odometry was lost here, and the pose is that of the recording's odometry."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NodeInput:
    """What may become a node: all sensors at one moment."""

    stamp_ns: int
    T_odom_base: NDArray[np.float64]
    """float64 (4, 4), by odometry."""
    covariance: NDArray[np.float64]
    """float64 (6, 6), of the motion since the previous `NodeInput` of this session (as `OdometryStep`)."""
    began_anew: bool
    """Whether a new map begins here: the first input, or the odometry was lost in between."""
    features: Features
    """By response; none for a robot without cameras."""
    points: NDArray[np.float64]
    """float64 (N, 3), metres, base frame; NaN where unknown."""
    scan: NodeScan | None = None
    images: NodeImages | None = None
    """Written to the database, then forgotten."""
    R_level_base: NDArray[np.float64] | None = None
    """float64 (3, 3), how the base is held against gravity (its heading means nothing); None without an IMU."""
