# SPDX-License-Identifier: MIT
"""Velocities that can be reached and are looked at, as base_local_planner samples them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.dwa_parameters import DwaParameters


def speeds(low: float, high: float, count: int) -> list[float]:
    """Return at least two speeds from `low` to `high`, evenly apart, and 0 if it lies between two of them.

    Examples
    --------
    >>> speeds(-0.1, 0.2, 2)
    [-0.1, 0.0, 0.2]
    >>> speeds(0.3, 0.3, 5)
    [0.3]
    """
    if low == high:
        return [low]
    count = max(2, count)
    step = (high - low) / (count - 1)
    values = []
    following = low
    for _ in range(count - 1):
        value, following = following, following + step
        values.append(value)
        if value < 0.0 < following:
            values.append(0.0)
    return [*values, high]


def sample_velocities(
    parameters: DwaParameters, twist: NDArray[np.float64], goal_distance_m: float, period_s: float
) -> NDArray[np.float64]:
    """Return float64 (S, 3), velocities to look at: vx and vy, m/s, turn, rad/s; the turn varies fastest.

    With use_dwa those that acceleration reaches within one period from the measured `twist` (3,), otherwise within
    sim_time, and not faster than gets to the goal in that time. A measured velocity outside the limits is taken as the
    limit that it exceeds.
    """
    reach = period_s if parameters.use_dwa else parameters.sim_time
    fastest = math.inf if parameters.use_dwa else goal_distance_m / parameters.sim_time
    low = np.array([parameters.min_vel_x, parameters.min_vel_y, -parameters.max_vel_theta])
    high = np.array([parameters.max_vel_x, parameters.max_vel_y, parameters.max_vel_theta])
    high[:2] = np.maximum(np.minimum(high[:2], fastest), low[:2])
    now = np.clip(twist, low, high)
    step = reach * np.array([parameters.acc_lim_x, parameters.acc_lim_y, parameters.acc_lim_theta])
    least, most = np.maximum(low, now - step), np.minimum(high, now + step)
    x = speeds(least[0], most[0], parameters.vx_samples)
    y = speeds(least[1], most[1], parameters.vy_samples)
    turn = speeds(least[2], most[2], parameters.vth_samples)
    samples = np.empty((len(x) * len(y) * len(turn), 3))
    samples[:, 0] = np.repeat(x, len(y) * len(turn))
    samples[:, 1] = np.tile(np.repeat(y, len(turn)), len(x))
    samples[:, 2] = np.tile(turn, len(x) * len(y))
    return np.vstack([samples, _turns(parameters, least, most)])


def _turns(parameters: DwaParameters, least: NDArray[np.float64], most: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the turns in place at min_vel_theta that acceleration alone would leave out."""
    rate = parameters.min_vel_theta
    stands = bool((least[:2] <= 0.0).all() and (most[:2] >= 0.0).all())
    if not parameters.turn_in_place or not stands or rate > parameters.max_vel_theta:
        return np.empty((0, 3))
    return np.array(
        [[0.0, 0.0, w] for w, missing in ((rate, most[2] < rate), (-rate, least[2] > -rate)) if missing]
    ).reshape(-1, 3)
