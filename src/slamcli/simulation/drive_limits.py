# SPDX-License-Identifier: MIT
"""Settings of the drive and of odometry in the order in which `_plant_kernels` reads them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation.parameters import SimulationParameters

Array = NDArray[np.float64]


def drive_limits(p: SimulationParameters) -> Array:
    """Return float64 (12,): kind of drive, top speeds, accelerations, a car's geometry (radians), timeout of commands."""
    kind = float(("diff", "omni", "car").index(p.robot_drive))
    return np.array(
        [
            kind, p.robot_max_forward, p.robot_max_backward, p.robot_max_sideways, p.robot_max_turn,
            p.robot_forward_acceleration, p.robot_sideways_acceleration, p.robot_swing_acceleration, p.robot_wheelbase,
            math.radians(p.robot_max_steering), math.radians(p.robot_steering_rate), p.robot_command_timeout,
        ]
    )  # fmt: skip


def odometry_errors(p: SimulationParameters, tick_s: float) -> Array:
    """Return float64 (13,): noise, scales and pull of odometry, shares told in slip, and how slip comes and goes."""
    return np.array(
        [
            p.odometry_srr, p.odometry_srt, p.odometry_str, p.odometry_stt, p.odometry_distance_scale,
            p.odometry_turn_scale, p.odometry_pull, p.slip_turn_share, p.slip_distance_share,
            p.slip_rate / 60.0 * tick_s, p.slip_seconds / tick_s, p.slip_drift, p.slip_drift_time,
        ]
    )  # fmt: skip
