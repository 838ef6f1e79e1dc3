# SPDX-License-Identifier: MIT
"""Parameters of ROS move_base and its recovery behaviours (ros-planning/navigation, noetic)."""

from __future__ import annotations

from slamcli.native.ros_parameters.declare import Table, row

MOVE_BASE: Table = (
    row("base_global_planner", "navfn/NavfnROS", "Global planner."),
    row("base_local_planner", "base_local_planner/TrajectoryPlannerROS", "Local planner."),
    row("planner_frequency", 0.0, "Rate of planning; 0 plans only for a new goal or when blocked.", "Hz", minimum=0),
    row("controller_frequency", 20.0, "Rate of control.", "Hz", minimum=0),
    row("planner_patience", 5.0, "Time without a plan before recovery.", "s", minimum=0),
    row("controller_patience", 15.0, "Time without a command before recovery.", "s", minimum=0),
    row("max_planning_retries", -1, "Attempts at planning; -1 is no limit.", minimum=-1),
    row("conservative_reset_dist", 3.0, "Obstacles farther than this are forgotten.", "m", minimum=0),
    row("recovery_behavior_enabled", True, "Recovery behaviours are run."),
    row("clearing_rotation_allowed", True, "The robot may turn in place to clear space."),
    row("shutdown_costmaps", False, "Costmaps stop while the robot waits."),
    row("oscillation_timeout", 0.0, "Time in one place before recovery; 0 is off.", "s", minimum=0),
    row("oscillation_distance", 0.5, "Distance that counts as having moved.", "m", minimum=0),
    row("make_plan_clear_costmap", True, "The make_plan service clears the costmap first."),
    row("make_plan_add_unreachable_goal", True, "The make_plan service appends the goal."),
    row("clearing_radius", 0.46, "Radius that is cleared around the robot.", "m", minimum=0),
    row("robot_base_frame", "base_link", "Frame of the robot."),
    row("global_frame", "map", "Frame of the map."),
)

CLEAR_COSTMAP: Table = (
    row("reset_distance", 3.0, "Side of the window that is kept.", "m", minimum=0),
    row("invert_area_to_clear", False, "Clear within the window instead of outside."),
    row("force_updating", False, "Update the costmap after clearing."),
    row("affected_maps", "both", "Which maps are cleared.", choices=("local", "global", "both")),
)

ROTATE_RECOVERY: Table = (
    row("sim_granularity", 0.017, "Step of the collision check.", "rad", minimum=0),
    row("frequency", 20.0, "Rate of commands.", "Hz", minimum=0),
)

MOVE_SLOW_AND_CLEAR: Table = (
    row("clearing_distance", 0.5, "Obstacles nearer than this are cleared.", "m", minimum=0),
    row("limited_trans_speed", 0.25, "Speed until the robot has moved.", "m/s", minimum=0),
    row("limited_rot_speed", 0.45, "Turn rate until the robot has moved.", "rad/s", minimum=0),
    row("limited_distance", 0.3, "Distance after which the limits end.", "m", minimum=0),
)

RECOVERIES: dict[str, Table] = {
    "conservative_reset": CLEAR_COSTMAP,
    "aggressive_reset": CLEAR_COSTMAP,
    "rotate_recovery": ROTATE_RECOVERY,
}
RECOVERY_TYPES: dict[str, Table] = {
    "clear_costmap_recovery/ClearCostmapRecovery": CLEAR_COSTMAP,
    "rotate_recovery/RotateRecovery": ROTATE_RECOVERY,
    "move_slow_and_clear/MoveSlowAndClear": MOVE_SLOW_AND_CLEAR,
}
