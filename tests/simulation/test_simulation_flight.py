# SPDX-License-Identifier: MIT
"""Carried rigs: smooth motion that the IMU agrees with, and paths of world files."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.errors import ConfigError, UsageError
from slamcli.measurements import ImuSample, Odometry
from slamcli.simulation import Simulation, load_world, resolve_settings
from slamcli.simulation.builtin import find_world
from slamcli.simulation.flight import Flight
from slamcli.simulation.imu import GRAVITY_M_S2
from slamcli.simulation.world import CarriedPath

POSES = np.array([
    [0, 0, 1, 0, 0, 0], [2, 0.3, 1.3, 0, 0.1, 0.8], [3, 2, 1.2, 0.1, 0, 1.7], [1.5, 3, 1.4, 0, 0.2, 3.0], [0, 2, 1.1, 0, 0, 4.2],
], dtype=float)  # fmt: skip

WORLD = """
relief: {ceiling: 3}
rooms: [[-4, -4, 8, 8]]
path:
  closed: true
  rounds: 2
  poses: [[0, 0, 1, 0, 5], [2, 0, 1.2, 60], [2, 2, 1.1, 150, 0, 4], [0, 2, 1, -100]]
robot: {base_frame: body, speed: 1, rest: 1}
carried: {sway: 0.02, shake: 1}
laser: {enabled: false}
odometry: {enabled: false}
imu: {enabled: true, rate: 200, gyro_noise: 0, gyro_bias: 0, accel_noise: 0, accel_bias: 0, z: 0}
truth: {rate: 200}
camera: {kind: mono, rate: 1, width: 32, height: 24}
texture: {texel: 0.05}
"""


def flight(closed=False, duration=None, seed=1, rounds=1.0, **settings):
    path = CarriedPath(POSES, closed, rounds)
    values = {k.replace("__", "."): v for k, v in settings.items()}
    return Flight(path, resolve_settings(values), duration, np.random.default_rng(seed))


def made(tmp_path, text=WORLD, **changed):
    (tmp_path / "w.yaml").write_text(text)
    world = load_world(tmp_path / "w.yaml")
    return Simulation(world, resolve_settings(world.settings, changed), seed=3)


def test_it_passes_the_poses_of_its_path_and_rests_at_both_ends():
    calm = flight(carried__sway=0.0, carried__shake=0.0, robot__rest=2.0)
    times = calm.motion.times_s
    positions, rotations = calm.at(times)
    for pose in POSES:
        nearest = np.linalg.norm(positions - pose[:3], axis=1).argmin()
        np.testing.assert_allclose(positions[nearest], pose[:3], atol=0.01)
        expected = Rotation.from_euler("xyz", pose[3:]).as_matrix()
        assert np.abs(rotations[nearest] - expected).max() < 0.03
    speed = np.linalg.norm(calm.twists(times)[0], axis=1)
    assert speed[times < 2.0].max() < 1e-9
    assert speed[-1] < 1e-3
    assert 0.4 < np.median(speed) < 1.3


@pytest.mark.parametrize("closed", [False, True])
def test_speed_and_turn_rate_have_no_jumps(closed):
    rounds = 1.7 if closed else 1.0
    moving = flight(closed, rounds=rounds, robot__rest=0.5)
    times = np.arange(0.0, moving.motion.duration_s, 1e-3)
    turning, pull = moving.rates(times)
    assert np.abs(np.diff(turning, axis=0)).max() < 0.03
    assert np.abs(np.diff(pull, axis=0)).max() < 0.15
    assert np.linalg.norm(pull, axis=1).max() > 0.5
    if closed:
        assert abs(moving.motion.poses[-1, 2] - moving.motion.poses[0, 2]) > 2 * np.pi


def test_the_imu_integrates_to_the_truth(tmp_path):
    simulation = made(tmp_path)
    messages = list(simulation.messages())
    imu = [m.measurement for m in messages if isinstance(m.measurement, ImuSample)]
    truth = [m.measurement for m in messages if isinstance(m.measurement, Odometry)]
    assert [m.stamp_ns for m in imu] == [m.stamp_ns for m in truth]
    assert truth[0].child_frame_id == "body"
    step = 1 / 200
    turn, velocity, position = Rotation.from_quat(truth[0].quat_xyzw), np.zeros(3), truth[0].position_m.copy()
    for one, other in itertools.pairwise(imu):
        rate = (one.angular_rad_s + other.angular_rad_s) / 2
        after = turn * Rotation.from_rotvec(rate * step)
        pull = (turn.apply(one.acceleration_m_s2) + after.apply(other.acceleration_m_s2)) / 2 - [0, 0, GRAVITY_M_S2]
        position = position + velocity * step + pull * step**2 / 2
        velocity, turn = velocity + pull * step, after
    assert np.linalg.norm(position - truth[-1].position_m) < 0.02
    assert (turn.inv() * Rotation.from_quat(truth[-1].quat_xyzw)).magnitude() < 2e-4
    last = truth[len(truth) // 2]
    next_one = truth[len(truth) // 2 + 1]
    told = Rotation.from_quat(last.quat_xyzw).apply(last.linear_m_s)
    np.testing.assert_allclose((next_one.position_m - last.position_m) / step, told, atol=0.02)
    assert np.linalg.norm(last.position_m - truth[0].position_m) > 0.2


def test_clock_and_bias_of_the_imu(tmp_path):
    plain, late = (
        [m for m in made(tmp_path, **{"clock.imu_offset": offset}).messages() if m.topic == "/imu"]
        for offset in (0.0, 0.3)
    )
    assert {b.measurement.stamp_ns - a.measurement.stamp_ns for a, b in zip(plain, late, strict=True)} == {300_000_000}
    assert [m.log_time_ns for m in plain] == [m.log_time_ns for m in late]
    wandering = [m for m in made(tmp_path, **{"imu.gyro_walk": 0.01}).messages() if m.topic == "/imu"]
    steps = np.diff([b.measurement.angular_rad_s - a.measurement.angular_rad_s for a, b in zip(plain, wandering, strict=True)], axis=0)  # fmt: skip
    assert steps.std() == pytest.approx(0.01 / np.sqrt(200), rel=0.05)


def test_the_seed_changes_the_sway_only():
    one, other, calm = flight(seed=1), flight(seed=2), flight(carried__sway=0.0, carried__shake=0.0)
    times = one.motion.times_s
    gaps = [np.linalg.norm(f.at(times)[0] - calm.at(times)[0], axis=1) for f in (one, other)]
    assert 0.01 < gaps[0].mean() < 0.12
    assert 0.01 < np.linalg.norm(one.at(times)[0] - other.at(times)[0], axis=1).mean() < 0.15


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("closed: true", "closed: 1", "neither true nor false"),
        ("[0, 2, 1, -100]", "[0, 2]", r"path.poses\[3\].*\[x, y, z, yaw\]"),
        ("closed: true", "loop: true", "did you mean|known are"),
        ("rounds: 2", "rounds: 0", "path.rounds"),
        ("laser:", "start: [0, 0, 0]\nlaser:", "start: is for robots that drive"),
        (", [2, 2, 1.1, 150, 0, 4], [0, 2, 1, -100]", "", "at least 3"),
        ("[2, 0, 1.2, 60]", "[0, 0, 1, 0, 5]", "the same"),
        ("[2, 0, 1.2, 60]", "[2, -6, 1.2, 60]", "passes through something"),
    ],
)
def test_paths_that_cannot_be(tmp_path, old, new, message):
    assert old in WORLD
    with pytest.raises(ConfigError, match=message):
        made(tmp_path, WORLD.replace(old, new))


def test_a_recording_of_more_than_a_day_is_refused(tmp_path):
    with pytest.raises(UsageError, match="longer than a day"):
        made(tmp_path, WORLD.replace("rounds: 2", "rounds: 1000").replace("speed: 1", "speed: 0.02"))


def test_walks_of_the_built_in_worlds_are_as_their_descriptions_say():
    lengths = {}
    for name in ("visual_room", "visual_loop", "visual_street", "visual_desk"):
        world = load_world(find_world(name))
        lengths[name] = Simulation(world, resolve_settings(world.settings)).motion.length_m
    assert 12 < lengths["visual_room"] < 18
    assert 48 < lengths["visual_loop"] < 56
    assert 170 < lengths["visual_street"] < 200
    assert 4 < lengths["visual_desk"] < 12
