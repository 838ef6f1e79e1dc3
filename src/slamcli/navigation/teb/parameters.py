# SPDX-License-Identifier: MIT
"""Parameters of the timed elastic band under the names of TebLocalPlannerROS, all in one flat table."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.navigation.footprint import parse_footprint
from slamcli.navigation.teb.choice_parameters import HomotopyParameters, RecoveryParameters
from slamcli.navigation.teb.cost_parameters import ObstacleParameters, OptimisationParameters
from slamcli.parameters import group, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryParameters:
    """How the band is laid and cut into poses."""

    teb_autosize: bool = parameter(True, "Insert and remove poses so that time steps stay near dt_ref.")
    dt_ref: float = parameter(0.3, "Time between two poses.", unit="s", minimum=0.01, maximum=10.0)
    dt_hysteresis: float = parameter(
        0.1, "How far from dt_ref a time step may be.", unit="s", minimum=0.001, maximum=10.0
    )
    min_samples: int = parameter(3, "Fewest poses.", minimum=3, maximum=500)
    max_samples: int = parameter(500, "Most poses.", minimum=3, maximum=5000)
    global_plan_overwrite_orientation: bool = parameter(
        True,
        "Take the headings along the band and at its end from the direction of the global plan, not from its poses.",
    )
    allow_init_with_backwards_motion: bool = parameter(
        False, "Begin with a band driven backwards if its end lies behind."
    )
    global_plan_viapoint_sep: float = parameter(
        -0.1,
        "Distance of via-points taken from the global plan; negative: none.",
        unit="m",
        minimum=-1.0,
        maximum=100.0,
    )
    via_points_ordered: bool = parameter(False, "Pass via-points in their order.")
    max_global_plan_lookahead_dist: float = parameter(
        3.0,
        "Length of the global plan that is looked at; 0: all within the costmap.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    global_plan_prune_distance: float = parameter(
        1.0, "How much of the global plan behind the robot is kept.", unit="m", minimum=0.0, maximum=100.0
    )
    exact_arc_length: bool = parameter(False, "Speeds along the arc between two poses, not along the chord.")
    force_reinit_new_goal_dist: float = parameter(
        1.0, "Begin anew if the end of the band jumps farther.", unit="m", minimum=0.0, maximum=1000.0
    )
    force_reinit_new_goal_angular: float = parameter(
        math.pi / 2, "Begin anew if the end of the band turns more.", unit="rad", minimum=0.0, maximum=4.0
    )
    feasibility_check_no_poses: int = parameter(
        5, "Poses whose footprint is checked on the costmap; -1: all.", minimum=-1, maximum=5000
    )
    feasibility_check_lookahead_distance: float = parameter(
        -1.0, "Check no farther than this from the robot; negative: no limit.", unit="m", minimum=-1.0, maximum=1000.0
    )
    min_resolution_collision_check_angular: float = parameter(
        math.pi, "Check between poses that turn more.", unit="rad", minimum=0.01, maximum=math.pi
    )
    control_look_ahead_poses: int = parameter(
        1, "The command is the mean speed from the first pose to this one.", minimum=1, maximum=100
    )
    prevent_look_ahead_poses_near_goal: int = parameter(
        0, "How many poses before the goal that one stays.", minimum=0, maximum=100
    )
    publish_feedback: bool = parameter(False, "Accepted; no meaning offline.", effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotParameters:
    """What the robot can do."""

    max_vel_x: float = parameter(0.4, "Greatest speed ahead.", unit="m/s", minimum=0.01, maximum=100.0)
    max_vel_x_backwards: float = parameter(0.2, "Greatest speed backwards.", unit="m/s", minimum=0.01, maximum=100.0)
    max_vel_y: float = parameter(
        0.0, "Greatest speed sideways; 0 for robots that cannot.", unit="m/s", minimum=0.0, maximum=100.0
    )
    max_vel_trans: float = parameter(
        0.0, "Greatest speed over ground of a holonomic robot; 0: max_vel_x.", unit="m/s", minimum=0.0, maximum=100.0
    )
    max_vel_theta: float = parameter(0.3, "Greatest turning rate.", unit="rad/s", minimum=0.01, maximum=100.0)
    acc_lim_x: float = parameter(0.5, "Acceleration ahead.", unit="m/s^2", minimum=0.01, maximum=100.0)
    acc_lim_y: float = parameter(0.5, "Acceleration sideways.", unit="m/s^2", minimum=0.01, maximum=100.0)
    acc_lim_theta: float = parameter(0.5, "Acceleration of turning.", unit="rad/s^2", minimum=0.01, maximum=100.0)
    min_turning_radius: float = parameter(
        0.0, "Of a car-like robot; 0: turns on the spot.", unit="m", minimum=0.0, maximum=100.0
    )
    wheelbase: float = parameter(
        1.0, "Distance of the axles, negative if the rear wheels steer.", unit="m", minimum=-100.0, maximum=100.0
    )
    cmd_angle_instead_rotvel: bool = parameter(False, "Command the steering angle in place of the turning rate.")
    is_footprint_dynamic: bool = parameter(
        False, "Accepted; the footprint always comes with the costmap.", effective=False
    )
    use_proportional_saturation: bool = parameter(
        False, "If a speed is too great, scale all of them, not only that one."
    )
    transform_tolerance: float = parameter(
        0.5, "Accepted; frames are always at hand.", unit="s", minimum=0.0, effective=False
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalParameters:
    """When the goal is reached."""

    xy_goal_tolerance: float = parameter(0.2, "Distance from the goal.", unit="m", minimum=0.001, maximum=100.0)
    yaw_goal_tolerance: float = parameter(0.2, "Angle from the goal's heading.", unit="rad", minimum=0.001, maximum=7.0)
    free_goal_vel: bool = parameter(False, "The robot need not stop at the goal.")
    trans_stopped_vel: float = parameter(
        0.1, "Below this speed the robot stands.", unit="m/s", minimum=0.0, maximum=100.0
    )
    theta_stopped_vel: float = parameter(
        0.1, "Below this rate the robot does not turn.", unit="rad/s", minimum=0.0, maximum=100.0
    )
    complete_global_plan: bool = parameter(
        True,
        "Near the goal is not enough while via-points are left, so that a round trip does not end where it begins.",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FootprintModel:
    """The robot's outline as the optimiser sees it."""

    type: str = parameter(
        "auto",
        "auto: the costmap's footprint, as a circle if it is nearly one. The original's default is point.",
        choices=("auto", "point", "circular", "two_circles", "line", "polygon"),
    )
    radius: float = parameter(0.2, "Of circular.", unit="m", minimum=0.0, maximum=100.0)
    front_offset: float = parameter(
        0.2, "Of two_circles: where the front one is.", unit="m", minimum=-100.0, maximum=100.0
    )
    front_radius: float = parameter(0.2, "Of two_circles.", unit="m", minimum=0.0, maximum=100.0)
    rear_offset: float = parameter(
        0.2, "Of two_circles: how far back the rear one is.", unit="m", minimum=-100.0, maximum=100.0
    )
    rear_radius: float = parameter(0.2, "Of two_circles.", unit="m", minimum=0.0, maximum=100.0)
    line_start: str = parameter("[-0.3, 0.0]", "Of line, in the base frame.", unit="m")
    line_end: str = parameter("[0.3, 0.0]", "Of line, in the base frame.", unit="m")
    vertices: str = parameter("[]", "Of polygon: [[x1, y1], [x2, y2], ...] in the base frame.", unit="m")

    def __post_init__(self) -> None:
        """Refuse lists that are none."""
        if self.type in ("line", "polygon"):
            self.points()

    def points(self) -> NDArray[np.float64]:
        """Return the corners of a polygon or the two ends of a line, float64 (N, 2), metres, base frame.

        Raises
        ------
        ConfigError
            If they are not a list of points with finite coordinates, or too few.
        """
        text = f"[{self.line_start}, {self.line_end}, {self.line_end}]" if self.type == "line" else self.vertices
        points = parse_footprint(text)
        if not points:
            raise ConfigError(f"footprint_model.type={self.type!r}: footprint_model.vertices has no points")
        return np.array(points[:2] if self.type == "line" else points, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class TebParameters:
    """All parameters of TebLocalPlannerROS; the groups add nothing to their names, but for footprint_model."""

    trajectory: TrajectoryParameters = group(TrajectoryParameters(), name="")
    robot: RobotParameters = group(RobotParameters(), name="")
    goal: GoalParameters = group(GoalParameters(), name="")
    obstacles: ObstacleParameters = group(ObstacleParameters(), name="")
    optimisation: OptimisationParameters = group(OptimisationParameters(), name="")
    homotopy: HomotopyParameters = group(HomotopyParameters(), name="")
    recovery: RecoveryParameters = group(RecoveryParameters(), name="")
    footprint_model: FootprintModel = group(FootprintModel())
    odom_topic: str = parameter("odom", "Accepted; no meaning offline.", effective=False)
    map_frame: str = parameter("odom", "Accepted; no meaning offline.", effective=False)

    @property
    def max_vel_x(self) -> float:
        """The greatest speed ahead, m/s; every local planner's parameters have it."""
        return self.robot.max_vel_x
