# SPDX-License-Identifier: MIT
"""Bodies, what they touch, and how far they are from it, against a naive twin that samples outlines."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.simulation import Contact, World, _plant_kernels, resolve_settings
from slamcli.simulation.plant import Plant
from slamcli.simulation.walls import build_walls, free_field
from slamcli.simulation.world import Cart, Walker

pytestmark = pytest.mark.kernels
QUICK = {"robot.forward_acceleration": 1e5, "robot.swing_acceleration": 1e5, "laser.beams": 4}
BOX = "[[0.4, 0.2], [0.4, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
ROOM = np.array([[-4.0, -4, 4, -4], [4, -4, 4, 4], [4, 4, -4, 4], [-4, 4, -4, -4]])


def walled(*segments):
    return World(name="walled", segments=np.concatenate([ROOM, np.array(segments).reshape(-1, 4)]))


def gridded(cells, resolution=0.1, origin=(-1.0, -1.5, 0.3)):
    return World(name="gridded", grid=OccupancyGrid((np.asarray(cells) * 100).astype(np.int8), resolution, origin))


def gap(world, outline, radius, pose, reach=9.0):
    walls = build_walls(world)
    outline = np.array(outline, dtype=np.float64)
    room = np.empty_like(outline)
    return _plant_kernels.wall_gap(
        outline, radius, *(float(v) for v in pose), walls.field, walls.frame, walls.shapes, reach, room
    )


def naive_gap(world, outline, radius, pose, step=0.004):
    """Points on the outline against points on every wall (squares of cells, segments, circles)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    corners = np.array(outline) @ np.array([[c, s], [-s, c]]) + np.array(pose[:2])
    body = dense(np.concatenate([corners, corners[:1]]), step)
    walls = [
        dense(np.array([a, b]).reshape(2, 2), step)
        for *a, b in ((x0, y0, (x1, y1)) for x0, y0, x1, y1 in world.segments)
    ]
    for x, y, r in world.circles:
        angles = np.arange(0.0, 2 * math.pi, step / r)
        walls.append(np.column_stack([x + r * np.cos(angles), y + r * np.sin(angles)]))
    if world.grid is not None:
        for row, column in np.argwhere(world.occupied_cells):
            square = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
            walls.append(dense(world.grid.cell_to_map(square + np.array([row, column])), step))
    points = np.concatenate(walls)
    return min(np.hypot(*(points - b).T).min() for b in body) - radius


def dense(line, step):
    parts = []
    for a, b in pairwise(line):
        parts.append(a + np.linspace(0.0, 1.0, int(np.hypot(*(b - a)) / step) + 2)[:, None] * (b - a))
    return np.concatenate(parts)


def test_gaps_to_cells_segments_and_circles_equal_the_naive_ones():
    rng = np.random.default_rng(5)
    cells = rng.random((20, 24)) < 0.04
    shapes = World(
        name="shapes", segments=rng.uniform(-2, 2, (5, 4)), circles=np.array([[2.0, 2.0, 0.5], [-2.0, 1.0, 0.2]])
    )
    box = [[0.2, 0.1], [0.2, -0.1], [-0.15, -0.1], [-0.15, 0.1]]
    measured = 0
    for world in (gridded(cells), shapes):
        for outline, radius in (([[0.0, 0.0]], 0.1), (box, 0.0), (box, 0.03)):
            for _ in range(6):
                pose = rng.uniform([-1.5, -1.5, -3.0], [1.5, 1.5, 3.0])
                twin = naive_gap(world, outline, radius, pose)
                if twin > 0.01:  # overlaps are another test
                    assert gap(world, outline, radius, pose) == pytest.approx(twin, abs=0.006)
                    measured += 1
    assert measured >= 15


def test_gaps_of_overlapping_bodies_are_not_above_0():
    world = gridded(np.pad(np.ones((1, 1)), 10))
    middle = world.grid.cell_to_map(np.array([[10.0, 10.0]]))[0]
    around = [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]]
    assert gap(world, around, 0.0, (*middle, 0.4)) == 0.0
    assert gap(world, [[0.0, 0.0]], 0.2, (*middle, 0.4)) == pytest.approx(-0.2)
    assert gap(walled([-1, 0, 1, 0]), around, 0.0, (0.5, 0.2, 0.1)) == 0.0
    assert gap(walled(), [[0.0, 0.0]], 0.2, (1.0, 0.5, 0.0), reach=0.7) == 0.7


def test_the_field_of_free_cells_never_says_too_much():
    rng = np.random.default_rng(2)
    occupied = rng.random((30, 40)) < 0.02
    field = free_field(occupied)
    np.testing.assert_array_equal(field == 0, occupied)
    walls = np.argwhere(occupied)
    for row, column in np.argwhere(~occupied)[::7]:
        corner = rng.random(2)
        apart = np.maximum(
            np.maximum(walls - (np.array([row, column]) + corner), (np.array([row, column]) + corner) - walls - 1), 0
        )
        assert np.hypot(*apart.T).min() >= field[row, column] - 1
    assert (free_field(np.zeros((3, 4), np.bool_)) == 255).all()


def naive_mover_gap(pose, radius, box):
    """A disc against points of a box's outline."""
    x, y, c, s, half_l, half_w, r = box[:7]
    corners = np.array([[half_l, half_w], [half_l, -half_w], [-half_l, -half_w], [-half_l, half_w], [half_l, half_w]])
    points = dense(corners @ np.array([[c, s], [-s, c]]) + [x, y], 0.002)
    return np.hypot(*(points - np.array(pose[:2])).T).min() - radius - r


def test_gaps_to_what_moves_equal_the_naive_ones():
    rng = np.random.default_rng(1)
    for _ in range(10):
        yaw = rng.uniform(-3, 3)
        box = np.array([*rng.uniform(-2, 2, 2), math.cos(yaw), math.sin(yaw), 0.4, 0.2, 0.05, 0.0, 0.0])
        pose = rng.uniform(-3, 3, 3)
        got = _plant_kernels.mover_gap(np.zeros((1, 2)), 0.1, *pose, box[None], np.empty((1, 2)))
        assert got == pytest.approx(naive_mover_gap(pose, 0.1, box), abs=0.003)


def run_into(world, start, speed, settings=None, seconds=4.0):
    robot = Plant(world, resolve_settings({**QUICK, **(settings or {})}), start=np.array(start))
    for _ in range(round(seconds / 0.1)):
        robot.command(np.array([speed, 0.0, 0.0]))
        robot.advance(0.1)
    return robot


@pytest.mark.parametrize("speed", [1.0, 15.0])
@pytest.mark.parametrize("footprint", ["", BOX])
def test_nobody_drives_through_a_thin_wall(speed, footprint):
    robot = run_into(
        walled([2, -4, 2, 4]), (-3.0, 0.0, 0.1), speed, {"robot.footprint": footprint, "robot.max_forward": 20.0}, 6.0
    )
    reach = 0.25 if not footprint else 0.4 * math.cos(0.1) + 0.2 * math.sin(0.1)
    assert 2.0 - reach - 0.01 < robot.pose[0] <= 2.0 - reach
    (contact,) = robot.collisions
    assert (contact.kind, contact.speed_m_s, contact.by_robot) == ("wall", pytest.approx(speed), True)
    assert contact.time_s == pytest.approx((5.0 - reach) / math.cos(0.1) / speed, abs=0.02)
    assert contact.x_m == pytest.approx(robot.pose[0], abs=0.16)
    assert robot.clearance_m < 0.01


def test_a_robot_comes_away_from_a_wall_turns_there_and_a_new_contact_counts_anew():
    robot = run_into(walled(), (3.0, 0.0, 0.0), 1.0)
    robot.command(np.array([0.0, 0.0, 1.0]))
    robot.advance(0.3)
    assert robot.pose[2] == pytest.approx(0.3)
    for speed, expected in ((-0.5, 1), (0.6, 2)):
        for _ in range(10):
            robot.command(np.array([speed, 0.0, 0.0]))
            robot.advance(0.1)
        assert len(robot.collisions) == expected


def test_a_long_robot_cannot_turn_into_a_wall():
    robot = Plant(
        walled([-4, 0.3, 4, 0.3]), resolve_settings({**QUICK, "robot.footprint": BOX}), start=np.array([0.0, 0.0, 0.0])
    )
    for _ in range(20):
        robot.command(np.array([0.0, 0.0, 0.5]))
        robot.advance(0.1)
    turned = robot.pose[2]
    assert 0.4 * math.sin(turned) + 0.2 * math.cos(turned) == pytest.approx(0.3, abs=5e-3)
    assert len(robot.collisions) == 1
    assert robot.collisions[0].speed_m_s == 0.0


def test_cells_of_a_map_stop_the_robot_and_unknown_ones_if_wanted():
    cells = np.zeros((60, 60), np.int8)
    cells[:, 50:] = 100
    cells[:, 40:50] = -1
    world = World(name="map", grid=OccupancyGrid(cells, 0.1))
    assert run_into(world, (1.0, 3.0, 0.0), 1.0, seconds=6.0).pose[0] == pytest.approx(4.75, abs=0.011)
    strict = run_into(world, (1.0, 3.0, 0.0), 1.0, {"robot.unknown_is_floor": False}, seconds=6.0)
    assert strict.pose[0] == pytest.approx(3.75, abs=0.011)


def standing_person(at):
    """Somebody who cannot get away: their way is as short as it gets."""
    return World(name="met", segments=ROOM, walkers=(Walker(np.array([at, [at[0] + 1e-3, at[1]]]), 0.05),))


def test_a_robot_that_runs_into_somebody_is_stopped_and_blamed():
    settings = {"people.model": "routes", "robot.max_forward": 3.0}
    robot = run_into(standing_person((1.0, 0.0)), (-2.0, 0.0, 0.0), 3.0, settings, seconds=1.5)
    first = robot.collisions[0]
    assert (first.kind, first.by_robot) == ("person", True)
    assert first.approach_m_s == pytest.approx(3.0, rel=0.05)
    assert robot.pose[0] < robot.discs()[0, 0] - 0.4


def test_a_cart_waits_for_a_robot_that_stands_in_its_way():
    cart = Cart(np.array([[3.0, 0.6], [-3.0, 0.6]]), (0.0, 0.0), 0.5, speed_m_s=1.0)
    world = World(name="met", segments=ROOM, carts=(cart,))
    robot = Plant(world, resolve_settings({**QUICK, "robot.radius": 0.2}), start=np.array([0.0, 0.0, 0.0]))
    robot.advance(7.0)
    assert robot.collisions == ()
    assert 0.2 < robot.clearance_m < 0.5
    robot.teleport(np.array([-3.0, -3.0, 0.0]))
    robot.advance(3.0)
    assert robot.discs()[0, 0] < -1.0


def test_a_person_who_walks_into_a_moving_robot_from_the_side_is_not_its_fault():
    event = dict(time_s=1.0, x_m=0.0, y_m=0.0, speed_m_s=0.5)
    assert not Contact(kind="person", approach_m_s=0.05, **event).by_robot
    assert Contact(kind="person", approach_m_s=0.3, **event).by_robot
    assert Contact(kind="wall", approach_m_s=0.05, **event).by_robot


def test_clearance_is_the_distance_to_the_nearest_thing():
    robot = Plant(walled(), resolve_settings(QUICK), start=np.array([2.5, 1.0, 0.0]))
    assert robot.clearance_m == pytest.approx(1.25)
    robot.teleport(np.array([0.0, 0.0, 0.0]))
    assert robot.clearance_m == 3.0
    met = Plant(standing_person((0.5, 0.0)), resolve_settings(QUICK), start=np.array([0.0, 0.0, 0.0]))
    assert met.clearance_m == pytest.approx(0.5 - 0.25 - 0.22)
