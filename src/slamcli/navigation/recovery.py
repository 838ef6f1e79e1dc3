# SPDX-License-Identifier: MIT
"""Recovery behaviours: what move_base tries when no plan or no command can be found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry.se2 import wrap_angle
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.footprint_check import is_blocked
from slamcli.navigation.move_base_parameters import (
    DEFAULT_RESET_DISTANCE_M,
    MoveBaseParameters,
    RecoveryParameters,
)
from slamcli.navigation.recovery_list import parse_behaviours
from slamcli.navigation.robot_state import RobotState

Array = NDArray[np.float64]


class ClearableCostmap(Protocol):
    """What recoveries need of a costmap."""

    def window(self) -> CostWindow:
        """Return what planners see."""

    def out_of_date(self, time_s: float) -> tuple[str, ...]:
        """Return the sources that have not been heard of for too long."""

    def clear_outside(self, pose: Array, half_width_m: float, layer_names: tuple[str, ...]) -> object:
        """Forget what the named layers hold outside a square around the robot."""

    def clear_inside(self, pose: Array, half_width_m: float, layer_names: tuple[str, ...]) -> object:
        """Forget what they hold inside it."""


class Costmaps(Protocol):
    """Both costmaps of move_base."""

    @property
    def world(self) -> ClearableCostmap:
        """In the map frame."""

    @property
    def local(self) -> ClearableCostmap:
        """In the odometry frame."""


class Recovery(Protocol):
    """One behaviour; it is begun, and then asked for velocities until it has none."""

    name: str

    def begin(self, state: RobotState) -> None:
        """Start anew."""

    def step(self, state: RobotState) -> Array | None:
        """Return the next velocity (3,), or None when the behaviour has ended."""


class ClearCostmaps:
    """Forgets obstacles outside a square of side `width_m` around the robot: ``clear_costmap_recovery``."""

    def __init__(self, name: str, costmaps: Costmaps, width_m: float, parameters: RecoveryParameters) -> None:
        self.name = name
        self._costmaps, self._half_width_m, self._parameters = costmaps, width_m / 2.0, parameters
        self._layers = tuple(parameters.layer_names.replace(",", " ").split())

    def begin(self, state: RobotState) -> None:
        """Clear at once."""
        p = self._parameters
        for kind, costmap, pose in (
            ("global", self._costmaps.world, state.pose_map),
            ("local", self._costmaps.local, state.pose_odom),
        ):
            if p.affected_maps in ("both", kind):
                clear = costmap.clear_inside if p.invert_area_to_clear else costmap.clear_outside
                clear(pose, self._half_width_m, self._layers)

    def step(self, state: RobotState) -> Array | None:  # noqa: ARG002
        """End."""
        return None


class RotateInPlace:
    """Turns once round to the left, as long as nothing is in the way: ``rotate_recovery``."""

    def __init__(self, name: str, costmaps: Costmaps, parameters: RecoveryParameters) -> None:
        self.name = name
        self._costmaps, self._parameters = costmaps, parameters
        self._last_yaw, self._turned = 0.0, 0.0

    def begin(self, state: RobotState) -> None:
        """Remember where the turn begins."""
        self._last_yaw, self._turned = float(state.pose_odom[2]), 0.0

    def step(self, state: RobotState) -> Array | None:
        """Return the turn, braked so that it ends at a full circle; None at its end, or if the robot would hit something."""
        p = self._parameters
        yaw = float(state.pose_odom[2])
        self._turned += float(wrap_angle(yaw - self._last_yaw))
        self._last_yaw = yaw
        left = 2.0 * math.pi - self._turned
        if left <= p.rotate_yaw_goal_tolerance:
            return None
        ahead = np.arange(0.0, left, p.sim_granularity)
        poses = np.column_stack([np.broadcast_to(state.pose_odom[:2], (len(ahead), 2)), yaw + ahead])
        if is_blocked(self._costmaps.local.window(), poses).any():
            return None
        speed = math.sqrt(2.0 * p.rotate_acc_lim_theta * left)
        speed = min(max(speed, p.min_in_place_rotational_vel), p.max_rotational_vel)
        return np.array([0.0, 0.0, speed])


class BackUp:
    """Drives straight back, as far as it is free there; nav2's ``backup``."""

    def __init__(self, name: str, costmaps: Costmaps, parameters: RecoveryParameters) -> None:
        self.name = name
        self._costmaps, self._parameters = costmaps, parameters
        self._from = np.zeros(2)

    def begin(self, state: RobotState) -> None:
        """Remember where it begins."""
        self._from = state.pose_odom[:2].copy()

    def step(self, state: RobotState) -> Array | None:
        """Return the velocity backwards; None at the end, or if something is behind the robot."""
        p = self._parameters
        left = p.backup_distance - float(np.hypot(*(state.pose_odom[:2] - self._from)))
        if left <= 0.0:
            return None
        window = self._costmaps.local.window()
        reach = min(left, p.backup_speed)  # a second ahead
        back = np.arange(1, max(math.ceil(reach / (0.5 * window.resolution_m)), 1) + 1) * 0.5 * window.resolution_m
        yaw = float(state.pose_odom[2])
        direction = np.array([math.cos(yaw), math.sin(yaw)])
        poses = np.column_stack([state.pose_odom[:2] - back[:, None] * direction, np.full(len(back), yaw)])
        if is_blocked(window, poses).any():
            return None
        return np.array([-p.backup_speed, 0.0, 0.0])


class MoveSlowAndClear:
    """Forgets obstacles close by and lets the robot go slowly for a stretch: ``move_slow_and_clear``.

    move_base asks `limit` for every command from then on.
    """

    def __init__(self, name: str, costmaps: Costmaps, parameters: RecoveryParameters) -> None:
        self.name = name
        self._costmaps, self._parameters = costmaps, parameters
        self._from: Array | None = None

    def begin(self, state: RobotState) -> None:
        """Clear, and slow down from here on."""
        p = self._parameters
        layers = tuple(p.layer_names.replace(",", " ").split())
        self._costmaps.world.clear_inside(state.pose_map, p.clearing_distance, layers)
        self._costmaps.local.clear_inside(state.pose_odom, p.clearing_distance, layers)
        self._from = state.pose_odom[:2].copy()

    def step(self, state: RobotState) -> Array | None:  # noqa: ARG002
        """End."""
        return None

    def limit(self, state: RobotState, twist: Array) -> Array:
        """Return `twist` (3,), scaled down as long as the limits hold."""
        p = self._parameters
        if self._from is None:
            return twist
        if float(np.hypot(*(state.pose_odom[:2] - self._from))) >= p.limited_distance:
            self._from = None
            return twist
        speed, turn = float(np.hypot(twist[0], twist[1])), abs(float(twist[2]))
        scale = min(1.0, p.limited_trans_speed / max(speed, 1e-9), p.limited_rot_speed / max(turn, 1e-9))
        return twist * scale


def build_recoveries(
    move_base: MoveBaseParameters,
    parameters: RecoveryParameters,
    costmaps: Costmaps,
    circumscribed_radius_m: float,
    own: Mapping[str, RecoveryParameters] | None = None,
) -> tuple[Recovery, ...]:
    """Return the behaviours that ``recovery_behaviors`` names, in its order.

    Parameters
    ----------
    move_base, parameters
        What holds for all of them.
    costmaps
        What they look at and clear.
    circumscribed_radius_m
        Of the robot.
    own
        Parameters of behaviours by name, instead of `parameters`.

    Raises
    ------
    ConfigError
        If one is unknown.
    """
    usual_widths = {
        "conservative_reset": move_base.conservative_reset_dist,
        "aggressive_reset": 4.0 * circumscribed_radius_m,
    }
    found: list[Recovery] = []
    for behaviour in parse_behaviours(move_base.recovery_behaviors):
        name, its = behaviour.name, (own or {}).get(behaviour.name, parameters)
        if behaviour.kind == "clear_costmap":
            width = usual_widths.get(name, DEFAULT_RESET_DISTANCE_M)
            found.append(
                ClearCostmaps(name, costmaps, width if its.reset_distance is None else its.reset_distance, its)
            )
        elif behaviour.kind == "rotate_recovery":
            if move_base.clearing_rotation_allowed:
                found.append(RotateInPlace(name, costmaps, its))
        elif behaviour.kind == "back_up":
            found.append(BackUp(name, costmaps, its))
        else:
            found.append(MoveSlowAndClear(name, costmaps, its))
    return tuple(found)
