# SPDX-License-Identifier: MIT
"""Settings of a simulated robot that is told where to go (`slamcli.simulation.plant`), declared once."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import parameter
from slamcli.simulation.camera_parameters import CameraParameters
from slamcli.simulation.setting import number


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotParameters(CameraParameters):
    """What a robot that obeys velocities can do; recordings by `generate` follow a path within `robot.speed` instead."""

    robot_drive: str = parameter(
        "diff",
        "Wheels of a robot that obeys velocities: differential, omnidirectional, or a car's (base_link: its rear axle).",
        name="robot.drive",
        choices=("diff", "omni", "car"),
    )
    robot_footprint: str = parameter(
        "",
        "Outline [[x, y], ...] in metres in base_link, for collisions (left out: the disc of robot.radius).",
        name="robot.footprint",
    )
    robot_wheelbase: float = number("robot.wheelbase", 0.4, "m", "Between the axles of a car.", 0.01, 20.0)
    robot_max_steering: float = number("robot.max_steering", 35.0, "deg", "Farthest steering of a car.", 0.1, 85.0)
    robot_steering_rate: float = number("robot.steering_rate", 120.0, "deg/s", "How fast a car steers.", 1.0, 1e4)
    robot_max_forward: float = number("robot.max_forward", 1.0, "m/s", "Fastest command forward.", 0.0, 20.0)
    robot_max_backward: float = number("robot.max_backward", 1.0, "m/s", "Fastest command backward.", 0.0, 20.0)
    robot_max_sideways: float = number("robot.max_sideways", 1.0, "m/s", "The same to a side (omni).", 0.0, 20.0)
    robot_max_turn: float = number("robot.max_turn", 3.0, "rad/s", "Fastest turn by command.", 0.0, 20.0)
    robot_forward_acceleration: float = number(
        "robot.forward_acceleration", 2.5, "m/s^2", "Limit of speeding up and slowing down by command.", 0.01
    )
    robot_sideways_acceleration: float = number(
        "robot.sideways_acceleration", 2.5, "m/s^2", "The same to a side (omni).", 0.01
    )
    robot_swing_acceleration: float = number(
        "robot.swing_acceleration", 5.0, "rad/s^2", "The same of turning by command.", 0.01
    )
    robot_latency: float = number("robot.latency", 0.0, "s", "Time from a command to its effect.", 0.0, 10.0)
    robot_command_timeout: float = number(
        "robot.command_timeout", 0.5, "s", "Without a command for so long the robot stops.", 0.02, 1e6
    )
    robot_unknown_is_floor: bool = parameter(
        True,
        "Whether a robot that obeys velocities may stand on unknown cells of a map.",
        name="robot.unknown_is_floor",
    )

    slip_rate: float = number(
        "slip.rate", 0.0, "1/min", "Episodes of slip per minute of motion (robots that obey velocities).", 0.0, 600.0
    )
    slip_drift: float = number(
        "slip.drift", 0.0, "1", "Standard deviation of told over true motion, minus 1, that comes and goes.", 0.0, 1.0
    )
    slip_drift_time: float = number("slip.drift_time", 2.0, "s", "How slowly it comes and goes.", 0.02, 1e4)

    people_model: str = parameter(
        "social_force",
        "How people walk beside a robot that obeys velocities: giving way to all, or on their ways, waiting for the robot.",
        name="people.model",
        choices=("social_force", "routes"),
    )
    carts_count: int = parameter(
        0, "Carts that come, stand somewhere for a while, and go (robots that obey velocities).", name="carts.count",
        minimum=0, maximum=200,
    )  # fmt: skip
    carts_stay: float = number("carts.stay", 20.0, "s", "How long a cart stands on average.", 0.1, 1e6)
    carts_away: float = number("carts.away", 10.0, "s", "How long it is away on average.", 0.1, 1e6)
