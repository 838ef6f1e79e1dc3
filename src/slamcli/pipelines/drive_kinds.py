# SPDX-License-Identifier: MIT
"""What the kind of drive (`robot.drive`) means for planners, controllers and recoveries."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from slamcli.errors import UsageError
from slamcli.navigation.local_planners import LOCAL_PLANNERS
from slamcli.navigation.move_base_parameters import MoveBaseParameters
from slamcli.navigation.pursuit_parameters import PursuitParameters
from slamcli.navigation.teb import TebParameters
from slamcli.pipelines.navigation_config import NavigationConfig
from slamcli.runtime import RunLog
from slamcli.simulation import SimulationParameters

CAR_RECOVERIES = "conservative_reset back_up aggressive_reset back_up"
"""What a car tries that cannot turn in place, unless files say otherwise."""

_SPARE = 1.1
"""Planned curves are so much wider than the tightest: a controller needs room for corrections."""
_CAR_LOOKAHEAD_M = 0.4
_MOST_STATES = 60_000
"""Of hybrid A* while the robot stands and waits for it: below a second."""


def fit_to_drive(config: NavigationConfig, robot: SimulationParameters, log: RunLog) -> NavigationConfig:
    """Return the configuration with what follows from the robot's drive where nothing was given.

    Raises
    ------
    UsageError
        If the local planner cannot drive such a robot.
    """
    if robot.robot_drive == "car":
        return _fit_to_car(config, robot, log)
    if robot.robot_drive == "omni" and not getattr(_limits(config), "max_vel_y", 0.0):
        section = LOCAL_PLANNERS[config.local_planner].section
        log.note(f"robot.drive=omni, but {section} never drives sideways: its max_vel_y is 0 or it has none")
    return config


def _limits(config: NavigationConfig) -> Any:
    rules = config.local_parameters
    return rules.robot if isinstance(rules, TebParameters) else rules


def _fit_to_car(config: NavigationConfig, robot: SimulationParameters, log: RunLog) -> NavigationConfig:
    if config.local_planner == "dwa":
        raise UsageError(
            "robot.drive=car: DWA turns in place, which a car cannot: --local-planner teb, or pursuit; best with"
            " --global-planner hybrid_astar"
        )
    radius, why = _turning_radius(config, robot)
    log.note(f"turning radius {radius:.3g} m: {why}")
    if config.global_planner != "hybrid_astar":
        log.note(f"a car may not be able to follow plans of {config.global_planner}: --global-planner hybrid_astar")
    hybrid = config.planner.hybrid
    if "planner.max_iterations" not in config.sources:
        hybrid = replace(hybrid, max_iterations=_MOST_STATES)
    return replace(
        config,
        planner=replace(config.planner, hybrid=replace(hybrid, minimum_turning_radius=radius)),
        local_parameters=_steered(config, robot, radius),
        move_base=_recoveries(config, log),
    )


def _turning_radius(config: NavigationConfig, robot: SimulationParameters) -> tuple[float, str]:
    """Return the radius of the tightest curve that is planned, metres, and where it comes from."""
    tightest = robot.robot_wheelbase / math.tan(math.radians(robot.robot_max_steering))
    rules = config.local_parameters
    if "planner.minimum_turning_radius" in config.sources:
        radius, why = config.planner.hybrid.minimum_turning_radius, "the planner's minimum_turning_radius"
    elif isinstance(rules, TebParameters) and rules.robot.min_turning_radius > 0.0:
        radius, why = rules.robot.min_turning_radius, "TebLocalPlannerROS/min_turning_radius"
    else:
        radius, why = _SPARE * tightest, f"{_SPARE:g} times what robot.wheelbase and robot.max_steering allow"
    if radius < tightest:
        why += f"; the robot itself cannot turn within less than {tightest:.3g} m"
    return radius, why


def _steered(config: NavigationConfig, robot: SimulationParameters, radius: float) -> Any:
    """Return the local planner's parameters for a car."""
    rules, given = config.local_parameters, config.sources
    section = LOCAL_PLANNERS[config.local_planner].section

    def open_only(**values: Any) -> dict[str, Any]:
        return {name: value for name, value in values.items() if f"{section}.{name}" not in given}

    if isinstance(rules, TebParameters):
        headed = open_only(global_plan_overwrite_orientation=False, allow_init_with_backwards_motion=True)
        wheels = open_only(min_turning_radius=radius, wheelbase=robot.robot_wheelbase)
        return replace(rules, trajectory=replace(rules.trajectory, **headed), robot=replace(rules.robot, **wheels))
    if isinstance(rules, PursuitParameters):
        own = open_only(
            min_turning_radius=radius / _SPARE, allow_reversing=True, use_rotate_to_heading=False,
            lookahead_dist=_CAR_LOOKAHEAD_M,
        )  # fmt: skip
        return replace(rules, **own)
    return rules


def _recoveries(config: NavigationConfig, log: RunLog) -> MoveBaseParameters:
    """Return move_base's parameters without turning in place."""
    rules = config.move_base
    if "move_base.recovery_behaviors" not in config.sources:
        log.note(f"recovery_behaviors of a car: {CAR_RECOVERIES}")
        return replace(rules, recovery_behaviors=CAR_RECOVERIES)
    if rules.clearing_rotation_allowed:
        log.note("a car cannot turn in place: rotate_recovery is left out")
    return replace(rules, clearing_rotation_allowed=False)
