# SPDX-License-Identifier: MIT
"""The numbers that the optimiser's kernel takes, in its order."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.teb.parameters import TebParameters
from slamcli.navigation.teb.robot_outline import RobotOutline

Array = NDArray[np.float64]

SETTINGS = (
    *("max_vel_x", "max_vel_x_backwards", "max_vel_y", "max_vel_trans", "max_vel_theta"),
    *("acc_lim_x", "acc_lim_y", "acc_lim_theta", "min_turning_radius", "penalty_epsilon"),
    *("weight_max_vel_x", "weight_max_vel_y", "weight_max_vel_theta"),
    *("weight_acc_lim_x", "weight_acc_lim_y", "weight_acc_lim_theta"),
    *("weight_kinematics_nh", "weight_kinematics_forward_drive", "weight_kinematics_turning_radius"),
    *("weight_optimaltime", "weight_shortest_path", "weight_obstacle", "weight_inflation"),
    *("weight_dynamic_obstacle", "weight_dynamic_obstacle_inflation", "weight_velocity_obstacle_ratio"),
    *("weight_viapoint", "weight_prefer_rotdir", "min_obstacle_dist", "inflation_dist"),
    *("dynamic_obstacle_inflation_dist", "obstacle_cost_exponent", "obstacle_proximity_ratio_max_vel"),
    *("obstacle_proximity_lower_bound", "obstacle_proximity_upper_bound"),
    *("start_vx", "start_vy", "start_vtheta", "free_goal_vel", "prefer_rotdir"),
    *("holonomic", "exact_arc_length", "carlike", "circumscribed_radius"),
)
_AUTO_MIN_DIST_M, _POINT_MIN_DIST_M = 0.1, 0.5
_ROOM_MARGIN_M = 0.02
_AUTO_INFLATION_M, _POINT_INFLATION_M = 0.35, 0.6


def settings_vector(
    parameters: TebParameters, outline: RobotOutline, start_twist: Array, turning: int, room_m: float = float("inf")
) -> Array:
    """Return the numbers that the kernel wants, in its order; `room_m` as of `BandOptimiser`."""
    groups = (parameters.robot, parameters.optimisation, parameters.obstacles, parameters.goal)
    values: dict[str, Any] = {field.name: getattr(group, field.name) for group in groups for field in fields(group)}
    auto = parameters.footprint_model.type == "auto"
    robot = parameters.robot
    values |= {
        "start_vx": start_twist[0],
        "start_vy": start_twist[1],
        "start_vtheta": start_twist[2],
        "prefer_rotdir": turning,
        "holonomic": robot.max_vel_y > 0.0,
        "exact_arc_length": parameters.trajectory.exact_arc_length,
        "carlike": robot.min_turning_radius > 0.0 and parameters.optimisation.weight_kinematics_turning_radius > 0.0,
        "circumscribed_radius": outline.radius_m,
        "max_vel_trans": robot.max_vel_trans or robot.max_vel_x,
    }
    if values["min_obstacle_dist"] is None:
        spare = room_m - _ROOM_MARGIN_M - parameters.optimisation.penalty_epsilon
        least = -parameters.optimisation.penalty_epsilon
        values["min_obstacle_dist"] = max(least, min(_AUTO_MIN_DIST_M, spare)) if auto else _POINT_MIN_DIST_M
    if values["inflation_dist"] is None:
        values["inflation_dist"] = _AUTO_INFLATION_M if auto else _POINT_INFLATION_M
    return np.array([float(values[name]) for name in SETTINGS])
