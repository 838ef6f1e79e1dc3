# SPDX-License-Identifier: MIT
"""Every setting of a simulated robot, its sensors, its clocks and the people around it, declared once.

World files hold them in sections (``laser: {beams: 361}``), the command line takes them as ``--set laser.beams=361``.
Noise of odometry is a density: errors of successive steps are independent, so that the standard deviation grows with
the square root of the distance (or angle) and does not depend on the rate of the messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from slamcli.errors import ConfigError
from slamcli.parameters import declarations, parameter, resolve, unknown_name
from slamcli.simulation.robot_parameters import RobotParameters
from slamcli.simulation.setting import number


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationParameters(RobotParameters):
    """Settings of one simulated recording; names as in world files and ``--set``."""

    robot_radius: float = number(
        "robot.radius", 0.25, "m", "Radius of the robot's body; it keeps clear of walls.", 0.02
    )
    robot_speed: float = number("robot.speed", 0.6, "m/s", "Top speed.", 0.01, 20.0)
    robot_acceleration: float = number("robot.acceleration", 0.6, "m/s^2", "Limit of acceleration.", 0.01)
    robot_turn_rate: float = number("robot.turn_rate", 1.0, "rad/s", "Top turning speed.", 0.01, 20.0)
    robot_turn_acceleration: float = number("robot.turn_acceleration", 2.0, "rad/s^2", "Limit of turning.", 0.01)
    robot_lookahead: float = number("robot.lookahead", 0.4, "m", "How far ahead on its path the robot aims.", 0.05, 5.0)
    robot_margin: float = number("robot.margin", 0.12, "m", "Distance from walls kept beyond the radius in planning.")
    robot_rest: float = number("robot.rest", 1.0, "s", "Time at rest before the robot starts to move.", 0.0, 3600.0)

    robot_base_frame: str = parameter(
        "base_link", "Name of the frame whose pose is the truth (carried rigs: body).", name="robot.base_frame"
    )
    carried_sway: float = number("carried.sway", 0.03, "m", "Standard deviation of a carried rig about its path.")
    carried_shake: float = number("carried.shake", 2.0, "deg", "The same of roll, pitch and yaw.", 0.0, 45.0)

    laser_enabled: bool = parameter(True, "Record a planar scanner on /scan.", name="laser.enabled")
    laser_beams: int = parameter(180, "Number of beams.", name="laser.beams", minimum=1, maximum=100_000)
    laser_fov: float = number("laser.fov", 180.0, "deg", "Field of view, symmetric about forward.", 0.0, 360.0)
    laser_rate: float = number("laser.rate", 10.0, "Hz", "Scans per second.", 0.01, 1000.0)
    laser_sweep: float | None = parameter(
        None,
        "Time from the first to the last beam (auto: that of a mirror turning once a scan, fov / 360 / rate; 0: all at once).",
        name="laser.sweep",
        kind=float,
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )
    laser_range_min: float = number("laser.range_min", 0.05, "m", "Nearest distance that is measured; nearer is -inf.")
    laser_range_max: float = number("laser.range_max", 30.0, "m", "Farthest distance that is measured.", 0.1)
    laser_noise: float = number("laser.noise", 0.01, "m", "Standard deviation of a range.")
    laser_noise_relative: float = number(
        "laser.noise_relative", 0.0, "1", "Further deviation, as a share of the range."
    )
    laser_resolution: float = number("laser.resolution", 0.0, "m", "Step to which ranges are rounded (0: none).")
    laser_dropout: float = number("laser.dropout", 0.001, "1", "Share of beams without an answer.", 0.0, 1.0)
    laser_dropout_value: str = parameter(
        "nan", "What such a beam reads.", name="laser.dropout_value", choices=("nan", "inf", "zero", "max")
    )
    laser_no_return: str = parameter(
        "inf", "What a beam beyond range_max reads.", name="laser.no_return", choices=("nan", "inf", "zero", "max")
    )
    laser_x: float = number("laser.x", 0.1, "m", "Mount, forward of base_link.", None)
    laser_y: float = number("laser.y", 0.0, "m", "Mount, left of base_link.", None)
    laser_z: float = number("laser.z", 0.3, "m", "Mount, above base_link.", None)
    laser_yaw: float = number("laser.yaw", 0.0, "deg", "Mount, turned left.", None)
    laser_upside_down: bool = parameter(False, "Mounted with its z axis down.", name="laser.upside_down")
    laser_clockwise: bool = parameter(False, "Scans clockwise (negative increment).", name="laser.clockwise")

    lidar3d_enabled: bool = parameter(False, "Record a spinning scanner on /points.", name="lidar3d.enabled")
    lidar3d_rings: int = parameter(
        16, "Number of beams above each other.", name="lidar3d.rings", minimum=1, maximum=512
    )
    lidar3d_lowest: float = number("lidar3d.lowest", -15.0, "deg", "Elevation of the lowest beam.", -90.0, 90.0)
    lidar3d_highest: float = number(
        "lidar3d.highest", 15.0, "deg", "Elevation of the highest; evenly between.", -90.0, 90.0
    )
    lidar3d_angles: str = parameter(
        "",
        "Elevations of all beams in degrees, lowest first, with commas, instead of the three above.",
        name="lidar3d.angles",
    )
    lidar3d_columns: int = parameter(
        900, "Firings of all beams in one revolution.", name="lidar3d.columns", minimum=1, maximum=100_000
    )
    lidar3d_rate: float = number("lidar3d.rate", 10.0, "Hz", "Revolutions per second.", 0.01, 1000.0)
    lidar3d_clockwise: bool = parameter(False, "Turns clockwise, seen from above.", name="lidar3d.clockwise")
    lidar3d_range_min: float = number("lidar3d.range_min", 0.4, "m", "Nearest distance that is measured.")
    lidar3d_range_max: float = number("lidar3d.range_max", 80.0, "m", "Farthest distance that is measured.", 0.1)
    lidar3d_noise: float = number("lidar3d.noise", 0.02, "m", "Standard deviation of a range.")
    lidar3d_dropout: float = number("lidar3d.dropout", 0.002, "1", "Share of beams without an answer.", 0.0, 1.0)
    lidar3d_intensity_noise: float = number(
        "lidar3d.intensity_noise", 2.0, "1", "Standard deviation of an intensity (0 to 255)."
    )
    lidar3d_organised: bool = parameter(
        False,
        "Clouds of rings x columns with NaN where no answer came, instead of answers only.",
        name="lidar3d.organised",
    )
    lidar3d_x: float = number("lidar3d.x", 0.0, "m", "Mount, forward of base_link.", None)
    lidar3d_y: float = number("lidar3d.y", 0.0, "m", "Mount, left of base_link.", None)
    lidar3d_z: float = number("lidar3d.z", 0.8, "m", "Mount, above base_link.", None)
    lidar3d_roll: float = number("lidar3d.roll", 0.0, "deg", "Mount, turned about its forward axis.", None)
    lidar3d_pitch: float = number("lidar3d.pitch", 0.0, "deg", "Mount, nose down.", None)
    lidar3d_yaw: float = number("lidar3d.yaw", 0.0, "deg", "Mount, turned left.", None)

    odometry_enabled: bool = parameter(True, "Record wheel odometry on /odom and /tf.", name="odometry.enabled")
    odometry_rate: float = number("odometry.rate", 20.0, "Hz", "Odometry messages per second.", 0.1, 1000.0)
    odometry_srr: float = number("odometry.srr", 0.02, "m/sqrt(m)", "Distance error after 1 m straight.")
    odometry_srt: float = number("odometry.srt", 0.02, "rad/sqrt(m)", "Heading error after 1 m straight.")
    odometry_str: float = number("odometry.str", 0.01, "m/sqrt(rad)", "Distance error after 1 rad of turning.")
    odometry_stt: float = number("odometry.stt", 0.03, "rad/sqrt(rad)", "Heading error after 1 rad of turning.")
    odometry_distance_scale: float = number("odometry.distance_scale", 1.0, "1", "Told distance over true distance.")
    odometry_turn_scale: float = number("odometry.turn_scale", 1.0, "1", "Told turn over true turn.")
    odometry_pull: float = number("odometry.pull", 0.0, "rad/m", "Turn that is told on straight ways.", None)

    slip_count: int = parameter(
        0, "Episodes of wheel slip, placed where the robot turns.", name="slip.count", minimum=0
    )
    slip_seconds: float = number("slip.seconds", 2.0, "s", "Length of an episode.", 0.01)
    slip_turn_share: float = number("slip.turn_share", 0.125, "1", "Told turn over true turn in an episode.", None)
    slip_distance_share: float = number("slip.distance_share", 1.0, "1", "Told over true distance in an episode.", None)

    clock_start: float = number("clock.start", 1_700_000_000.0, "s", "Time at which the recording starts.", 1.0, 4e9)
    clock_laser_offset: float = number(
        "clock.laser_offset",
        0.0,
        "s",
        "Stamp of scans and clouds minus true time; +0.1: odometry of a stamp is 0.1 s fresher.",
        -60,
        60,
    )
    clock_odometry_offset: float = number("clock.odometry_offset", 0.0, "s", "Odometry stamp minus true time.", -60, 60)
    clock_camera_offset: float = number("clock.camera_offset", 0.0, "s", "Image stamp minus true time.", -60, 60)
    clock_depth_offset: float = number("clock.depth_offset", 0.0, "s", "The same of depth images, further.", -60, 60)
    clock_right_offset: float = number("clock.right_offset", 0.0, "s", "The same of right images, further.", -60, 60)
    clock_imu_offset: float = number("clock.imu_offset", 0.0, "s", "IMU stamp minus true time.", -60, 60)
    clock_laser_jitter: float = number(
        "clock.laser_jitter", 0.0, "s", "Standard deviation of each stamp of a scan or cloud.", 0, 60
    )
    clock_odometry_jitter: float = number("clock.odometry_jitter", 0.0, "s", "The same of odometry stamps.", 0, 60)

    imu_enabled: bool = parameter(False, "Record an IMU on /imu.", name="imu.enabled")
    imu_rate: float = number("imu.rate", 100.0, "Hz", "IMU messages per second.", 0.1, 2000.0)
    imu_gyro_noise: float = number("imu.gyro_noise", 2e-4, "rad/s/sqrt(Hz)", "White noise density of the gyroscope.")
    imu_gyro_bias: float = number("imu.gyro_bias", 0.005, "rad/s", "Standard deviation of its constant bias.")
    imu_accel_noise: float = number("imu.accel_noise", 2e-3, "m/s^2/sqrt(Hz)", "White noise density of acceleration.")
    imu_accel_bias: float = number("imu.accel_bias", 0.05, "m/s^2", "Standard deviation of its constant bias.")
    imu_gyro_walk: float = number("imu.gyro_walk", 0.0, "rad/s^2/sqrt(Hz)", "Random walk of the gyroscope's bias.")
    imu_accel_walk: float = number("imu.accel_walk", 0.0, "m/s^3/sqrt(Hz)", "Random walk of the other's bias.")
    imu_x: float = number("imu.x", 0.0, "m", "Mount, forward of base_link.", None)
    imu_y: float = number("imu.y", 0.0, "m", "Mount, left of base_link.", None)
    imu_z: float = number("imu.z", 0.2, "m", "Mount, above base_link.", None)

    people_count: int = parameter(
        0, "People that walk between random places.", name="people.count", minimum=0, maximum=1000
    )
    people_speed: float = number("people.speed", 0.9, "m/s", "Their mean speed.", 0.05, 10.0)
    people_shape: str = parameter(
        "legs", "What the scanner sees of them.", name="people.shape", choices=("legs", "disc")
    )

    truth_rate: float = number("truth.rate", 50.0, "Hz", "Ground truth messages per second.", 0.1, 1000.0)

    map_resolution: float = number("map.resolution", 0.05, "m", "Cell size of the true map.", 0.005, 5.0)


def resolve_settings(*layers: Mapping[str, Any], source: str = "") -> SimulationParameters:
    """Return the parameters with the values of `layers` (native names) over the defaults; later wins.

    Raises
    ------
    ConfigError
        If a name is unknown (the message names the nearest one), or a value has the wrong type or range.
    """
    known = [d.name for d in declarations(SimulationParameters)]
    for layer in layers:
        for name in layer:
            if name not in known:
                message = unknown_name(name, known, source).split("; `slamcli config show`")[0]
                hint = "" if "did you mean" in message else "; `slamcli generate --list-settings` explains all of them"
                raise ConfigError(message + hint)
    try:
        return resolve(SimulationParameters, *layers, source=source)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}" if source else str(error)) from error
