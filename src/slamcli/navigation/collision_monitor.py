# SPDX-License-Identifier: MIT
"""The last look at a velocity before the robot gets it: slow down for what moves across its way; nav2's ``collision_monitor``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.moving_obstacles import MovingObstacles
from slamcli.parameters import parameter

Array = NDArray[np.float64]
_SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)
_STEP_S = 0.1
_HAIR_M = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class CollisionMonitorParameters:
    """When the robot slows down or stops for what moves."""

    enabled: bool = parameter(
        True, "Slow down or stop for people: for small things that the map does not have.", name="collision_monitor.enabled",
        extension=True,
    )  # fmt: skip
    time_before_collision: float = parameter(
        1.5, "How far ahead the robot looks.", name="collision_monitor.time_before_collision", unit="s", minimum=0.1,
        maximum=10.0, extension=True,
    )  # fmt: skip
    body_radius: float = parameter(
        0.25, "Least radius of what legs carry, around their middle.", name="collision_monitor.body_radius", unit="m", minimum=0.0,
        maximum=2.0, extension=True,
    )  # fmt: skip
    margin: float = parameter(
        0.1, "Distance that is kept from it.", name="collision_monitor.margin", unit="m", minimum=0.0, maximum=5.0,
        extension=True,
    )  # fmt: skip


class CollisionMonitor:
    """Limits velocities.

    Parameters
    ----------
    parameters
        When it acts.
    robot_radius_m
        Circumscribed radius of the robot.
    """

    def __init__(self, parameters: CollisionMonitorParameters, robot_radius_m: float) -> None:
        self.parameters = parameters
        self._robot_radius_m = robot_radius_m

    def limit(self, twist: Array, pose_odom: Array, around: MovingObstacles) -> Array:
        """Return the largest share of `twist` (3,) with which nothing comes too near; zeros if there is none.

        Both sides are taken to go on as they do for `time_before_collision`. Coming nearer counts, being near does not: the
        robot may always move away. Turning in place is left as it is.

        Parameters
        ----------
        twist
            float64 (3,), what is asked for.
        pose_odom
            float64 (3,).
        around
            What moves, in odom.
        """
        p = self.parameters
        speed = float(np.hypot(twist[0], twist[1]))
        if not p.enabled or not len(around.centres) or speed < 0.02:
            return twist
        needed = self._robot_radius_m + np.maximum(around.radii, p.body_radius) + p.margin
        now = np.hypot(*(around.centres - pose_odom[:2]).T)
        reach = needed + (speed + np.hypot(*around.velocities.T)) * p.time_before_collision
        if not (now < reach).any():
            return twist
        times: Array = np.arange(1.0, round(p.time_before_collision / _STEP_S) + 1.0) * _STEP_S
        theirs = around.centres + around.velocities * times[:, None, None]
        allowed = np.minimum(needed, now - _HAIR_M)
        for share in _SHARES:
            ours = _driven(pose_odom, share * twist, times)
            apart = np.hypot(*np.moveaxis(theirs - ours[:, None], 2, 0))
            if (apart >= allowed).all():
                return twist if share == 1.0 else share * twist
        return np.zeros(3)


def _driven(pose: Array, twist: Array, times: Array) -> Array:
    """Return positions (T, 2) on the arc of a constant twist (3,) at times (T,) from a pose (3,)."""
    x, y, yaw = pose
    vx, vy, turn = twist
    angle = turn * times
    if abs(turn) > 1e-6:
        along, across = np.sin(angle) / turn, (1.0 - np.cos(angle)) / turn
    else:
        along, across = times, 0.5 * turn * times**2
    dx, dy = vx * along - vy * across, vx * across + vy * along
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([x + c * dx - s * dy, y + s * dx + c * dy])
