# SPDX-License-Identifier: MIT
"""A robot that obeys velocities moves as its wheels let it, and its odometry errs as it is told to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import ConfigError, UsageError
from slamcli.geometry import se2
from slamcli.simulation import World, resolve_settings
from slamcli.simulation.plant import TICK_S, Plant

pytestmark = pytest.mark.kernels
HALL = World(
    name="hall", segments=np.array([[-50.0, -50, 50, -50], [50, -50, 50, 50], [50, 50, -50, 50], [-50, 50, -50, -50]])
)
QUICK = {"robot.forward_acceleration": 1e5, "robot.sideways_acceleration": 1e5, "robot.swing_acceleration": 1e5}
NO_ERRORS = {f"odometry.{name}": 0.0 for name in ("srr", "srt", "str", "stt")}


def plant(settings=None, start=(0.0, 0.0, 0.0), seed=0, world=HALL):
    return Plant(world, resolve_settings({"laser.beams": 4, **(settings or {})}), start=np.array(start), seed=seed)


def drive(robot, twist, seconds, period=0.1):
    for _ in range(round(seconds / period)):
        robot.command(np.array(twist))
        robot.advance(period)


@pytest.mark.parametrize("turn", [0.0, 0.4, -1.1])
def test_a_constant_twist_is_an_arc(turn):
    robot = plant({**QUICK, **NO_ERRORS}, (1.0, 2.0, 0.5))
    drive(robot, (0.8, 0.0, turn), 3.0)
    radius, angle = (0.8 / turn, 3.0 * turn) if turn else (0.0, 0.0)
    step = [radius * math.sin(angle), radius * (1 - math.cos(angle)), angle] if turn else [2.4, 0.0, 0.0]
    np.testing.assert_allclose(robot.pose, se2.compose([1.0, 2.0, 0.5], step), atol=1e-9)
    np.testing.assert_allclose(robot.odom_pose, se2.compose([0.0, 0.0, 0.0], step), atol=2e-2)
    np.testing.assert_allclose(robot.twist, [0.8, 0.0, turn], atol=1e-12)


def test_an_omnidirectional_robot_goes_sideways_and_a_differential_one_does_not():
    omni = plant({**QUICK, "robot.drive": "omni", "robot.max_sideways": 0.5})
    drive(omni, (0.3, 0.9, 0.0), 2.0)
    np.testing.assert_allclose(omni.pose, [0.6, 1.0, 0.0], atol=1e-9)
    diff = plant(QUICK)
    drive(diff, (0.3, 0.9, 0.0), 2.0)
    np.testing.assert_allclose(diff.pose, [0.6, 0.0, 0.0], atol=1e-9)


def test_acceleration_is_a_ramp():
    robot = plant({"robot.forward_acceleration": 0.5, "robot.swing_acceleration": 1.0, "robot.max_turn": 0.6})
    speeds, turns = [], []
    for _ in range(200):
        robot.command(np.array([0.8, 0.0, 2.0]))
        robot.advance(TICK_S)
        speeds.append(robot.twist[0])
        turns.append(robot.twist[2])
    at = np.arange(1, 201) * TICK_S
    np.testing.assert_allclose(speeds, np.minimum(0.5 * at, 0.8), atol=1e-9)
    np.testing.assert_allclose(turns, np.minimum(1.0 * at, 0.6), atol=1e-9)


def test_a_car_turns_about_its_rear_axle_no_tighter_than_its_steering():
    settings = {**QUICK, "robot.drive": "car", "robot.wheelbase": 0.5, "robot.max_steering": 30.0}
    car = plant({**settings, "robot.steering_rate": 1e4})
    drive(car, (0.5, 0.0, 3.0), 4.0)
    radius = 0.5 / math.tan(math.radians(30.0))
    angle = 4.0 * 0.5 / radius
    np.testing.assert_allclose(car.pose[:2], [radius * math.sin(angle), radius * (1 - math.cos(angle))], atol=1e-6)
    standing = plant(settings)
    drive(standing, (0.0, 0.0, 1.0), 2.0)
    np.testing.assert_array_equal(standing.pose, np.zeros(3))


def test_a_car_steers_no_quicker_than_it_can():
    car = plant({**QUICK, "robot.drive": "car", "robot.wheelbase": 0.5, "robot.steering_rate": 10.0})
    drive(car, (0.5, 0.0, 3.0), 1.0)
    assert car.twist[2] == pytest.approx(0.5 * math.tan(math.radians(10.0)) / 0.5, abs=1e-9)


def test_commands_act_after_the_latency():
    robot = plant({**QUICK, "robot.latency": 0.2})
    robot.command(np.array([0.5, 0.0, 0.0]))
    robot.advance(0.1)
    robot.command(np.array([0.7, 0.0, 0.0]))
    robot.advance(0.1)
    assert robot.pose[0] == 0.0
    robot.advance(0.1)
    assert robot.pose[0] == pytest.approx(0.05)
    robot.advance(0.1)
    assert robot.pose[0] == pytest.approx(0.05 + 0.07)


def test_a_robot_that_hears_nothing_stops():
    robot = plant({**QUICK, "robot.command_timeout": 0.5})
    robot.command(np.array([0.5, 0.0, 0.0]))
    robot.advance(2.0)
    assert robot.pose[0] == pytest.approx(0.5 * 0.51, abs=0.011)
    np.testing.assert_array_equal(robot.twist, np.zeros(3))


def test_backward_has_its_own_limit():
    robot = plant({**QUICK, "robot.max_backward": 0.1})
    drive(robot, (-1.0, 0.0, 0.0), 1.0)
    assert robot.pose[0] == pytest.approx(-0.1)


def test_time_passes_the_same_in_long_and_short_steps():
    settings = {"slip.rate": 30.0, "slip.drift": 0.05, "people.count": 3}
    small = World(name="small", segments=HALL.segments / 12)
    long, short = plant(settings, seed=3, world=small), plant(settings, seed=3, world=small)
    for _ in range(20):
        for robot in (long, short):
            robot.command(np.array([0.5, 0.0, 0.4]))
        long.advance(0.37)
        for _ in range(37):
            short.advance(TICK_S)
        assert long.pose.tobytes() == short.pose.tobytes()
        assert long.odom_pose.tobytes() == short.odom_pose.tobytes()
        assert long.discs().tobytes() == short.discs().tobytes()
    assert long.time_s == pytest.approx(7.4)
    assert long.stamp_ns - plant().stamp_ns == 7_400_000_000


def test_odometry_errs_with_the_standard_deviations_of_its_settings():
    ends = []
    for seed in range(150):
        robot = plant({**QUICK, "odometry.srr": 0.03, "odometry.srt": 0.0, "odometry.str": 0.0}, seed=seed)
        drive(robot, (1.0, 0.0, 0.0), 4.0, period=0.4)
        ends.append(robot.odom_pose)
    assert np.std(np.array(ends)[:, 0]) == pytest.approx(0.03 * 2.0, rel=0.2)
    assert np.mean(np.array(ends)[:, 0]) == pytest.approx(4.0, abs=0.02)
    headings = []
    for seed in range(150):
        robot = plant({**QUICK, "odometry.stt": 0.05}, seed=seed)
        drive(robot, (0.0, 0.0, 0.5), 4.0, period=0.4)
        headings.append(robot.odom_pose[2])
    assert np.std(headings) == pytest.approx(0.05 * math.sqrt(2.0), rel=0.2)


def test_scales_and_pull_are_told_by_pose_and_twist():
    wrong = {"odometry.distance_scale": 1.1, "odometry.turn_scale": 0.9, "odometry.pull": 0.02}
    robot = plant({**QUICK, **NO_ERRORS, **wrong})
    drive(robot, (0.5, 0.0, 0.0), 2.0)
    assert robot.odom_twist[0] == pytest.approx(0.55)
    assert robot.odom_twist[2] == pytest.approx(0.02 * 0.5)
    assert robot.odom_pose[2] == pytest.approx(0.02)
    assert math.hypot(*robot.odom_pose[:2]) == pytest.approx(1.1, rel=1e-3)


def test_slip_shortens_what_is_told_of_turns():
    slipping = {"slip.rate": 600.0, "slip.seconds": 100.0, "slip.turn_share": 0.125}
    robot = plant({**QUICK, **NO_ERRORS, **slipping}, seed=1)
    drive(robot, (0.0, 0.0, 0.5), 5.0)
    assert 0.125 * 2.5 <= robot.odom_pose[2] < 0.5
    steady = plant({**QUICK, **NO_ERRORS, "slip.rate": 0.0})
    drive(steady, (0.0, 0.0, 0.5), 5.0)
    assert steady.odom_pose[2] == pytest.approx(2.5)


def test_drift_of_slip_comes_and_goes_with_its_deviation():
    robot = plant({**QUICK, **NO_ERRORS, "slip.drift": 0.1, "slip.drift_time": 0.5}, seed=2)
    told = []
    for _ in range(400):
        robot.command(np.array([0.0, 0.0, 1.0]))
        robot.advance(0.5)
        told.append(robot.odom_twist[2] - 1.0)
    assert np.std(told) == pytest.approx(0.1, rel=0.15)
    assert abs(np.corrcoef(told[:-1], told[1:])[0, 1] - math.exp(-1.0)) < 0.15


def test_the_odometry_message_and_its_past():
    robot = plant({**QUICK, **NO_ERRORS})
    drive(robot, (0.5, 0.0, 0.2), 1.0)
    message = robot.odometry()
    np.testing.assert_allclose(message.pose_se2, robot.odom_pose, atol=1e-12)
    np.testing.assert_allclose([message.linear_m_s[0], message.angular_rad_s[2]], [0.5, 0.2], atol=1e-9)
    assert (message.frame_id, message.child_frame_id, message.stamp_ns) == ("odom", "base_link", robot.stamp_ns)
    np.testing.assert_array_equal(robot.odom_pose_at(robot.stamp_ns), robot.odom_pose)
    assert robot.odom_pose_at(robot.stamp_ns - 500_000_000)[2] == pytest.approx(0.1)
    assert robot.odom_pose_at(robot.stamp_ns - 505_000_000)[2] == pytest.approx(0.099)
    assert robot.odom_pose_at(robot.stamp_ns + 10**9)[2] == pytest.approx(0.2)


def test_stamps_are_off_as_the_clocks_are():
    clocks = {"clock.laser_offset": 0.1, "clock.odometry_offset": -0.2, "laser.sweep": 0.0}
    steady = plant(clocks)
    assert steady.scan().stamp_ns == steady.stamp_ns + 100_000_000
    assert steady.odometry().stamp_ns == steady.stamp_ns - 200_000_000
    shaky = plant({"clock.laser_jitter": 0.01, "clock.odometry_jitter": 0.02, "laser.sweep": 0.0})
    late = np.array([[shaky.scan().stamp_ns, shaky.odometry().stamp_ns] for _ in range(300)]) - shaky.stamp_ns
    np.testing.assert_allclose(late.std(axis=0), [1e7, 2e7], rtol=0.15)


def test_a_kidnapped_robot_is_elsewhere_and_its_odometry_does_not_know():
    robot = plant(QUICK, seed=1)
    drive(robot, (0.5, 0.0, 0.2), 1.0)
    told = robot.odom_pose
    robot.teleport(np.array([-3.0, 4.0, 2.0]))
    np.testing.assert_array_equal(robot.pose, [-3.0, 4.0, 2.0])
    np.testing.assert_array_equal(robot.odom_pose, told)
    robot.advance(0.1)
    np.testing.assert_array_equal(robot.pose, [-3.0, 4.0, 2.0])
    with pytest.raises(UsageError, match=r"the robot at 49.9, 0 \(yaw 0 rad\) touches a wall"):
        robot.teleport(np.array([49.9, 0.0, 0.0]))


def test_what_makes_no_sense_is_refused():
    with pytest.raises(UsageError, match="touches a wall"):
        plant(start=(50.0, 0.0, 0.0))
    with pytest.raises(UsageError, match="not three finite numbers"):
        plant(start=(math.nan, 0.0, 0.0))
    with pytest.raises(UsageError, match=r"laser.range_min 5 m is not below"):
        plant({"laser.range_min": 5.0, "laser.range_max": 5.0})
    with pytest.raises(ConfigError, match="footprint"):
        plant({"robot.footprint": "[[0, 0], [1, 0]]"})
    robot = plant({"robot.latency": 10.0})
    for twist in ([math.nan, 0.0, 0.0], [1.0, 2.0]):
        with pytest.raises(UsageError, match="not three finite velocities"):
            robot.command(np.array(twist))
    for seconds in (-0.01, 0.005):
        with pytest.raises(UsageError, match=r"give a multiple of 0.01 s"):
            robot.advance(seconds)
    for _ in range(4096):
        robot.command(np.zeros(3))
    with pytest.raises(UsageError, match=r"4096 commands wait for robot\.latency 10 s"):
        robot.command(np.zeros(3))
