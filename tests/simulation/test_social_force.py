# SPDX-License-Identifier: MIT
"""People walk around walls, each other and the robot, and get where they want to; kernels against naive twins."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest

from slamcli.errors import PlanningError
from slamcli.grids import OccupancyGrid
from slamcli.simulation import World, _crowd_kernels, _flow_kernels, load_world, raycast, resolve_settings
from slamcli.simulation.builtin import find_world
from slamcli.simulation.plant import Plant
from slamcli.simulation.site import site_of
from slamcli.simulation.social_force import Pedestrians
from slamcli.simulation.world import Walker

SMALL = {"laser.beams": 4}


def grid_world():
    rng = np.random.default_rng(4)
    cells = np.zeros((160, 200), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[60:62, :150] = 100
    for row, column in rng.integers(5, 150, (12, 2)):
        cells[row : row + 5, column : column + 5] = 100
    cells[120:, 150:] = -1
    return World(name="grid", grid=OccupancyGrid(cells, 0.1, (-5.0, 3.0, 0.4)))


def corridor(width=1.6, length=12.0):
    w, h = length, width
    return np.array([[0.0, 0, w, 0], [w, 0, w, h], [w, h, 0, h], [0, h, 0, 0]])


def naive_flow(goal, prices):
    """Dijkstra's algorithm with a heap."""
    costs = np.full(prices.shape, 10**9)
    costs[goal] = 0
    queue = [(0, goal)]
    while queue:
        cost, (row, column) = heapq.heappop(queue)
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = row + dr, column + dc
                if (dr or dc) and 0 <= r < prices.shape[0] and 0 <= c < prices.shape[1] and prices[r, c]:
                    further = cost + (7 if dr and dc else 5) * (int(prices[row, column]) + int(prices[r, c]))
                    if further < costs[r, c]:
                        costs[r, c] = further
                        heapq.heappush(queue, (further, (r, c)))
    return costs


@pytest.mark.kernels
def test_costs_to_a_place_equal_the_naive_ones():
    rng = np.random.default_rng(0)
    for _ in range(4):
        prices = rng.integers(1, 13, (23, 31)).astype(np.uint8)
        prices[rng.random(prices.shape) < 0.3] = 0
        goal = tuple(int(v) for v in np.argwhere(prices)[17])
        got = np.empty(prices.shape, np.int32)
        _flow_kernels.distances_to(*goal, prices, 10**9, got)
        np.testing.assert_array_equal(got, naive_flow(goal, prices))


def naive_interaction(gap, velocity, other, extra):
    """Equations 5 to 8 of Moussaid et al. 2009 with complex numbers."""
    gap, velocity, other = (complex(*v) for v in (gap, velocity, other))
    e = gap / abs(gap)
    d = 2.0 * (velocity - other) + e
    t, b = d / abs(d), 0.35 * abs(d)
    theta = np.angle(e / t) + 0.005 * b
    far = max(abs(gap) - extra, 0.05)
    slow = -4.5 * math.exp(-far / b - (3.0 * b * theta) ** 2)
    turn = -4.5 * np.sign(theta) * math.exp(-far / b - (2.0 * b * theta) ** 2)
    force = slow * t + turn * t * 1j
    return force.real, force.imag


@pytest.mark.kernels
def test_the_force_between_two_equals_the_naive_one():
    rng = np.random.default_rng(1)
    for _ in range(50):
        gap, velocity, other = rng.uniform(-2, 2, (3, 2))
        got = np.zeros(2)
        _crowd_kernels._interaction(*gap, *velocity, *other, 0.1, got)
        np.testing.assert_allclose(got, naive_interaction(gap, velocity, other, 0.1), rtol=1e-9, atol=1e-12)
    nothing = np.zeros(2)
    _crowd_kernels._interaction(4.2, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, nothing)
    np.testing.assert_array_equal(nothing, np.zeros(2))


@pytest.mark.kernels
def test_nobody_likes_to_touch_a_robot():
    force = np.zeros(2)
    _crowd_kernels._keep_off(0.3, 0.4, 0.15, force)
    np.testing.assert_allclose(force, -10.0 * math.exp(-1.0) * np.array([0.6, 0.8]))
    _crowd_kernels._keep_off(0.3, 0.4, 1.0, force)
    np.testing.assert_allclose(np.hypot(*force), 10.0 * math.exp(-1.0))


def walk(world, settings, seconds, seed=0, start=None, period=0.5):
    start = np.array([*site_of(world).space.roomiest(), 0.0]) if start is None else np.array(start)
    robot = Plant(world, resolve_settings({**SMALL, **settings}), start=start, seed=seed)
    tracks = []
    for _ in range(round(seconds / period)):
        robot.advance(period)
        tracks.append(robot.discs())
    return robot, np.array(tracks)


@pytest.mark.parametrize("world", ["office", "warehouse", "grid"])
def test_nobody_is_ever_in_a_wall_in_ten_minutes(world):
    world = grid_world() if world == "grid" else load_world(find_world(world))
    robot, tracks = walk(world, {"people.count": 6}, 600.0, seed=1, period=0.25)
    places = tracks[:, :, :2].reshape(-1, 2)
    assert site_of(world).space.room(places).min() > 0.15
    if world.grid is None:
        assert raycast.clearance(world, places).min() > 0.15
    speeds = np.hypot(tracks[:, :, 3], tracks[:, :, 4])
    assert 0.6 < speeds.mean() < 1.1
    spans = np.ptp(tracks[:, :, :2], axis=0)
    assert spans.max(axis=1).min() > 5.0
    assert not any(c.by_robot for c in robot.collisions)


@pytest.mark.kernels
def test_two_pass_each_other_in_a_corridor():
    there, back = np.array([[0.8, 0.8], [11.2, 0.8]]), np.array([[11.2, 0.8], [0.8, 0.8]])
    world = World(name="corridor", segments=corridor(), walkers=(Walker(there, 1.0), Walker(back, 1.0)))
    site = site_of(world)
    seeds = [np.random.default_rng(i) for i in (1, 2)]
    people = Pedestrians(site, world.walkers, resolve_settings({}), np.array([6.0, 50.0, 0.0]), seeds)
    far = np.array([6.0, 50.0, 0.0, 0.0, 0.0, 0.0])
    gaps, places = [], []
    for _ in range(240):
        people.walk(far, np.zeros((1, 2)), 0.25, np.zeros((0, 9)))
        now = people.now()
        gaps.append(math.hypot(*(now[0] - now[1])))
        places.append(now.copy())
    places = np.array(places)
    assert places[:, 0, 0].max() > 10.5
    assert places[:, 1, 0].min() < 1.5
    assert min(gaps) > 0.40
    assert raycast.clearance(world, places.reshape(-1, 2)).min() > 0.17


def test_people_walk_around_a_robot_that_stands_in_their_way():
    world = World(name="hall", segments=corridor(4.0), walkers=(Walker(np.array([[1.0, 2.0], [11.0, 2.0]]), 1.0),))
    robot, tracks = walk(world, {}, 30.0, start=(6.0, 2.0, 0.0), period=0.05)
    gaps = np.hypot(tracks[:, 0, 0] - 6.0, tracks[:, 0, 1] - 2.0) - 0.25 - 0.22
    assert gaps.min() > 0.0
    assert tracks[:, 0, 0].max() > 10.0
    assert robot.collisions == ()


@pytest.mark.kernels
def test_on_routes_people_wait_for_the_robot():
    world = World(name="tight", segments=corridor(1.0), walkers=(Walker(np.array([[1.0, 0.5], [11.0, 0.5]]), 1.0),))
    robot, tracks = walk(world, {"people.model": "routes"}, 20.0, start=(6.0, 0.5, 0.0), period=0.05)
    np.testing.assert_allclose(tracks[:, 0, 1], 0.5, atol=1e-9)
    assert 5.0 < tracks[-1, 0, 0] + 0.47 < 6.0 - 0.25 + 0.22
    assert robot.collisions == ()
    wide = World(name="wide", segments=corridor(4.0), walkers=world.walkers)
    away, tracks = walk(wide, {"people.model": "routes"}, 40.0, start=(6.0, 3.5, 0.0), period=0.05)
    assert away.collisions == ()
    assert np.median(np.hypot(tracks[:, 0, 3], tracks[:, 0, 4])) == pytest.approx(1.0, abs=1e-6)


def test_a_walker_whose_points_are_apart_by_a_wall_goes_round_it():
    wall = np.array([[6.0, 0.0, 6.0, 3.0]])
    walker = Walker(np.array([[5.0, 1.0], [7.0, 1.0]]), 1.2)
    world = World(name="around", segments=np.concatenate([corridor(5.0), wall]), walkers=(walker,))
    _, tracks = walk(world, {}, 30.0, start=(1.0, 1.0, 0.0))
    x, y = tracks[:, 0, 0], tracks[:, 0, 1]
    assert x.min() < 5.5
    assert x.max() > 6.5
    crossing = np.diff(np.sign(x - 6.0)) != 0
    assert crossing.sum() >= 2
    assert y[1:][crossing].min() > 2.7


def test_preferred_speeds_are_drawn_per_person():
    robot, _ = walk(load_world(find_world("office")), {"people.count": 40, "people.speed": 1.0}, 0.5)
    speeds = robot._traffic._people._people[:, 4]
    assert np.std(speeds) == pytest.approx(0.15, abs=0.05)
    assert np.mean(speeds) == pytest.approx(1.0, abs=0.08)


def test_nobody_starts_on_the_robot_and_a_world_without_room_says_so():
    world = load_world(find_world("office"))
    robot, _ = walk(world, {"people.count": 50}, 0.0)
    assert np.hypot(*(robot.discs()[:, :2] - robot.pose[:2]).T).min() > 1.2
    cupboard = World(name="cupboard", segments=corridor(1.2, 1.2))
    with pytest.raises(PlanningError, match=r"world cupboard: no room for people: nowhere is 1.2 m from the robot"):
        walk(cupboard, {"people.count": 1}, 0.0, start=(0.6, 0.6, 0.0))
    cells = np.full((8, 40), 100, np.int8)
    cells[2:6, 1:39] = 0
    slit = World(name="slit", grid=OccupancyGrid(cells, 0.1))
    with pytest.raises(PlanningError, match="nowhere is room"):
        walk(slit, {"people.count": 1, "robot.radius": 0.1}, 0.0, start=(1.0, 0.4, 0.0))


def test_people_of_one_world_depend_on_their_seed_alone():
    world = load_world(find_world("office"))
    first, tracks = walk(world, {"people.count": 5}, 20.0, seed=7)
    _, again = walk(load_world(find_world("office")), {"people.count": 5}, 20.0, seed=7)
    assert tracks.tobytes() == again.tobytes()
    _, other = walk(world, {"people.count": 5}, 20.0, seed=8)
    assert tracks.tobytes() != other.tobytes()
    assert len(first.discs()) == 5
