# SPDX-License-Identifier: MIT
"""Parameters of the dynamic window approach under the names of DWAPlannerROS."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from slamcli.errors import ConfigError
from slamcli.parameters import as_dict, declarations, parameter, resolve

_SHOWS_ONLY = "Accepted; publishes pictures for RViz."

ALIASES = {
    "max_trans_vel": "max_vel_trans",
    "min_trans_vel": "min_vel_trans",
    "max_rot_vel": "max_vel_theta",
    "min_rot_vel": "min_vel_theta",
    "rot_stopped_vel": "theta_stopped_vel",
}
"""Names from before release 1.16 (kinetic and older)."""

AS_DWAPLANNERROS = {
    "follow_progress": False,
    "free_local_goal": False,
    "escape": False,
    "turn_in_place": False,
    "soft_nose": False,
    "stop_at_goal": False,
    "progress": False,
    "turn_to_plan": 0.0,
    "footprint_margin": 0.0,
    "scale_footprint": False,
}
"""Values of slamcli's own parameters that leave DWAPlannerROS as it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DwaParameters:
    """What the robot can do, how its motions are sampled, and what they cost. Defaults are those of ROS noetic."""

    max_vel_trans: float = parameter(0.55, "Highest speed.", unit="m/s", minimum=0.0, maximum=100.0)
    min_vel_trans: float = parameter(
        0.1,
        "Lowest speed: slower motions are not sampled, unless they turn at min_vel_theta or faster.",
        unit="m/s",
        minimum=0.0,
        maximum=100.0,
    )
    max_vel_x: float = parameter(0.55, "Highest forward speed.", unit="m/s", minimum=-100.0, maximum=100.0)
    min_vel_x: float = parameter(
        0.0, "Lowest forward speed; negative drives backwards.", unit="m/s", minimum=-100.0, maximum=100.0
    )
    max_vel_y: float = parameter(
        0.1, "Highest speed to the left; 0 if the robot cannot.", unit="m/s", minimum=-100.0, maximum=100.0
    )
    min_vel_y: float = parameter(
        -0.1, "Lowest speed to the left; 0 if the robot cannot.", unit="m/s", minimum=-100.0, maximum=100.0
    )
    max_vel_theta: float = parameter(1.0, "Highest turn rate.", unit="rad/s", minimum=0.0, maximum=100.0)
    min_vel_theta: float = parameter(
        0.4, "Lowest turn rate of motions slower than min_vel_trans.", unit="rad/s", minimum=0.0, maximum=100.0
    )
    acc_lim_x: float = parameter(2.5, "Greatest change of forward speed.", unit="m/s²", minimum=0.0, maximum=20.0)
    acc_lim_y: float = parameter(2.5, "Greatest change of sideways speed.", unit="m/s²", minimum=0.0, maximum=20.0)
    acc_lim_theta: float = parameter(3.2, "Greatest change of turn rate.", unit="rad/s²", minimum=0.0, maximum=20.0)
    acc_lim_trans: float = parameter(0.1, "Accepted; DWAPlannerROS ignores it, too.", unit="m/s²", effective=False)
    xy_goal_tolerance: float = parameter(
        0.1, "Distance from the goal at which it is reached.", unit="m", minimum=0.0, maximum=1000.0
    )
    yaw_goal_tolerance: float = parameter(
        0.1, "Angle from the goal's heading at which it is reached.", unit="rad", minimum=0.0, maximum=math.pi
    )
    latch_xy_goal_tolerance: bool = parameter(
        False, "Once within xy_goal_tolerance only turn, even if that moves the robot out of it."
    )
    trans_stopped_vel: float = parameter(
        0.1, "Speed up to which the robot counts as standing.", unit="m/s", minimum=0.0, maximum=100.0
    )
    theta_stopped_vel: float = parameter(
        0.1, "Turn rate up to which the robot counts as standing.", unit="rad/s", minimum=0.0, maximum=100.0
    )
    prune_plan: bool = parameter(
        False, "Forget the part of the plan that is more than 1 m behind; needs follow_progress=false."
    )
    use_dwa: bool = parameter(
        True, "Only speeds that can be reached in one control period. false: in sim_time (trajectory rollout)."
    )
    restore_defaults: bool = parameter(False, "Accepted; a switch of dynamic_reconfigure.", effective=False)
    sim_time: float = parameter(1.7, "How long motions are looked ahead.", unit="s", minimum=0.01, maximum=60.0)
    sim_granularity: float = parameter(
        0.025, "Greatest way between points of a motion.", unit="m", minimum=1e-4, maximum=100.0
    )
    angular_sim_granularity: float = parameter(
        0.1, "Greatest turn between points of a motion.", unit="rad", minimum=1e-4, maximum=100.0
    )
    path_distance_bias: float = parameter(
        0.6,
        "Weight of the distance from the plan, of the robot and of the point ahead of it.",
        minimum=0.0,
        maximum=1e6,
    )
    goal_distance_bias: float = parameter(
        0.8, "Weight of the way to the local goal, of the robot and of the point ahead of it.", minimum=0.0, maximum=1e6
    )
    occdist_scale: float = parameter(0.01, "Weight of the greatest cost under the footprint.", minimum=0.0, maximum=1e6)
    twirling_scale: float = parameter(0.0, "Weight of the turn rate.", minimum=0.0, maximum=1e6)
    stop_time_buffer: float = parameter(0.2, "Accepted; DWAPlannerROS ignores it, too.", unit="s", effective=False)
    oscillation_reset_dist: float = parameter(
        0.05, "Way that allows a direction again that was ruled out.", unit="m", minimum=0.0, maximum=1000.0
    )
    oscillation_reset_angle: float = parameter(
        0.2, "Turn that allows a direction again that was ruled out.", unit="rad", minimum=0.0, maximum=1000.0
    )
    forward_point_distance: float = parameter(
        0.325, "How far ahead of the robot the second scored point is.", unit="m", minimum=0.0, maximum=100.0
    )
    scaling_speed: float = parameter(
        0.25,
        "Speed from which the footprint grows; only with scale_footprint, as DWAPlannerROS computes the growth and does"
        " not apply it.",
        unit="m/s",
        minimum=0.0,
        maximum=100.0,
    )
    max_scaling_factor: float = parameter(
        0.2, "How much the footprint has grown at max_vel_trans; only with scale_footprint.", minimum=0.0, maximum=100.0
    )
    vx_samples: int = parameter(3, "Samples of the forward speed.", minimum=1, maximum=1000)
    vy_samples: int = parameter(10, "Samples of the sideways speed.", minimum=1, maximum=1000)
    vth_samples: int = parameter(20, "Samples of the turn rate.", minimum=1, maximum=1000)
    vtheta_samples: int = parameter(
        20, "Accepted; TrajectoryPlannerROS' name: DWAPlannerROS reads vth_samples.", effective=False
    )
    cheat_factor: float = parameter(
        1.0,
        "Factor on the squared distance from the goal below which the point ahead need not be on the plan.",
        minimum=0.0,
        maximum=1e6,
    )
    sum_scores: bool = parameter(False, "Sum of the costs along a motion instead of the greatest.")
    publish_traj_pc: bool = parameter(False, _SHOWS_ONLY, effective=False)
    publish_cost_grid_pc: bool = parameter(False, _SHOWS_ONLY, effective=False)
    global_frame_id: str = parameter("odom", _SHOWS_ONLY, effective=False)

    follow_progress: bool = parameter(
        True,
        "Begin the local plan where the robot is. false, as DWAPlannerROS: with the first pose in reach, which where ways"
        " lie side by side can be one that was passed long ago.",
        extension=True,
    )
    free_local_goal: bool = parameter(
        True,
        "Take the last pose of the local plan that is not blocked as local goal, or if no way leads there, the last that"
        " one leads to. false, as DWAPlannerROS: the last pose; if it is blocked or cut off every motion is invalid.",
        extension=True,
    )
    escape: bool = parameter(
        True,
        "Where the robot stands too near an obstacle, allow motions that do not bring it nearer. false, as DWAPlannerROS:"
        " none is allowed.",
        extension=True,
    )
    turn_in_place: bool = parameter(
        True,
        "Also sample turning in place at min_vel_theta where acc_lim_theta does not reach it within a control period, and"
        " let a round robot turn in place wherever it stands.",
        extension=True,
    )
    soft_nose: bool = parameter(
        True,
        "Where the point ahead of the robot ends in an obstacle, count a detour of twice its distance. false, as"
        " DWAPlannerROS: as many cells as the costmap has, which keeps the robot from goals that it faces a wall at.",
        extension=True,
    )
    stop_at_goal: bool = parameter(
        True,
        "Look at motions only as far as the goal, where the robot stops. false, as DWAPlannerROS: for all of sim_time,"
        " which rules goals close to a wall out.",
        extension=True,
    )
    progress: bool = parameter(
        True,
        "Take a motion of at least min_vel_trans that is not backwards, if one is valid, and back up only if there is no"
        " other. false, as DWAPlannerROS: what costs least, by which the robot can hang in front of its goal, or back into"
        " what its scanner does not see.",
        extension=True,
    )
    turn_to_plan: float = parameter(
        0.6,
        "Standing or slower than min_vel_trans, turn in place towards the plan where it leads off by more than this. 0, as"
        " DWAPlannerROS: never.",
        unit="rad",
        minimum=0.0,
        maximum=math.pi,
        extension=True,
    )
    footprint_margin: float = parameter(
        0.02,
        "How much farther out the footprint is taken. 0, as DWAPlannerROS: not, and since costmaps clear the cells under"
        " the footprint a robot can graze what its scanner does not see again.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
        extension=True,
    )
    scale_footprint: bool = parameter(False, "Apply scaling_speed and max_scaling_factor.", extension=True)

    def __post_init__(self) -> None:
        for name, value in as_dict(self).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ConfigError(f"{name}={value!r}: not a finite number")
        for low, high in (("min_vel_x", "max_vel_x"), ("min_vel_y", "max_vel_y"), ("min_vel_trans", "max_vel_trans")):
            if getattr(self, low) > getattr(self, high):
                raise ConfigError(f"{low}={getattr(self, low):g} is above {high}={getattr(self, high):g}")


def read_dwa(values: Mapping[str, Any], source: str = "") -> DwaParameters:
    """Return the parameters from native names, those of kinetic included.

    Raises
    ------
    ConfigError
        If a name is unknown, a value has the wrong type or range, or two names of one parameter differ.
    """
    known = {declaration.name for declaration in declarations(DwaParameters)}
    renamed: dict[str, Any] = {}
    for name, value in values.items():
        own = ALIASES.get(name, name) if name not in known else name
        if own in renamed and renamed[own] != value:
            raise ConfigError(f"{name}={value!r} contradicts {own}={renamed[own]!r}: give one of them")
        renamed[own] = value
    return resolve(DwaParameters, renamed, source=source)
