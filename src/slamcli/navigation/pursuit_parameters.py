# SPDX-License-Identifier: MIT
"""Parameters of regulated pure pursuit under the names of nav2's controller."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slamcli.errors import ConfigError
from slamcli.parameters import as_dict, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class PursuitParameters:
    """How the plan is followed; defaults are those of nav2, and of its goal checker."""

    desired_linear_vel: float = parameter(0.5, "Speed on a free straight.", unit="m/s", minimum=0.001, maximum=100.0)
    lookahead_dist: float = parameter(
        0.6, "Distance of the point that is pursued.", unit="m", minimum=0.01, maximum=100.0
    )
    use_velocity_scaled_lookahead_dist: bool = parameter(
        False, "Pursue a point lookahead_time ahead instead, between min_ and max_lookahead_dist."
    )
    min_lookahead_dist: float = parameter(0.3, "Least distance of it.", unit="m", minimum=0.01, maximum=100.0)
    max_lookahead_dist: float = parameter(0.9, "Greatest distance of it.", unit="m", minimum=0.01, maximum=100.0)
    lookahead_time: float = parameter(1.5, "Time to get there.", unit="s", minimum=0.01, maximum=100.0)
    use_fixed_curvature_lookahead: bool = parameter(
        False, "Take the curvature from the point curvature_lookahead_dist ahead."
    )
    curvature_lookahead_dist: float = parameter(
        0.6, "See use_fixed_curvature_lookahead.", unit="m", minimum=0.01, maximum=100.0
    )
    use_interpolation: bool = parameter(
        True, "Pursue the point where the plan leaves the circle. false: the first pose beyond it."
    )
    use_rotate_to_heading: bool = parameter(
        True, "Turn in place where the plan leads off to the side, and at the goal."
    )
    rotate_to_heading_min_angle: float = parameter(
        0.785, "Angle from which the robot turns in place.", unit="rad", minimum=0.01, maximum=math.pi
    )
    rotate_to_heading_angular_vel: float = parameter(
        1.8, "Turn rate in place.", unit="rad/s", minimum=0.01, maximum=100.0
    )
    max_angular_accel: float = parameter(
        3.2, "Greatest change of the turn rate in place.", unit="rad/s²", minimum=0.01, maximum=100.0
    )
    allow_reversing: bool = parameter(
        False, "Drive backwards where the plan's poses do; needs use_rotate_to_heading=false, as in nav2."
    )
    min_turning_radius: float = parameter(
        0.0,
        "Of a car-like robot: arcs are no tighter, and a goal passed in a wrong heading wants a new plan. 0: turns on the spot.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
        extension=True,
    )
    use_regulated_linear_velocity_scaling: bool = parameter(True, "Slow down in curves.")
    regulated_linear_scaling_min_radius: float = parameter(
        0.9, "Radius of curves below which the robot slows down.", unit="m", minimum=0.001, maximum=1000.0
    )
    regulated_linear_scaling_min_speed: float = parameter(
        0.25, "Speed below which curves and obstacles do not slow it down.", unit="m/s", minimum=0.0, maximum=100.0
    )
    use_cost_regulated_linear_velocity_scaling: bool = parameter(True, "Slow down near obstacles.")
    cost_scaling_dist: float = parameter(
        0.6, "Distance from obstacles below which the robot slows down.", unit="m", minimum=0.001, maximum=100.0
    )
    cost_scaling_gain: float = parameter(1.0, "Factor on that; less than 1 is slower.", minimum=0.001, maximum=1.0)
    inflation_cost_scaling_factor: float = parameter(
        10.0,
        "cost_scaling_factor of the local costmap, from which distances are computed: costmap_2d's default, where nav2 has 3.",
        unit="1/m",
        minimum=0.001,
        maximum=1e6,
    )
    min_approach_linear_velocity: float = parameter(
        0.05, "Least speed near the goal.", unit="m/s", minimum=0.001, maximum=100.0
    )
    approach_velocity_scaling_dist: float = parameter(
        0.6, "Way to the goal from which the robot slows down.", unit="m", minimum=0.0, maximum=100.0
    )
    use_collision_detection: bool = parameter(True, "Refuse motions that hit something on the costmap.")
    max_allowed_time_to_collision_up_to_carrot: float = parameter(
        1.0, "How far ahead that is looked for.", unit="s", minimum=0.0, maximum=100.0
    )
    max_robot_pose_search_dist: float = parameter(
        -1.0, "Accepted; the robot is looked for on the plan where it can have come to.", unit="m", effective=False
    )
    transform_tolerance: float = parameter(0.1, "Accepted; no meaning in simulated time.", unit="s", effective=False)
    use_cancel_deceleration: bool = parameter(False, "Accepted; goals are not cancelled in mid-drive.", effective=False)
    cancel_deceleration: float = parameter(
        3.2, "Accepted; goals are not cancelled in mid-drive.", unit="m/s²", effective=False
    )
    xy_goal_tolerance: float = parameter(
        0.25, "Distance from the goal at which it is reached.", unit="m", minimum=0.0, maximum=1000.0
    )
    yaw_goal_tolerance: float = parameter(
        0.25, "Angle from the goal's heading at which it is reached.", unit="rad", minimum=0.0, maximum=math.pi
    )
    stateful: bool = parameter(True, "Once within xy_goal_tolerance only turn.")
    trans_stopped_velocity: float = parameter(
        0.25, "Speed up to which the robot counts as standing.", unit="m/s", minimum=0.0, maximum=100.0
    )
    rot_stopped_velocity: float = parameter(
        0.25, "Turn rate up to which the robot counts as standing.", unit="rad/s", minimum=0.0, maximum=100.0
    )
    shorten_lookahead: bool = parameter(
        True,
        "Where the arc to the point ahead would hit something and the plan does not, pursue nearer points, down to a"
        " quarter of the distance. false, as nav2: refuse.",
        extension=True,
    )

    footprint_margin: float = parameter(
        0.02,
        "How much farther out the footprint is taken in looking for collisions. 0, as nav2: not.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
        extension=True,
    )

    @property
    def max_vel_x(self) -> float:
        """Top speed, m/s, under the name that other local planners have for it."""
        return self.desired_linear_vel

    def __post_init__(self) -> None:
        for name, value in as_dict(self).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ConfigError(f"{name}={value!r}: not a finite number")
        if self.min_lookahead_dist > self.max_lookahead_dist:
            raise ConfigError(
                f"min_lookahead_dist={self.min_lookahead_dist:g} is above max_lookahead_dist={self.max_lookahead_dist:g}"
            )
        if self.allow_reversing and self.use_rotate_to_heading:
            raise ConfigError("allow_reversing and use_rotate_to_heading exclude each other: set one of them to false")
