# SPDX-License-Identifier: MIT
"""The robot's motion: on its way, within its limits, clear of walls."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import ConfigError, PlanningError, UsageError
from slamcli.grids import OccupancyGrid
from slamcli.simulation import SimulationParameters, World, raycast, resolve_settings, shapes
from slamcli.simulation.drive import TICK_S, drive
from slamcli.simulation.free_space import FreeSpace, true_map

pytestmark = pytest.mark.kernels

P = SimulationParameters()


def hall(**more):
    walls = np.concatenate([shapes.rectangle(np.array([0, 0, 12, 8.0])), shapes.polyline(np.array([[6, 0], [6, 5.0]]))])
    return World("hall", walls, **more)


def go(world, duration=None, parameters=P, seed=1):
    return drive(world, parameters, duration, np.random.default_rng(seed))


def test_a_route_passes_its_waypoints_and_ends_at_rest():
    points = np.array([[1.5, 1.5], [4.5, 1.5], [4.5, 6.5], [10, 6.5]])
    motion = go(hall(waypoints=points))
    for point in points:
        assert np.linalg.norm(motion.poses[:, :2] - point, axis=1).min() < 0.3
    assert np.linalg.norm(motion.poses[-1, :2] - points[-1]) < 0.1
    assert np.abs(motion.speeds[-1]).max() < 0.02
    assert motion.length_m == pytest.approx(3 + 5 + 5.5, abs=0.6)


def test_limits_of_speed_turn_and_acceleration_hold_at_every_tick():
    motion = go(hall(start=(2, 2, 0)), 60.0)
    assert motion.speeds[:, 0].max() <= P.robot_speed + 1e-9
    assert motion.speeds[:, 0].min() >= -1e-9
    assert np.abs(motion.speeds[:, 1]).max() <= P.robot_turn_rate + 1e-9
    changes = np.abs(np.diff(motion.speeds, axis=0)).max(axis=0) / TICK_S
    assert (changes <= np.array([P.robot_acceleration, P.robot_turn_acceleration]) * (1 + 1e-6)).all()


def test_poses_are_the_integral_of_the_speeds():
    motion = go(hall(start=(2, 2, 0)), 20.0)
    steps = np.diff(motion.poses, axis=0)
    np.testing.assert_allclose(np.hypot(steps[:, 0], steps[:, 1]), motion.speeds[1:, 0] * TICK_S, atol=1e-9)
    np.testing.assert_allclose(steps[:, 2], motion.speeds[1:, 1] * TICK_S, atol=1e-9)


def test_a_leg_through_a_wall_goes_around_it():
    motion = go(hall(waypoints=np.array([[3, 1.0], [9, 1.0]])))
    assert motion.poses[:, 1].max() > 5.0
    assert raycast.clearance(hall(), motion.poses[:, :2]).min() >= P.robot_radius


def test_turning_back_on_a_line_works():
    motion = go(hall(waypoints=np.array([[2, 2], [5, 2], [2, 2.0]]), rounds=2))
    assert motion.poses[:, 0].max() > 4.7
    assert np.linalg.norm(motion.poses[-1, :2] - (2, 2)) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_a_random_drive_keeps_clear_and_goes_about(seed):
    motion = go(hall(), 120.0, seed=seed)
    assert motion.duration_s == pytest.approx(120.0)
    assert raycast.clearance(hall(), motion.poses[:, :2]).min() >= P.robot_radius
    visited = {tuple(cell) for cell in np.floor(motion.poses[:, :2] / 2).astype(int)}
    assert len(visited) >= 12  # of 24 squares of 2 x 2 m
    assert np.ptp(motion.poses[:, 0]) > 7


def test_rest_and_duration():
    motion = go(hall(start=(2, 2, 0)), 8.0, resolve_settings({"robot.rest": 3.0}))
    assert np.abs(motion.speeds[:300]).max() == 0
    assert len(motion.poses) == 801
    long = go(hall(waypoints=np.array([[2, 2], [3, 2.0]])), 30.0)
    assert long.duration_s == pytest.approx(30.0)


def test_interpolation_between_ticks_and_beyond_the_ends():
    motion = go(hall(start=(2, 2, 0)), 10.0)
    middle = motion.at(np.array([5.005]))[0]
    np.testing.assert_allclose(middle, motion.poses[500:502].mean(axis=0), atol=1e-12)
    np.testing.assert_array_equal(motion.at(np.array([-1.0, 99.0])), motion.poses[[0, -1]])


def test_errors_say_where():
    with pytest.raises(ConfigError, match=r"hits a wall at 1\.\d\d, 0\.1\d .* after 0\.0 s"):
        go(hall(start=(1.0, 0.15, 0), waypoints=np.array([[2, 2], [3, 2.0]])))
    walled = np.concatenate([hall().segments, shapes.polyline(np.array([[6, 5.0], [6, 8]]))])
    with pytest.raises(PlanningError, match=r"no way from 2\.00, 2\.00 to 9\.00, 2\.00"):
        go(World("w", walled, waypoints=np.array([[2, 2], [9, 2.0]])))
    with pytest.raises(PlanningError, match=r"start 6\.00, 2\.00 is not within 0\.5 m"):
        go(World("w", walled, start=(6, 2, 0)), 5.0, resolve_settings({"robot.radius": 0.6}))
    with pytest.raises(PlanningError, match="nowhere is room"):
        go(
            World("tiny", shapes.rectangle(np.array([0, 0, 0.3, 0.3])), start=None),
            5.0,
            resolve_settings({"robot.radius": 2.0}),
        )
    with pytest.raises(UsageError, match="too long"):
        go(hall(start=(2, 2, 0)), 3e5)


def test_the_true_map_has_walls_free_cells_and_the_unknown_behind():
    world = World("w", np.concatenate([hall().segments, shapes.box(np.array([3, 3.0]), np.array([1, 1.0]), 0.0)]))
    grid = true_map(world, np.array([1.0, 1.0]), 0.1)
    at = lambda x, y: grid.cells[tuple(grid.map_to_cell([[x, y]])[0])]  # noqa: E731
    assert at(1, 1) == at(9, 1) == 0
    assert at(3.0, 3.0) == -1  # inside the box
    assert at(2.5, 3.0) == at(12.0, 4.0) == at(0.0, 4.0) == at(6.0, 2.0) == 100
    assert at(-0.5, 4) == at(12.5, 4) == -1
    free = (grid.cells == 0).sum() * 0.01
    assert free == pytest.approx(12 * 8 - 1, rel=0.05)
    with pytest.raises(ConfigError, match="in a wall"):
        true_map(world, np.array([0.0, 4.0]), 0.1)


def test_a_map_is_its_own_true_map_and_a_robot_drives_in_it():
    cells = np.full((100, 160), -1, np.int8)
    cells[10:90, 10:150] = 0
    cells[[10, 89], 10:150] = 100
    cells[10:90, [10, 149]] = 100
    grid = OccupancyGrid(cells, 0.05, (-3.0, -2.0, 0.4))
    world = World("m", grid=grid)
    motion = go(world, 40.0)
    rc = grid.map_to_cell(motion.poses[:, :2])
    assert (grid.cells[rc[:, 0], rc[:, 1]] == 0).all()
    assert motion.length_m > 10
    assert true_map(world, motion.poses[0, :2], 0.05) is grid


def test_ways_are_as_short_as_clearance_allows():
    space = FreeSpace(hall(), 0.37)
    way = space.way(np.array([3, 1.0]), np.array([9, 1.0]))
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    taut = 2 * np.hypot(3, 4.37)
    assert taut - 0.1 <= length <= taut * 1.1
    assert all(space.room(way[1:-1]) >= 0.37 - 0.1)
