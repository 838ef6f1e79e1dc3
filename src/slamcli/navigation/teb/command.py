# SPDX-License-Identifier: MIT
"""From a timed elastic band to what the robot is told."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.teb.band import Band
from slamcli.navigation.teb.parameters import RobotParameters, TebParameters

Array = NDArray[np.float64]
_STRAIGHT = 1e-9


def first_twist(band: Band, parameters: TebParameters) -> Array:
    """Return float64 (3,), the mean velocity from the first pose of a band to the one ``control_look_ahead_poses`` later.

    That pose is no nearer to the end than ``prevent_look_ahead_poses_near_goal``, and no later than as many reference
    times.
    """
    rules = parameters.trajectory
    last = len(band.poses) - 1
    ahead = max(1, min(rules.control_look_ahead_poses, last - rules.prevent_look_ahead_poses_near_goal))
    time, k = 0.0, 0
    while k < ahead and k < last:
        time += float(band.dts[k])
        k += 1
        if time >= rules.dt_ref * ahead:
            break
    step = se2.between(band.poses[0], band.poses[k])
    if parameters.robot.max_vel_y > 0.0:
        middle = 0.5 * step[2]  # the frame turns meanwhile
        c, s = np.cos(middle), np.sin(middle)
        return np.array([c * step[0] + s * step[1], c * step[1] - s * step[0], step[2]]) / time
    return np.array([np.copysign(np.hypot(step[0], step[1]), step[0]), 0.0, step[2]]) / time


def saturated(twist: Array, robot: RobotParameters) -> Array:
    """Return the velocity within the robot's bounds, which the optimiser keeps only nearly."""
    vx, vy, turn = twist
    ratio_x = _ratio(vx, robot.max_vel_x if vx > 0.0 else robot.max_vel_x_backwards)
    ratio_y = _ratio(vy, robot.max_vel_y) if robot.max_vel_y > 0.0 else 1.0
    ratio_turn = _ratio(turn, robot.max_vel_theta)
    if robot.use_proportional_saturation:
        ratio_x = ratio_y = ratio_turn = min(ratio_x, ratio_y, ratio_turn)
    bounded = np.array([vx * ratio_x, vy * ratio_y, turn * ratio_turn])
    if robot.max_vel_y > 0.0:
        bounded[:2] *= _ratio(float(np.hypot(*bounded[:2])), robot.max_vel_trans or robot.max_vel_x)
    if robot.min_turning_radius > 0.0:  # slower turning, not a tighter curve
        bound = abs(bounded[0]) / robot.min_turning_radius
        bounded[2] = np.clip(bounded[2], -bound, bound)
    return bounded


def steering(twist: Array, robot: RobotParameters) -> float:
    """Return the steering angle, radians, at which a car with this wheelbase drives a twist; 0 if it does not move."""
    if abs(twist[2]) < _STRAIGHT or abs(twist[0]) < _STRAIGHT:
        return 0.0
    radius = twist[0] / twist[2]
    if abs(radius) < robot.min_turning_radius:
        radius = np.copysign(robot.min_turning_radius, radius)
    return float(np.arctan(robot.wheelbase / radius))


def _ratio(value: float, bound: float) -> float:
    return bound / abs(value) if abs(value) > bound else 1.0
