# SPDX-License-Identifier: MIT
"""The spinning scanner and the robot on uneven ground: geometry, times, noise, and an IMU that agrees with the truth."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.errors import ConfigError, UsageError
from slamcli.geometry import quaternion
from slamcli.grids import OccupancyGrid
from slamcli.measurements import ImuSample, LaserScan, Odometry, PointCloud
from slamcli.simulation import Simulation, Walker, World, relief, resolve_settings, shapes
from slamcli.simulation.drive import TICK_S, Motion
from slamcli.simulation.imu import GRAVITY_M_S2, inertial
from slamcli.simulation.odometry import wheel_poses
from slamcli.simulation.relief import Relief, Terrain, flat_relief
from slamcli.simulation.ride import Ride

ROOM = World("room", shapes.rectangle(np.array([0, 0, 8, 5.0])), start=(2, 2, 0))
EXACT = {"lidar3d.enabled": True, "laser.enabled": False, "lidar3d.noise": 0.0, "lidar3d.dropout": 0.0}
SMALL = {"lidar3d.columns": 90, "lidar3d.rings": 4, "lidar3d.lowest": -20.0, "lidar3d.highest": 10.0}


def simulate(world=ROOM, duration=3.0, seed=1, **settings):
    values = {**EXACT, **SMALL, **{k.replace("__", "."): v for k, v in settings.items()}}
    return Simulation(world, resolve_settings(values), seed=seed, duration_s=duration)


def clouds(simulation):
    return [m.measurement for m in simulation.messages() if m.topic == "/points"]


def in_map(simulation, cloud, time_s):
    """Points of a cloud in the map, each by the true pose of the sensor at its own time."""
    positions, rotations = simulation.ride.at(time_s + cloud.offset_ns / 1e9)
    mount, quat = simulation._spinner().mount()
    at_base = cloud.points_m @ quaternion.to_matrix(quat).T + mount
    return (rotations @ at_base[:, :, None])[:, :, 0] + positions


def hilly():
    ground = relief.raise_hills(Terrain(np.zeros((81, 81)), 0.25, -6.0, -7.0), 1.5, 4.0, 3)
    walls = shapes.rectangle(np.array([-4, -5, 12, 11.0]))
    panels = np.column_stack([walls, np.tile([-1.0, 6.0, 0.6], (4, 1))])
    way = np.array([[0.0, 0.0], [8.0, 1.0], [7.0, 7.0], [0.0, 6.0], [0.0, 0.0]])
    return World("hills", walls, waypoints=way, start=(0, 0, 0.1), relief=Relief(ground, panels=panels))


def test_every_point_lies_on_a_wall_or_the_floor_although_the_robot_turns():
    simulation = simulate(duration=6.0)
    for cloud, time_s in zip(clouds(simulation), simulation.cloud_times_s, strict=True):
        x, y, z = in_map(simulation, cloud, time_s).T
        off = np.min([np.abs(x), np.abs(x - 8), np.abs(y), np.abs(y - 5), np.abs(z)], axis=0)
        assert off.max() < 2e-6
        assert z.max() <= relief.WALL_HEIGHT_M + 1e-6
    assert np.ptp(simulation.motion.poses[:, 2]) > 0.3


def test_points_on_hills_lie_on_the_triangles_of_the_ground():
    world = hilly()
    simulation = simulate(world, duration=20.0, imu__enabled=True)
    tilts = np.degrees(quaternion.to_roll_pitch_yaw(simulation.truth().quats_xyzw))
    assert np.abs(tilts[:, 0]).max() > 3
    assert np.abs(tilts[:, 1]).max() > 3
    for cloud, time_s in list(zip(clouds(simulation), simulation.cloud_times_s, strict=True))[::20]:
        x, y, z = in_map(simulation, cloud, time_s).T
        inside = np.min([x + 4, 12 - x, y + 5, 11 - y], axis=0) > 1e-5
        surface = world.relief.ground.at(np.column_stack([x, y])[inside])
        assert np.abs(z[inside] - surface).max() < 0.05  # the triangles cut the smooth surface
        assert inside.sum() > 50


def test_rings_times_and_order():
    cloud = clouds(simulate())[0]
    assert cloud.rings.max() == 3
    column = np.rint(cloud.offset_ns / 1e8 * 90).astype(int)
    assert (np.diff(column * 4 + cloud.rings) > 0).all()
    assert cloud.offset_ns.max() < 100_000_000
    elevation = np.degrees(np.arcsin(cloud.points_m[:, 2] / np.linalg.norm(cloud.points_m, axis=1)))
    np.testing.assert_allclose(elevation, np.linspace(-20, 10, 4)[cloud.rings], atol=1e-4)
    azimuth = np.degrees(np.arctan2(cloud.points_m[:, 1], cloud.points_m[:, 0])) % 360
    np.testing.assert_allclose(azimuth, column * 4.0, atol=1e-4)


def test_clockwise_and_given_angles():
    cloud = clouds(simulate(lidar3d__clockwise=True, lidar3d__angles="5, -30,0"))[0]
    column = np.rint(cloud.offset_ns / 1e8 * 90).astype(int)
    azimuth = np.degrees(np.arctan2(cloud.points_m[:, 1], cloud.points_m[:, 0])) % 360
    np.testing.assert_allclose(azimuth, -column * 4.0 % 360, atol=1e-4)
    elevation = np.degrees(np.arcsin(cloud.points_m[:, 2] / np.linalg.norm(cloud.points_m, axis=1)))
    np.testing.assert_allclose(elevation, np.array([-30, 0, 5])[cloud.rings], atol=1e-4)


def test_organised_clouds_hold_the_same_points():
    loose = clouds(simulate(lidar3d__dropout=0.2))
    for cloud, other in zip(clouds(simulate(lidar3d__dropout=0.2, lidar3d__organised=True)), loose, strict=True):
        assert cloud.shape == (4, 90)
        np.testing.assert_array_equal(cloud.cells // 90, cloud.rings)
        np.testing.assert_array_equal(cloud.points_m, other.points_m)
        assert 0.6 < len(cloud.points_m) / 360 < 0.9


def test_noise_dropouts_and_intensities_have_the_configured_size():
    exact = clouds(simulate(lidar3d__intensity_noise=0))
    noisy = clouds(simulate(lidar3d__noise=0.05, lidar3d__intensity_noise=4))
    errors = [
        np.linalg.norm(b.points_m, axis=1) - np.linalg.norm(a.points_m, axis=1)
        for a, b in zip(exact, noisy, strict=True)
    ]
    assert np.concatenate(errors).std() == pytest.approx(0.05, rel=0.05)
    floor = exact[0].points_m[:, 2] < -0.799
    down = -exact[0].points_m[floor, 2] / np.linalg.norm(exact[0].points_m[floor], axis=1)
    np.testing.assert_allclose(exact[0].intensities[floor], np.rint(255 * relief.GROUND * down), atol=1)
    dropped = clouds(simulate(lidar3d__dropout=0.3))
    assert sum(len(c.points_m) for c in dropped) / sum(len(c.points_m) for c in exact) == pytest.approx(0.7, abs=0.02)


def test_one_seed_gives_one_stream_and_other_sensors_do_not_change_it():
    first, again, other = (clouds(simulate(seed=s, lidar3d__noise=0.02)) for s in (4, 4, 5))
    with_imu = clouds(simulate(seed=4, lidar3d__noise=0.02, imu__enabled=True, laser__enabled=True))
    for a, b, c, d in zip(first, again, with_imu, other, strict=True):
        assert a.points_m.tobytes() == b.points_m.tobytes() == c.points_m.tobytes()
        assert a.points_m.tobytes() != d.points_m.tobytes()


def test_people_are_seen_in_space():
    walker = Walker(np.array([[5.0, 1.0], [5.0, 4.0]]), 0.5)
    world = World("room", ROOM.segments, start=(2, 2, 0), walkers=(walker,))
    for shape in ("legs", "disc"):
        near = [np.linalg.norm(c.points_m[:, :2], axis=1).min() for c in clouds(simulate(world, people__shape=shape))]
        alone = [np.linalg.norm(c.points_m[:, :2], axis=1).min() for c in clouds(simulate())]
        seen = sum(
            len(a.points_m) - (np.abs(a.points_m - b.points_m).max(axis=1) < 1e-6).sum()
            for a, b in zip(clouds(simulate(world, people__shape=shape)), clouds(simulate()), strict=True)
            if len(a.points_m) == len(b.points_m)
        )
        assert seen > 10
        assert min(near) <= min(alone)


def test_the_imu_carries_the_robot_to_where_it_truly_is():
    """Strapdown integration of a perfect IMU follows the truth over hills for ten seconds."""
    world = hilly()
    settings = {"imu.enabled": True, "imu.rate": 100.0, "imu.gyro_noise": 0, "imu.gyro_bias": 0, "imu.accel_noise": 0}
    simulation = simulate(world, duration=10.0, **{**settings, "imu.accel_bias": 0, "imu.x": 0.3, "imu.z": 0.2})
    samples = [m.measurement for m in simulation.messages() if isinstance(m.measurement, ImuSample)]
    lever = np.array([0.3, 0.0, 0.2])
    positions, rotations = simulation.ride.at(np.arange(len(samples)) * 0.01)
    truth = positions + rotations @ lever
    turn, place, speed = Rotation.from_matrix(rotations[0]), truth[0], np.zeros(3)
    for now, after in itertools.pairwise(samples):
        step = Rotation.from_rotvec((now.angular_rad_s + after.angular_rad_s) / 2 * 0.01)
        pull = (turn.apply(now.acceleration_m_s2) + (turn * step).apply(after.acceleration_m_s2)) / 2 - [
            0,
            0,
            GRAVITY_M_S2,
        ]
        place, speed, turn = place + speed * 0.01 + pull * 0.5e-4, speed + pull * 0.01, turn * step
    assert np.linalg.norm(truth[-1] - truth[0]) > 1.5
    assert np.linalg.norm(place - truth[-1]) < 0.01
    assert np.degrees((turn.inv() * Rotation.from_matrix(rotations[-1])).magnitude()) < 0.02


def test_gravity_tilts_with_the_robot():
    slope = Terrain(np.tile(np.arange(41) * 0.25 * 0.2, (41, 1)), 0.25, 0.0, 0.0)
    ride = Ride(Motion(np.tile([5.0, 5.0, 0.0], (301, 1)), np.zeros((301, 2))), slope)
    zero = {"imu.gyro_noise": 0, "imu.gyro_bias": 0, "imu.accel_noise": 0, "imu.accel_bias": 0}
    _, force = inertial(ride, np.array([1.0]), resolve_settings(zero), np.random.default_rng(0))
    expected = GRAVITY_M_S2 * np.array([0.2, 0.0, 1.0]) / np.hypot(1.0, 0.2)
    np.testing.assert_allclose(force[0], expected, atol=1e-6)
    _, rotations = ride.at(np.array([1.0]))
    assert np.degrees(quaternion.to_roll_pitch_yaw(quaternion.from_matrix(rotations))[0, 1]) == pytest.approx(
        -11.31, abs=0.01
    )


def test_wheels_roll_the_way_along_the_slope():
    slope = Terrain(np.tile(np.arange(41) * 0.25 * 0.75, (41, 1)), 0.25, 0.0, 0.0)
    poses = np.column_stack([np.linspace(3, 7, 401), np.full(401, 5.0), np.zeros(401)])
    quiet = resolve_settings({"odometry.srr": 0, "odometry.srt": 0, "odometry.str": 0, "odometry.stt": 0})
    times = np.arange(0, 401, 5) * TICK_S
    told = wheel_poses(
        Ride(Motion(poses, np.zeros((401, 2))), slope), times, np.zeros((0, 2)), quiet, np.random.default_rng(0)
    )
    assert told[-1, 0] == pytest.approx(5.0, abs=1e-6)


def test_truth_and_planar_scans_tilt_with_the_robot():
    simulation = simulate(hilly(), duration=8.0, laser__enabled=True, laser__noise=0, laser__dropout=0, laser__z=0.3)
    messages = list(simulation.messages())
    truth = [m.measurement for m in messages if isinstance(m.measurement, Odometry) and m.topic == "/ground_truth"]
    assert max(abs(t.position_m[2] - truth[0].position_m[2]) for t in truth) > 0.1
    scan = next(m.measurement for m in messages if isinstance(m.measurement, LaserScan))
    flat = Simulation(
        World("flat", hilly().segments, start=(0, 0, 0.1), waypoints=hilly().waypoints),
        resolve_settings({"laser.noise": 0, "laser.dropout": 0}),
        duration_s=8.0,
    )
    level = next(m.measurement for m in flat.messages() if isinstance(m.measurement, LaserScan))
    assert np.nanmax(np.abs(scan.ranges_m - level.ranges_m)) > 0.5
    np.testing.assert_array_equal(
        simulation.truth().stamps_ns, [m.measurement.stamp_ns for m in messages if m.topic == "/scan"]
    )


def test_a_world_without_heights_gets_walls_of_two_and_a_half_metres():
    made = flat_relief(ROOM.segments, np.array([[1.0, 1.0, 0.2]]), ROOM.bounds)
    assert made.panels[:, 5].tolist() == [2.5] * 4
    assert made.cylinders[:, 4].tolist() == [2.5]


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"lidar3d.range_min": 90.0}, UsageError, "lidar3d.range_min 90 m is not below"),
        ({"lidar3d.enabled": False}, UsageError, "a robot without sensors"),
        ({"lidar3d.angles": "1,two"}, ConfigError, "lidar3d.angles"),
        ({"lidar3d.angles": "1,200"}, ConfigError, "from -90 to 90"),
        ({"lidar3d.rate": 0.1}, UsageError, "no scan fits"),
    ],
)
def test_settings_that_make_no_sense(settings, error, message):
    with pytest.raises(error, match=message):
        list(simulate(**settings).messages())


def test_cells_of_a_grid_have_no_heights():
    grid = OccupancyGrid(np.zeros((20, 20), np.int8), 0.5, (0.0, 0.0, 0.0))
    with pytest.raises(ConfigError, match="have no heights"):
        simulate(World("map", grid=grid))


def test_point_clouds_are_logged_when_the_revolution_is_complete():
    messages = [m for m in simulate().messages() if isinstance(m.measurement, PointCloud)]
    assert {m.log_time_ns - m.measurement.stamp_ns for m in messages} == {100_000_000}
