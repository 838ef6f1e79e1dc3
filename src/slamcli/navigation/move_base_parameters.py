# SPDX-License-Identifier: MIT
"""Parameters of move_base and of its recovery behaviours, under their ROS names."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import parameter

DEFAULT_RESET_DISTANCE_M = 3.0
"""What clear_costmap_recovery assumes where its namespace says nothing."""

_NO_MIDDLEWARE = "Accepted; there is no middleware that it could matter to."
_LIMITED_HERE = "Accepted; commands are limited whichever planner they come from."


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveBaseParameters:
    """What move_base does when; names and defaults of ROS noetic."""

    base_global_planner: str = parameter(
        "navfn/NavfnROS",
        "The global planner: navfn/NavfnROS, global_planner/GlobalPlanner, or a name of `slamcli plan`; --global-planner goes before"
        " it.",
    )
    base_local_planner: str = parameter(
        "dwa_local_planner/DWAPlannerROS",
        "The local planner: dwa_local_planner/DWAPlannerROS, teb_local_planner/TebLocalPlannerROS, or dwa, teb, pursuit."
        " (ROS: base_local_planner/TrajectoryPlannerROS, whose successor DWA is.)",
    )
    planner_frequency: float = parameter(
        0.0, "Global plans per second while the robot drives; 0: only for a new goal or when control fails.",
        unit="Hz", minimum=0.0, maximum=100.0,
    )  # fmt: skip
    controller_frequency: float = parameter(20.0, "Commands per second.", unit="Hz", minimum=0.5, maximum=100.0)
    planner_patience: float = parameter(
        5.0, "How long a plan is looked for before recovery.", unit="s", minimum=0.0, maximum=3600.0
    )
    controller_patience: float = parameter(
        15.0, "How long the controller may fail before recovery.", unit="s", minimum=0.0, maximum=3600.0
    )
    max_planning_retries: int = parameter(
        -1, "How often planning may fail before recovery; -1: until planner_patience is over.", minimum=-1
    )
    conservative_reset_dist: float = parameter(
        3.0,
        "Side of the square around the robot outside of which the conservative reset forgets obstacles (ROS calls it a"
        " distance; its code halves it, and so does this).",
        unit="m",
        minimum=0.0,
    )
    recovery_behavior_enabled: bool = parameter(True, "Try recovery behaviours before giving up.")
    clearing_rotation_allowed: bool = parameter(True, "Whether the robot may turn in place to recover.")
    oscillation_timeout: float = parameter(
        30.0, "How long the robot may move less than oscillation_distance before recovery; 0: for ever, as ROS by default.",
        unit="s", minimum=0.0,
    )  # fmt: skip
    oscillation_distance: float = parameter(0.5, "See oscillation_timeout.", unit="m", minimum=0.0)
    recovery_behaviors: str = parameter(
        "conservative_reset rotate_recovery aggressive_reset rotate_recovery",
        "What is tried in turn: conservative_reset, rotate_recovery, aggressive_reset, move_slow_and_clear, back_up, or NAME:TYPE"
        " with a type of ROS; files may have ROS's list of names and types. Each reads the namespace of its own name.",
    )
    clearing_radius: float | None = parameter(
        None, "Accepted; move_base itself reads it only for an old service. auto: the circumscribed radius.",
        kind=float, unit="m", minimum=0.0, effective=False,
    )  # fmt: skip
    shutdown_costmaps: bool = parameter(False, _NO_MIDDLEWARE, effective=False)
    make_plan_clear_costmap: bool = parameter(True, _NO_MIDDLEWARE, effective=False)
    make_plan_add_unreachable_goal: bool = parameter(True, _NO_MIDDLEWARE, effective=False)
    global_frame: str = parameter("map", "Accepted; goals are in the map frame.", effective=False)
    robot_base_frame: str = parameter("base_link", "Accepted; the simulator says what its frames are.", effective=False)
    controller_lock_correction: bool = parameter(False, _NO_MIDDLEWARE, effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoveryParameters:
    """How recovery behaviours work; in ROS each has a namespace of its own."""

    reset_distance: float | None = parameter(
        None,
        "Side of the square around the robot that resets keep (or clear, inverted). auto: conservative_reset_dist for"
        " conservative_reset, four circumscribed radii for aggressive_reset, 3 for others.",
        name="clear_costmap.reset_distance",
        kind=float,
        unit="m",
        minimum=0.0,
        maximum=1e6,
    )
    layer_names: str = parameter(
        "obstacles obstacle_layer voxel_layer",
        "Layers that resets clear, of those that there are. ROS clears `obstacles` only, a layer that files without a list"
        " of plugins do not have: its resets do nothing then.",
        name="clear_costmap.layer_names",
    )
    affected_maps: str = parameter(
        "both", "Which costmaps are cleared.", name="clear_costmap.affected_maps", choices=("both", "local", "global")
    )
    invert_area_to_clear: bool = parameter(
        False, "Clear what is near instead of what is far.", name="clear_costmap.invert_area_to_clear"
    )
    force_updating: bool = parameter(
        False, "Accepted; costmaps are always updated before the next plan.", name="clear_costmap.force_updating",
        effective=False,
    )  # fmt: skip
    sim_granularity: float = parameter(
        0.017, "Step in which a turn is checked for collisions.", name="rotate_recovery.sim_granularity",
        unit="rad", minimum=0.001, maximum=1.0,
    )  # fmt: skip
    frequency: float = parameter(
        20.0, "Accepted; commands come at controller_frequency.", name="rotate_recovery.frequency", unit="Hz",
        minimum=0.1, effective=False,
    )  # fmt: skip
    rotate_yaw_goal_tolerance: float = parameter(
        0.1, "How much of the turn may be missing.", name="rotate_recovery.yaw_goal_tolerance", unit="rad",
        minimum=0.01, maximum=1.0,
    )  # fmt: skip
    rotate_acc_lim_theta: float = parameter(
        3.2, "How hard the turn is braked.", name="rotate_recovery.acc_lim_theta", unit="rad/s^2", minimum=0.01
    )
    max_rotational_vel: float = parameter(
        1.0, "Fastest turn.", name="rotate_recovery.max_rotational_vel", unit="rad/s", minimum=0.01
    )
    min_in_place_rotational_vel: float = parameter(
        0.4, "Slowest turn.", name="rotate_recovery.min_in_place_rotational_vel", unit="rad/s", minimum=0.01
    )
    clearing_distance: float = parameter(
        0.5, "Obstacles nearer than this are forgotten.", name="move_slow_and_clear.clearing_distance", unit="m",
        minimum=0.0,
    )  # fmt: skip
    limited_trans_speed: float = parameter(
        0.25, "Top speed afterwards.", name="move_slow_and_clear.limited_trans_speed", unit="m/s", minimum=0.01
    )
    limited_rot_speed: float = parameter(
        0.45, "Top turning speed afterwards.", name="move_slow_and_clear.limited_rot_speed", unit="rad/s", minimum=0.01
    )
    limited_distance: float = parameter(
        0.3, "How far these limits hold.", name="move_slow_and_clear.limited_distance", unit="m", minimum=0.0
    )
    planner_namespace: str = parameter(
        "DWAPlannerROS", _LIMITED_HERE, name="move_slow_and_clear.planner_namespace", effective=False
    )
    max_trans_param_name: str = parameter(
        "max_vel_trans", _LIMITED_HERE, name="move_slow_and_clear.max_trans_param_name", effective=False
    )
    max_rot_param_name: str = parameter(
        "max_vel_theta", _LIMITED_HERE, name="move_slow_and_clear.max_rot_param_name", effective=False
    )
    backup_distance: float = parameter(
        0.3, "How far the robot backs up, as far as it is free behind.", name="back_up.distance", unit="m",
        minimum=0.0, maximum=10.0, extension=True,
    )  # fmt: skip
    backup_speed: float = parameter(
        0.1, "How fast.", name="back_up.speed", unit="m/s", minimum=0.01, maximum=5.0, extension=True
    )
