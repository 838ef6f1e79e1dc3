# SPDX-License-Identifier: MIT
"""What the scanner of a robot that obeys velocities says, against `raycast.cast` and naive twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.simulation import World, _beam_kernels, raycast, resolve_settings
from slamcli.simulation.plant import Plant
from slamcli.simulation.world import Cart, Walker

pytestmark = pytest.mark.kernels
EXACT = {"laser.noise": 0.0, "laser.dropout": 0.0}
ALL_ROUND = {"laser.fov": 360.0, "laser.beams": 90}


def rough_map(seed=0, resolution=0.1, origin=(-3.0, 2.0, 0.7)):
    """A grid of 20 x 16 m with a few walls, a hole in its border, unknown cells, and room in the middle."""
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((160, 200)) < 0.004, 100, 0).astype(np.int8)
    cells[:, 0] = cells[0] = cells[-1] = cells[:, -1] = 100
    cells[40:60, -1] = 0
    cells[100:110, 20:60] = -1
    cells[70:90, 90:110] = 0
    return World(name="rough", grid=OccupancyGrid(cells, resolution, origin))


def shapes():
    room = np.array([[0.0, 0, 6, 0], [6, 0, 6, 5], [6, 5, 0, 5], [0, 5, 0, 0], [4, 1, 5, 3]])
    return World(name="shapes", segments=room, circles=np.array([[1.0, 1.0, 0.3], [5.0, 4.0, 0.4]]))


def both():
    grid = rough_map(1, origin=(-4.0, -6.0, 0.0)).grid
    return World(name="both", grid=grid, segments=shapes().segments[3:], circles=shapes().circles)


def many():
    """More shapes than are tried one after the other, room in the middle."""
    rng = np.random.default_rng(6)
    ends = rng.uniform(-15, 15, (80, 2))
    segments = np.column_stack([ends, ends + rng.uniform(-2, 2, (80, 2))])
    segments[:10, 2:] = segments[:10, :2] + [[6.0, 0.0]]
    segments[10:20, 2:] = segments[10:20, :2] + [[0.0, 9.0]]
    clear = np.abs(segments - 0.0).reshape(-1, 2, 2).min(axis=1).max(axis=1) > 2.0
    circles = np.array([[4.0, 4.0, 1.5], [-6.0, 3.0, 0.2], [2.0, -8.0, 3.0]])
    room = np.array([[-20.0, -20, 20, -20], [20, -20, 20, 20], [20, 20, -20, 20], [-20, 20, -20, -20]])
    return World(name="many", segments=np.concatenate([room, segments[clear]]), circles=circles)


def middle(world):
    if world.name == "many":
        return 0.0, 0.0
    if world.grid is None:
        return 3.0, 2.5
    x, y = world.grid.cell_to_map(np.array([[80.0, 100.0]]))[0]
    return float(x), float(y)


def naive_rays(poses, parameters):
    """Origins and directions of the beams, one after the other."""
    p = parameters
    fov = math.radians(p.laser_fov)
    gaps = p.laser_beams if p.laser_fov >= 360 else p.laser_beams - 1
    way = -1.0 if p.laser_clockwise else 1.0
    origins, directions = [], []
    for i, (x, y, yaw) in enumerate(poses):
        bearing = -way * fov / 2 + way * i * fov / gaps
        angle = yaw + math.radians(p.laser_yaw) + (-bearing if p.laser_upside_down else bearing)
        c, s = math.cos(yaw), math.sin(yaw)
        origins.append([x + c * p.laser_x - s * p.laser_y, y + s * p.laser_x + c * p.laser_y])
        directions.append([math.cos(angle), math.sin(angle)])
    return np.array(origins), np.array(directions)


@pytest.mark.parametrize(
    "world", [rough_map(), rough_map(2), shapes(), both(), many()], ids=["map", "map2", "shapes", "both", "many"]
)
@pytest.mark.parametrize("mount", [{}, {"laser.yaw": 30.0, "laser.y": 0.1, "laser.clockwise": True}])
def test_a_scan_of_a_standing_robot_equals_the_cast_rays(world, mount):
    parameters = resolve_settings({**EXACT, **ALL_ROUND, **mount, "laser.range_max": 9.0})
    x, y = middle(world)
    robot = Plant(world, parameters, start=np.array([x, y, 0.3]), seed=4)
    robot.advance(0.2)
    scan = robot.scan()
    rays = naive_rays(np.tile(robot.pose, (90, 1)), parameters)
    expected = raycast.cast(world, *rays, 9.0)
    np.testing.assert_allclose(robot.true_ranges(), expected, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(scan.ranges_m, expected.astype(np.float32))
    assert np.isfinite(expected).any()
    np.testing.assert_allclose(
        scan.angles_rad[[0, 1]], [scan.angle_min_rad, scan.angle_min_rad + scan.angle_increment_rad]
    )


def test_a_mount_upside_down_sees_the_mirror_of_its_angles():
    parameters = resolve_settings({**EXACT, **ALL_ROUND, "laser.upside_down": True})
    robot = Plant(shapes(), parameters, start=np.array([2.0, 2.5, 0.3]))
    rays = naive_rays(np.tile(robot.pose, (90, 1)), parameters)
    np.testing.assert_allclose(robot.true_ranges(), raycast.cast(shapes(), *rays, 30.0), atol=1e-11)


@pytest.mark.parametrize("world", [rough_map(3), many()], ids=["map", "many"])
def test_rays_of_many_origins_even_from_outside_equal_the_cast_ones(world):
    walls = Plant(world, resolve_settings({}), start=np.array([*middle(world), 0.0]))._walls
    rng = np.random.default_rng(0)
    origins = rng.uniform(-25, 25, (400, 2))
    angles = np.where(
        np.arange(400) % 5 == 0,
        rng.integers(0, 4, 400) * math.pi / 2 + (0.7 if world.grid else 0.0),
        rng.uniform(-9, 9, 400),
    )
    poses = np.column_stack([origins, angles])
    ranges = np.empty(400)
    _beam_kernels.true_ranges(
        poses, np.zeros(2), np.zeros(400), np.zeros(400), walls.field, walls.frame, walls.segments, walls.circles,
        walls.starts, walls.members, walls.layout, np.zeros((0, 9)), 30.0, ranges,
    )  # fmt: skip
    expected = raycast.cast(world, origins, np.column_stack([np.cos(angles), np.sin(angles)]), 30.0)
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-9)


def test_beams_of_one_sweep_leave_from_where_the_robot_was():
    settings = {**EXACT, **ALL_ROUND, "robot.forward_acceleration": 1e5, "robot.swing_acceleration": 1e5}
    parameters = resolve_settings(settings)
    robot = Plant(shapes(), parameters, start=np.array([2.0, 2.5, 0.3]))
    robot.command(np.array([0.8, 0.0, 0.9]))
    robot.advance(0.3)
    now = robot.pose
    before = np.linspace(-robot.sweep_s, 0.0, 90)
    assert robot.sweep_s == pytest.approx(0.1 * 89 / 90)
    poses = []
    for t in before:
        radius, angle = 0.8 / 0.9, 0.9 * t
        step = np.array([radius * math.sin(angle), radius * (1 - math.cos(angle))])
        c, s = math.cos(now[2]), math.sin(now[2])
        poses.append([now[0] + c * step[0] - s * step[1], now[1] + s * step[0] + c * step[1], now[2] + angle])
    expected = raycast.cast(shapes(), *naive_rays(poses, parameters), 30.0)
    np.testing.assert_allclose(robot.true_ranges(), expected, atol=2e-4)
    assert robot.scan().stamp_ns == robot.stamp_ns - round(robot.sweep_s * 1e9)


def naive_reading(true, noise, lost, p):
    """One beam at a time, as docs/generate.md says it."""
    if lost < p.laser_dropout:
        return {"nan": math.nan, "zero": 0.0}[p.laser_dropout_value]
    if math.isinf(true):
        return {"inf": math.inf, "max": p.laser_range_max}[p.laser_no_return]
    if true < p.laser_range_min:
        return -math.inf
    told = true + noise * math.hypot(p.laser_noise, p.laser_noise_relative * true)
    if p.laser_resolution:
        told = round(told / p.laser_resolution) * p.laser_resolution
    told = max(told, p.laser_range_min)
    beyond = {"inf": math.inf, "max": p.laser_range_max}[p.laser_no_return]
    return beyond if told > p.laser_range_max else told


@pytest.mark.parametrize(
    "extra", [{}, {"laser.resolution": 0.05, "laser.dropout_value": "zero", "laser.no_return": "max"}]
)
def test_noise_limits_and_dropouts_are_those_of_generate(extra):
    settings = {"laser.noise": 0.02, "laser.noise_relative": 0.01, "laser.dropout": 0.2, "laser.range_max": 3.0}
    p = resolve_settings({**ALL_ROUND, **settings, "laser.range_min": 1.5, **extra})
    robot = Plant(shapes(), p, start=np.array([3.0, 2.5, 0.0]), seed=8)
    rng = robot.stream("laser")
    told = robot.scan().ranges_m
    noise, lost = rng.standard_normal(90), rng.random(90)
    twin = [naive_reading(t, n, u, p) for t, n, u in zip(robot.true_ranges(), noise, lost, strict=True)]
    np.testing.assert_array_equal(told, np.array(twin, np.float32))
    assert len({*np.isfinite(told)}) == 2 or extra


def crowded(settings=None):
    walkers = (Walker(np.array([[1.0, 4.0], [5.0, 4.5]]), 0.8),)
    carts = (Cart(np.array([[4.8, 0.5], [3.0, 0.5]]), speed_m_s=0.4), Cart(np.array([[0.6, 3.0]]), (0.0, 0.0), 0.2))
    world = World(name="crowded", segments=shapes().segments, walkers=walkers, carts=carts)
    return Plant(world, resolve_settings({**ALL_ROUND, **(settings or {})}), start=np.array([2.5, 2.0, 0.0]), seed=5)


def box_segments(box):
    x, y, c, s, half_l, half_w = box[:6]
    corners = np.array([[half_l, half_w], [half_l, -half_w], [-half_l, -half_w], [-half_l, half_w]])
    corners = corners @ np.array([[c, s], [-s, c]]) + [x, y]
    return np.column_stack([corners, np.roll(corners, -1, axis=0)])


def test_people_and_carts_are_seen_where_they_are():
    robot = crowded({**EXACT, "people.shape": "disc", "laser.sweep": 0.0})
    for _ in range(30):
        robot.advance(0.11)
        boxes = robot.boxes()
        discs, carts = boxes[boxes[:, 6] > 0], boxes[boxes[:, 6] == 0]
        still = World(
            name="still", circles=discs[:, [0, 1, 6]],
            segments=np.concatenate([shapes().segments, *[box_segments(b) for b in carts]]),
        )  # fmt: skip
        rays = naive_rays(np.tile(robot.pose, (90, 1)), robot.parameters)
        np.testing.assert_allclose(robot.true_ranges(), raycast.cast(still, *rays, 30.0), atol=1e-9)
    assert len(boxes) == 3


def test_legs_are_thin_swing_and_stay_under_the_body():
    robot = crowded({**EXACT, "people.shape": "legs"})
    swings = []
    for _ in range(60):
        robot.advance(0.05)
        legs, body = robot._seen[:2], robot.discs()[0]
        now = legs[:, :2] + 0.05 * legs[:, 7:]
        assert (np.hypot(*(now - body[:2]).T) < 0.25).all()
        assert (legs[:, 6] == 0.06).all()
        swings.append(legs[0, 7] - body[3])
    assert 0.3 < np.max(swings) < 1.2


def test_who_else_is_there_changes_no_noise():
    alone = Plant(shapes(), resolve_settings(ALL_ROUND), start=np.array([2.5, 2.0, 0.0]), seed=5)
    among = crowded({"people.count": 2, "carts.count": 1})
    for robot in (alone, among):
        for _ in range(20):
            robot.command(np.array([0.1, 0.0, 0.3]))
            robot.advance(0.05)
    assert alone.odom_pose.tobytes() == among.odom_pose.tobytes()
    a, b = alone.scan().ranges_m, among.scan().ranges_m
    same = alone.true_ranges() == among.true_ranges()
    assert 20 < same.sum() < 90
    np.testing.assert_array_equal(a[same], b[same])


def test_the_same_seed_gives_the_same_bytes_and_another_does_not():
    def told(seed):
        robot = Plant(
            both(), resolve_settings({"people.count": 4, "carts.count": 2, "slip.rate": 20.0, "slip.drift": 0.1}),
            start=np.array([*middle(both()), 0.0]), seed=seed,
        )  # fmt: skip
        parts = []
        for _ in range(25):
            robot.command(np.array([0.3, 0.0, 0.5]))
            robot.advance(0.1)
            parts += [robot.scan().ranges_m.tobytes(), robot.odom_pose.tobytes(), robot.discs().tobytes()]
        return b"".join(parts)

    assert told(1) == told(1)
    assert told(1) != told(2)
