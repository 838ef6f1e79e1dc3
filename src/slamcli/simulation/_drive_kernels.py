# SPDX-License-Identifier: MIT
"""Kernel: a differential drive robot that follows a path within its limits."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True)
def follow(
    path: Floats,
    caps: Floats,
    limits: tuple[float, float, float, float, float],
    rest_ticks: int,
    spare_ticks: int,
    tick_s: float,
    states: Floats,
) -> int:
    """Fill `states` (T, 5) x, y, yaw (unwrapped), speed, turn rate, and return how many ticks the way took.

    `path` (N, 2) has points a constant step apart, `caps` (N,) the speeds that coming corners allow there; `limits` are speed, acceleration, turn rate, turn acceleration and
    the number of points that the robot aims ahead. It starts at `states[0]`, rests for `rest_ticks`, turns towards a
    point ahead on the path, slower the farther it must turn, and stops at the end; `spare_ticks` more are filled then.
    """
    top_speed, acceleration, top_turn, turn_acceleration, ahead = limits
    look = np.int64(ahead)
    count, last = states.shape[0], path.shape[0] - 1
    progress, finished = 0, -1
    for k in range(1, count):
        x, y, yaw, speed, turn = states[k - 1]
        progress = _progress(path, progress, look, x, y)
        left = math.hypot(path[last, 0] - x, path[last, 1] - y)
        if finished < 0 and progress >= last - 1 and (left < 0.02 or (speed < 0.01 and left < 0.1)):
            finished = k
        wanted_speed, wanted_turn = 0.0, 0.0
        if k > rest_ticks and finished < 0:
            target = min(progress + look, last)
            error = math.atan2(path[target, 1] - y, path[target, 0] - x) - yaw
            error = math.atan2(math.sin(error), math.cos(error))
            quickest = min(top_turn, math.sqrt(2.0 * 0.7 * turn_acceleration * abs(error)), 3.0 * abs(error))
            wanted_turn = math.copysign(quickest, error)
            if abs(error) < 1.0:
                wanted_speed = min(top_speed, caps[progress]) * math.cos(min(1.5 * abs(error), 0.5 * math.pi))
            rest_way = left + (last - target) * math.hypot(path[1, 0] - path[0, 0], path[1, 1] - path[0, 1])
            wanted_speed = min(wanted_speed, math.sqrt(2.0 * 0.8 * acceleration * max(rest_way, 0.0)) + 0.005)
        change = acceleration * tick_s
        speed += min(max(wanted_speed - speed, -change), change)
        change = turn_acceleration * tick_s
        turn += min(max(wanted_turn - turn, -change), change)
        middle = yaw + 0.5 * turn * tick_s
        states[k, 0] = x + speed * tick_s * math.cos(middle)
        states[k, 1] = y + speed * tick_s * math.sin(middle)
        states[k, 2] = yaw + turn * tick_s
        states[k, 3] = speed
        states[k, 4] = turn
        if finished >= 0 and k - finished >= spare_ticks:
            return k + 1
    return count if finished >= 0 else -count


@njit(cache=True)
def _progress(path: Floats, progress: int, look: int, x: float, y: float) -> int:
    """Index of the nearest path point from `progress` to twice `look` further; the later of equal ones."""
    best, nearest = progress, 1e300
    for i in range(progress, min(progress + 2 * look, path.shape[0])):
        distance = (path[i, 0] - x) ** 2 + (path[i, 1] - y) ** 2
        if distance <= nearest + 1e-9:
            best, nearest = i, distance
    return best
