# SPDX-License-Identifier: MIT
"""What the wheels tell: the true motion with noise, systematic errors and episodes of slip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.simulation.drive import Motion
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.ride import Ride

Array = NDArray[np.float64]


def wheel_poses(
    ride: Ride, times_s: Array, slips_s: Array, parameters: SimulationParameters, rng: np.random.Generator
) -> Array:
    """Return the pose that odometry tells, (N, 3) x, y, yaw in its own frame, which starts at zero.

    Each step's true motion is scaled (`odometry.*_scale`, in slip `slip.*_share`) and gets independent normal errors:
    in distance of variance srr^2 d + str^2 |a|, in heading of variance srt^2 d + stt^2 |a|, for d metres and a radians
    of true motion. Sideways the wheels tell nothing wrong but what follows from the heading.

    Parameters
    ----------
    ride
        What truly happened; on a slope wheels roll the way along it.
    times_s
        float64 (N,), when odometry is measured, seconds from the start, rising.
    slips_s
        float64 (M, 2), begin and end of episodes of slip.
    parameters
        The noise.
    rng
        Its draws.
    """
    true_poses = ride.motion.at(times_s)
    steps = se2.between(true_poses[:-1], true_poses[1:])
    if not ride.is_level:
        steps[:, :2] *= ride.stretch(times_s)[:, None]
    distance, turn = np.hypot(steps[:, 0], steps[:, 1]), np.diff(true_poses[:, 2])
    p = parameters
    middle = (times_s[:-1] + times_s[1:]) / 2
    slipping = ((middle[:, None] >= slips_s[:, 0]) & (middle[:, None] < slips_s[:, 1])).any(axis=1)
    draws = rng.standard_normal((len(steps), 2))
    told_distance_scale = p.odometry_distance_scale * np.where(slipping, p.slip_distance_share, 1.0)
    told_turn_scale = p.odometry_turn_scale * np.where(slipping, p.slip_turn_share, 1.0)
    distance_sigma = np.sqrt(p.odometry_srr**2 * distance + p.odometry_str**2 * np.abs(turn))
    turn_sigma = np.sqrt(p.odometry_srt**2 * distance + p.odometry_stt**2 * np.abs(turn))
    told = steps[:, :2] * told_distance_scale[:, None]
    told[:, 0] += draws[:, 0] * distance_sigma
    told_turn = turn * told_turn_scale + p.odometry_pull * distance + draws[:, 1] * turn_sigma
    yaw = np.concatenate([[0.0], np.cumsum(told_turn)])
    c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    moved = np.column_stack([c * told[:, 0] - s * told[:, 1], s * told[:, 0] + c * told[:, 1]])
    position = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return np.column_stack([position, yaw])


def slip_episodes(motion: Motion, parameters: SimulationParameters, rng: np.random.Generator) -> Array:
    """Return begin and end (M, 2), seconds, of `slip.count` episodes, placed where the robot turns most, never overlapping.

    Fewer are returned where no more fit.
    """
    half = parameters.slip_seconds / 2
    times = np.arange(half, max(motion.duration_s - half, half + 1e-9), 0.1)
    weight = np.abs(motion.speeds_at(times)[:, 1]) + 1e-6
    centres: list[float] = []
    for _ in range(parameters.slip_count):
        if weight.sum() <= 0:
            break
        centre = float(rng.choice(times, p=weight / weight.sum()))
        centres.append(centre)
        weight = np.where(np.abs(times - centre) < 2 * half, 0.0, weight)
    middle = np.sort(np.array(centres))
    return np.column_stack([middle - half, middle + half])
