# SPDX-License-Identifier: MIT
"""Parameters of what a band costs: obstacles and weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.parameters import parameter

_CONVERTERS = (
    *(
        "CostmapToPolygonsDBSMCCH",
        "CostmapToPolygonsDBSConcaveHull",
        "CostmapToLinesDBSMCCH",
        "CostmapToLinesDBSRANSAC",
    ),
    "CostmapToDynamicObstacles",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleParameters:
    """Which obstacles count, and how near they may be."""

    min_obstacle_dist: float | None = parameter(
        None,
        "Distance to keep from obstacles, from the robot's outline. auto: 0.1 with the costmap's footprint, and the"
        " original's 0.5 with any other footprint_model: 0.5 stands for the size of a robot that is a point, and keeps it"
        " out of doors under 1 m.",
        kind=float,
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
    inflation_dist: float | None = parameter(
        None,
        "Distance below which obstacles cost a little. auto: 0.35 with the costmap's footprint, and the original's 0.6 with"
        " any other.",
        kind=float,
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
    dynamic_obstacle_inflation_dist: float = parameter(
        0.6, "The same of moving obstacles.", unit="m", minimum=0.0, maximum=100.0
    )
    include_dynamic_obstacles: bool = parameter(True, "Expect moving obstacles to go on as they move now.")
    include_costmap_obstacles: bool = parameter(True, "Take the costmap's obstacle cells as obstacles.")
    costmap_obstacles_behind_robot_dist: float = parameter(
        1.5, "Leave out obstacle cells that are farther behind the robot.", unit="m", minimum=0.0, maximum=100.0
    )
    obstacle_poses_affected: int = parameter(
        25, "Poses that an obstacle is attached to; of legacy_obstacle_association.", minimum=0, maximum=5000
    )
    legacy_obstacle_association: bool = parameter(
        False, "Attach obstacles to the pose nearest to each and its neighbours, not to each pose what is near it."
    )
    obstacle_association_force_inclusion_factor: float = parameter(
        1.5,
        "All obstacles within so many min_obstacle_dist of a pose count, and all within inflation_dist.",
        minimum=0.0,
        maximum=100.0,
    )
    obstacle_association_cutoff_factor: float = parameter(
        5.0, "Of those farther off only the nearest on either side, within so many.", minimum=0.0, maximum=100.0
    )
    costmap_converter_plugin: str = parameter(
        "",
        "CostmapToDynamicObstacles: follow small groups of obstacle cells, and expect those that move to go on. Others make"
        " lines or polygons of cells, and change nothing here: obstacles are the cells at the edge of what is occupied.",
        choices=("", *(f"costmap_converter::{name}" for name in _CONVERTERS)),
    )
    costmap_converter_spin_thread: bool = parameter(True, "Accepted; no meaning offline.", effective=False)
    costmap_converter_rate: int = parameter(5, "Accepted; no meaning offline.", minimum=1, effective=False)
    obstacle_proximity_ratio_max_vel: float = parameter(
        1.0, "Share of the greatest speeds allowed near obstacles.", minimum=0.0, maximum=1.0
    )
    obstacle_proximity_lower_bound: float = parameter(
        0.0, "Distance at which the robot shall stand.", unit="m", minimum=0.0, maximum=100.0
    )
    obstacle_proximity_upper_bound: float = parameter(
        0.5, "Distance from which on that share holds.", unit="m", minimum=0.0, maximum=100.0
    )


def _weight(default: float, help: str) -> Any:
    return parameter(default, help, minimum=0.0, maximum=1e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimisationParameters:
    """The least-squares problem: rounds and weights."""

    no_inner_iterations: int = parameter(5, "Steps of Levenberg-Marquardt in a round.", minimum=1, maximum=1000)
    no_outer_iterations: int = parameter(4, "Rounds; each resizes the band first.", minimum=1, maximum=1000)
    optimization_activate: bool = parameter(True, "Optimise; otherwise nothing moves.")
    optimization_verbose: bool = parameter(False, "Accepted; no meaning offline.", effective=False)
    penalty_epsilon: float = parameter(0.05, "Margin that is kept from every bound.", minimum=0.0, maximum=1.0)
    weight_max_vel_x: float = _weight(2.0, "Of the speed ahead being too great.")
    weight_max_vel_y: float = _weight(2.0, "Of the speed sideways being too great.")
    weight_max_vel_theta: float = _weight(1.0, "Of the turning rate being too great.")
    weight_acc_lim_x: float = _weight(1.0, "Of the acceleration ahead being too great.")
    weight_acc_lim_y: float = _weight(1.0, "Of the acceleration sideways being too great.")
    weight_acc_lim_theta: float = _weight(1.0, "Of the acceleration of turning being too great.")
    weight_kinematics_nh: float = _weight(1000.0, "Of motion that wheels do not allow.")
    weight_kinematics_forward_drive: float = _weight(1.0, "Of driving backwards; not for car-like robots.")
    weight_kinematics_turning_radius: float = _weight(1.0, "Of turning tighter than min_turning_radius.")
    weight_optimaltime: float = _weight(1.0, "Of the time that the band takes.")
    weight_shortest_path: float = _weight(0.0, "Of its length.")
    weight_obstacle: float = _weight(50.0, "Of obstacles nearer than min_obstacle_dist.")
    weight_inflation: float = _weight(0.1, "Of obstacles nearer than inflation_dist.")
    weight_dynamic_obstacle: float = _weight(50.0, "Of moving obstacles nearer than min_obstacle_dist.")
    weight_dynamic_obstacle_inflation: float = _weight(
        0.1, "Of moving obstacles nearer than dynamic_obstacle_inflation_dist."
    )
    weight_velocity_obstacle_ratio: float = _weight(0.0, "Of being too fast near obstacles (obstacle_proximity_...).")
    weight_viapoint: float = _weight(1.0, "Of the distance to via-points.")
    weight_prefer_rotdir: float = _weight(50.0, "Of turning the other way while an oscillation is resolved.")
    weight_adapt_factor: float = parameter(
        2.0, "weight_obstacle grows by this factor from round to round.", minimum=0.0, maximum=100.0
    )
    obstacle_cost_exponent: float = parameter(
        1.0, "Exponent of the penalty of obstacles that are too near.", minimum=0.01, maximum=100.0
    )
