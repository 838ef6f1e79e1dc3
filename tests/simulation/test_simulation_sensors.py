# SPDX-License-Identifier: MIT
"""Odometry, scanner, IMU and people against exact expectations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.simulation import Simulation, Walker, World, raycast, resolve_settings, shapes
from slamcli.simulation.drive import TICK_S, Motion
from slamcli.simulation.imu import GRAVITY_M_S2, inertial
from slamcli.simulation.odometry import slip_episodes, wheel_poses
from slamcli.simulation.ride import Ride

ROOM = World(
    "room",
    np.concatenate(
        [shapes.rectangle(np.array([0, 0, 10, 6.0])), shapes.box(np.array([7, 4.0]), np.array([1, 0.5]), 0.4)]
    ),
    np.array([[3.0, 4.5, 0.3]]),
    start=(2.0, 2.0, 0.3),
)
EXACT = {
    "laser.noise": 0,
    "laser.dropout": 0,
    "odometry.srr": 0,
    "odometry.srt": 0,
    "odometry.str": 0,
    "odometry.stt": 0,
}


def simulate(duration=20.0, world=ROOM, seed=1, **settings):
    return Simulation(
        world, resolve_settings({k.replace("__", "."): v for k, v in settings.items()}), seed=seed, duration_s=duration
    )


def exact(duration=20.0, world=ROOM, **settings):
    return simulate(duration, world, **{**{k.replace(".", "__"): v for k, v in EXACT.items()}, **settings})


def constant_motion(speed, turn, seconds):
    t = np.arange(round(seconds / TICK_S) + 1) * TICK_S
    yaw = turn * t
    x = speed * t if turn == 0 else speed / turn * np.sin(yaw)
    y = 0 * t if turn == 0 else speed / turn * (1 - np.cos(yaw))
    return Motion(np.column_stack([x, y, yaw]), np.tile([float(speed), float(turn)], (len(t), 1)))


def measured(simulation, topic):
    return [m.measurement for m in simulation.messages() if m.topic == topic]


# Odometry


def test_odometry_without_noise_is_the_true_motion():
    simulation = exact(30.0)
    p0 = simulation.motion.poses[0]
    for message in measured(simulation, "/odom")[::50]:
        t = (message.stamp_ns - 1_700_000_000 * 10**9) / 1e9
        x, y, yaw = simulation.motion.at(np.array([t]))[0] - p0
        c, s = math.cos(p0[2]), math.sin(p0[2])
        np.testing.assert_allclose(message.pose_se2[:2], [c * x + s * y, -s * x + c * y], atol=1e-6)
        assert math.remainder(message.pose_se2[2] - yaw, 2 * math.pi) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("rate", [5.0, 50.0])
@pytest.mark.parametrize(
    ("speed", "turn", "distance_sigma", "heading_sigma"),
    [(1.0, 0.0, 0.05 * math.sqrt(10), 0.02 * math.sqrt(10)), (0.0, 0.5, 0.03 * math.sqrt(5), 0.04 * math.sqrt(5))],
)
def test_odometry_errors_have_the_configured_size_whatever_the_rate(rate, speed, turn, distance_sigma, heading_sigma):
    p = resolve_settings({"odometry.srr": 0.05, "odometry.srt": 0.02, "odometry.str": 0.03, "odometry.stt": 0.04})
    motion = constant_motion(speed, turn, 10.0)
    times = np.arange(int(10 * rate) + 1) / rate
    distances, headings = [], []
    for seed in range(400):
        poses = wheel_poses(Ride(motion, None), times, np.zeros((0, 2)), p, np.random.default_rng(seed))
        forward = np.diff(poses[:, :2], axis=0)
        along = forward[:, 0] * np.cos(poses[:-1, 2]) + forward[:, 1] * np.sin(poses[:-1, 2])
        distances.append(along.sum() - speed * 10)
        headings.append(poses[-1, 2] - turn * 10)
    assert np.std(distances) == pytest.approx(distance_sigma, rel=0.12)
    assert np.std(headings) == pytest.approx(heading_sigma, rel=0.12)
    assert abs(np.mean(distances)) < 4 * distance_sigma / 20
    assert abs(np.mean(headings)) < 4 * heading_sigma / 20


def test_systematic_errors():
    p = resolve_settings({**EXACT, "odometry.distance_scale": 1.1, "odometry.turn_scale": 0.9, "odometry.pull": 0.01})
    times = np.arange(101) / 10
    straight = wheel_poses(
        Ride(constant_motion(1.0, 0.0, 10), None), times, np.zeros((0, 2)), p, np.random.default_rng(0)
    )
    assert np.linalg.norm(np.diff(straight[:, :2], axis=0), axis=1).sum() == pytest.approx(11.0)
    assert straight[-1, 2] == pytest.approx(0.1)
    turning = wheel_poses(
        Ride(constant_motion(0.0, 0.5, 10), None), times, np.zeros((0, 2)), p, np.random.default_rng(0)
    )
    assert turning[-1, 2] == pytest.approx(4.5)


def test_in_a_slip_the_wheels_tell_an_eighth_of_the_turn():
    p = resolve_settings({**EXACT, "slip.count": 2, "slip.seconds": 2.0})
    motion = constant_motion(0.0, 0.4, 20)
    slips = slip_episodes(motion, p, np.random.default_rng(3))
    assert slips.shape == (2, 2)
    assert slips[1, 0] >= slips[0, 1]
    poses = wheel_poses(Ride(motion, None), np.arange(201) / 10, slips, p, np.random.default_rng(0))
    assert poses[-1, 2] == pytest.approx(0.4 * 20 - 2 * 2.0 * 0.4 * 7 / 8, abs=0.4 * 0.2)


def test_slips_happen_where_the_robot_turns_and_no_more_than_fit():
    simulation = simulate(60.0, slip__count=5)
    assert len(simulation.slips_s) == 5
    rates = [np.abs(simulation.motion.speeds_at(np.linspace(a, b, 20))[:, 1]).max() for a, b in simulation.slips_s]
    assert min(rates) > 0.05
    assert len(simulate(5.0, slip__count=50).slips_s) < 4


# Scanner


def test_a_scan_at_rest_equals_the_naive_twin():
    simulation = exact(2.0, laser__x=0.2, laser__y=-0.1, laser__yaw=30, laser__beams=91)
    scan = measured(simulation, "/scan")[0]
    x, y, yaw = 2.0, 2.0, 0.3
    origin = np.array([x + 0.2 * math.cos(yaw) + 0.1 * math.sin(yaw), y + 0.2 * math.sin(yaw) - 0.1 * math.cos(yaw)])
    for beam in range(91):
        angle = yaw + math.radians(30) + math.radians(-90 + 2 * beam)
        assert scan.angles_rad[beam] == pytest.approx(math.radians(-90 + 2 * beam))
        step = np.array([[math.cos(angle), math.sin(angle)]])
        wanted = raycast.cast(ROOM, origin[None], step, 30.0)[0]
        assert scan.ranges_m[beam] == pytest.approx(wanted, abs=1e-5)


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("clockwise", [False, True])
def test_points_lie_on_walls_through_tf_however_it_is_mounted(upside_down, clockwise):
    from slamcli.geometry import se3

    simulation = exact(
        15.0, laser__upside_down=upside_down, laser__clockwise=clockwise, laser__yaw=-40, laser__x=0.15, laser__y=0.05,
        laser__fov=270, laser__sweep=0,
    )  # fmt: skip
    mount = measured(simulation, "/tf_static")[0]
    T_base_laser = se3.from_position_quaternion(mount.position_m, mount.quat_xyzw)
    truth = simulation.truth()
    scans = measured(simulation, "/scan")
    assert (scans[0].angle_increment_rad < 0) == clockwise
    for i in range(0, len(scans), 30):
        r, a = scans[i].ranges_m.astype(np.float64), scans[i].angles_rad
        points = np.column_stack([r * np.cos(a), r * np.sin(a), 0 * r, np.ones_like(r)])
        points_map = points @ (se3.from_se2(truth.poses_se2[i]) @ T_base_laser).T
        assert raycast.clearance(ROOM, points_map[:, :2].copy()).max() < 1e-5


def test_motion_distortion_is_real():
    simulation = exact(20.0, laser__fov=360, laser__beams=360, laser__sweep=0.1)
    scan_times = simulation.scan_times_s
    turning = int(np.argmax(np.abs(simulation.motion.speeds_at(scan_times)[:, 1])))
    scan, t0 = measured(simulation, "/scan")[turning], scan_times[turning]
    assert scan.time_increment_s == pytest.approx(0.1 / 360)
    base = simulation.motion.at(t0 + np.arange(360) * scan.time_increment_s)
    a = base[:, 2] + scan.angles_rad
    at = lambda pose, angle: np.column_stack([  # noqa: E731
        pose[:, 0] + 0.1 * np.cos(pose[:, 2]) + scan.ranges_m * np.cos(angle),
        pose[:, 1] + 0.1 * np.sin(pose[:, 2]) + scan.ranges_m * np.sin(angle),
    ])  # fmt: skip
    assert raycast.clearance(ROOM, at(base, a)).max() < 1e-5
    still = np.tile(base[0], (360, 1))
    assert raycast.clearance(ROOM, at(still, still[:, 2] + scan.angles_rad)).max() > 0.05


def test_range_noise_dropouts_and_limits():
    simulation = simulate(20.0, laser__noise=0.03, laser__noise_relative=0.02, laser__dropout=0.05, robot__rest=19.0)
    ranges = np.array([s.ranges_m for s in measured(simulation, "/scan")[:180]], dtype=np.float64)
    true_m = simulation._scanner().true_ranges(0.0)
    assert np.isnan(ranges).mean() == pytest.approx(0.05, abs=0.005)
    errors = (ranges - true_m) / np.hypot(0.03, 0.02 * true_m)
    assert np.nanstd(errors, axis=0).mean() == pytest.approx(1.0, abs=0.02)
    assert np.abs(np.nanmean(errors, axis=0)).max() < 4.5 / math.sqrt(0.95 * 180)


@pytest.mark.parametrize(("name", "value"), [("nan", np.nan), ("inf", np.inf), ("zero", 0.0), ("max", 3.0)])
def test_what_beams_without_return_read(name, value):
    far = measured(exact(1.0, laser__range_max=3.0, laser__no_return=name), "/scan")[0].ranges_m
    plain = measured(exact(1.0), "/scan")[0].ranges_m
    np.testing.assert_array_equal(far[plain > 3.001], np.float32(value))
    np.testing.assert_array_equal(far[plain < 2.999], plain[plain < 2.999])
    lost = measured(exact(1.0, laser__dropout=1.0, laser__dropout_value=name, laser__range_max=3.0), "/scan")[
        0
    ].ranges_m
    np.testing.assert_array_equal(lost, np.float32(value))


def test_too_near_is_minus_infinity_and_rounding_works():
    near = measured(exact(1.0, laser__range_min=2.0), "/scan")[0].ranges_m
    plain = measured(exact(1.0), "/scan")[0].ranges_m
    np.testing.assert_array_equal(np.isneginf(near), plain < 2.0)
    rounded = measured(exact(1.0, laser__resolution=0.25), "/scan")[0].ranges_m
    np.testing.assert_array_equal(rounded % 0.25, 0)


@pytest.mark.parametrize(
    ("fov", "beams", "step"), [(180, 181, 1.0), (360, 360, 1.0), (240, 682, 240 / 681), (0, 1, None)]
)
def test_fan(fov, beams, step):
    scan = measured(exact(1.0, laser__fov=fov, laser__beams=beams), "/scan")[0]
    assert scan.num_beams == beams
    assert scan.angle_min_rad == pytest.approx(-math.radians(fov / 2))
    if step:
        assert math.degrees(scan.angle_increment_rad) == pytest.approx(step)


# IMU


def test_imu_at_rest_feels_gravity_and_nothing_else():
    quiet = {"imu.gyro_noise": 0, "imu.accel_noise": 0, "imu.gyro_bias": 0, "imu.accel_bias": 0}
    angular, force = inertial(
        Ride(constant_motion(0, 0, 5), None), np.arange(500) / 100, resolve_settings(quiet), np.random.default_rng(1)
    )
    np.testing.assert_array_equal(angular, 0)
    np.testing.assert_allclose(force, [[0, 0, GRAVITY_M_S2]] * 500)


def test_imu_on_a_circle_and_its_lever_arm():
    quiet = {
        "imu.gyro_noise": 0,
        "imu.accel_noise": 0,
        "imu.gyro_bias": 0,
        "imu.accel_bias": 0,
        "imu.x": 0.3,
        "imu.y": 0.1,
    }
    angular, force = inertial(
        Ride(constant_motion(1.5, 0.8, 5), None),
        np.arange(400) / 100,
        resolve_settings(quiet),
        np.random.default_rng(1),
    )
    np.testing.assert_allclose(angular, [[0, 0, 0.8]] * 400)
    np.testing.assert_allclose(force, [[-0.64 * 0.3, 1.5 * 0.8 - 0.64 * 0.1, GRAVITY_M_S2]] * 400, atol=1e-12)


def test_imu_noise_and_bias_have_the_configured_size():
    p = resolve_settings({"imu.gyro_noise": 0.01, "imu.accel_noise": 0.05, "imu.gyro_bias": 0.2, "imu.accel_bias": 0.5})
    times = np.arange(2000) / 100
    runs = [inertial(Ride(constant_motion(0, 0, 20), None), times, p, np.random.default_rng(s)) for s in range(60)]
    assert np.mean([a.std(axis=0) for a, _ in runs]) == pytest.approx(0.01 * 10, rel=0.02)
    assert np.mean([f.std(axis=0) for _, f in runs]) == pytest.approx(0.05 * 10, rel=0.02)
    assert np.std([a.mean(axis=0) for a, _ in runs]) == pytest.approx(0.2, rel=0.2)


def test_the_gyro_integrates_to_the_turn_that_was_made():
    simulation = simulate(30.0, imu__enabled=True, imu__gyro_noise=0, imu__gyro_bias=0)
    rates = np.array([m.angular_rad_s[2] for m in measured(simulation, "/imu")])
    assert rates.sum() / 100 == pytest.approx(simulation.motion.poses[-1, 2] - simulation.motion.poses[0, 2], abs=0.01)


# People


def test_people_change_scans_and_nothing_else():
    alone, watched = simulate(30.0, seed=4), simulate(30.0, seed=4, people__count=4)
    np.testing.assert_array_equal(alone.motion.poses, watched.motion.poses)
    for a, b in zip(measured(alone, "/odom"), measured(watched, "/odom"), strict=True):
        np.testing.assert_array_equal(a.position_m, b.position_m)
    changed = 0
    for a, b in zip(measured(alone, "/scan"), measured(watched, "/scan"), strict=True):
        differ = ~((a.ranges_m == b.ranges_m) | (np.isnan(a.ranges_m) & np.isnan(b.ranges_m)))
        changed += int(differ.sum())
        assert (b.ranges_m[differ] < a.ranges_m[differ] + 0.1).all()
    assert changed > 1000


def test_the_imu_changes_nothing_else():
    plain, with_imu = simulate(5.0), simulate(5.0, imu__enabled=True)
    for a, b in zip(measured(plain, "/scan"), measured(with_imu, "/scan"), strict=True):
        np.testing.assert_array_equal(a.ranges_m, b.ranges_m)


def test_people_walk_clear_of_walls_and_of_the_robot():
    simulation = simulate(60.0, people__count=5, people__speed=1.2, seed=2)
    robot = simulation.motion.at(np.arange(0, 60.0, 0.05))[:, :2]
    for track in simulation.crowd.tracks:
        assert raycast.clearance(ROOM, track[:, :2].copy()).min() > 0.15
        assert np.linalg.norm(track[: len(robot), :2] - robot, axis=1).min() > 0.25
        assert np.ptp(track[:, :2], axis=0).max() > 2
        assert np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1).max() < 0.25


def test_walkers_of_the_world_go_to_and_fro():
    world = World("w", ROOM.segments, start=(2, 1, 0), walkers=(Walker(np.array([[5, 5], [9, 5.0]]), 1.0),))
    track = simulate(20.0, world).crowd.tracks[0]
    assert track[:, 0].min() == pytest.approx(5, abs=0.1)
    assert track[:, 0].max() == pytest.approx(9, abs=0.1)


def test_legs_are_two_discs_a_stride_apart():
    legs = simulate(20.0, people__count=1).crowd.discs(7.3)
    assert legs.shape == (2, 5)
    assert 0.15 < np.linalg.norm(legs[0, :2] - legs[1, :2]) < 0.6
    assert simulate(20.0, people__count=1, people__shape="disc").crowd.discs(7.3).shape == (1, 5)
