# SPDX-License-Identifier: MIT
"""Ray casts against analytic distances and naive twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.simulation import World, raycast

pytestmark = pytest.mark.kernels


def directions(angles):
    return np.column_stack([np.cos(angles), np.sin(angles)])


def room(width=4.0, height=2.0):
    w, h = width, height
    return np.array([[0, 0, w, 0], [w, 0, w, h], [w, h, 0, h], [0, h, 0, 0]], dtype=np.float64)


def naive_shapes(origin, direction, segments, circles):
    """Solve each 2 x 2 system and each quadratic on its own."""
    best = math.inf
    for x0, y0, x1, y1 in segments:
        matrix = np.array([[direction[0], x0 - x1], [direction[1], y0 - y1]])
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        t, u = np.linalg.solve(matrix, np.array([x0, y0]) - origin)
        if t >= 0 and -1e-9 <= u <= 1 + 1e-9:
            best = min(best, t)
    for x, y, radius in circles:
        b = direction @ (origin - (x, y))
        c = (origin - (x, y)) @ (origin - (x, y)) - radius**2
        if b * b - c >= 0:
            roots = [-b - math.sqrt(b * b - c), -b + math.sqrt(b * b - c)]
            best = min([best, *[t for t in roots if t >= 0]])
    return best


def naive_grid(origin, direction, occupied):
    """Nearest entry into any occupied cell, by clipping the ray to each cell."""
    best = math.inf
    for row, column in np.argwhere(occupied):
        enter, leave = 0.0, math.inf
        for o, d, low in ((origin[0], direction[0], column), (origin[1], direction[1], row)):
            if d == 0:
                if not low <= o <= low + 1:
                    enter, leave = 1.0, 0.0
            else:
                a, b = sorted([(low - o) / d, (low + 1 - o) / d])
                enter, leave = max(enter, a), min(leave, b)
        if enter < leave - 1e-9:
            best = min(best, enter)
    return best


def test_distances_in_a_rectangle_are_analytic():
    angles = np.linspace(-math.pi, math.pi, 721)
    ranges = raycast.cast(World("r", room()), np.tile([1.0, 0.5], (721, 1)), directions(angles), 10.0)
    with np.errstate(divide="ignore"):
        to_x = np.where(np.cos(angles) > 0, 3.0, 1.0) / np.abs(np.cos(angles))
        to_y = np.where(np.sin(angles) > 0, 1.5, 0.5) / np.abs(np.sin(angles))
    np.testing.assert_allclose(ranges, np.minimum(to_x, to_y), atol=1e-12)


def test_no_ray_slips_through_a_corner():
    corners = np.array([[0, 0], [4, 0], [4, 2], [0, 2]], dtype=np.float64)
    origins = np.random.default_rng(1).uniform([0.1, 0.1], [3.9, 1.9], (500, 2))
    for corner in corners:
        away = corner - origins
        far = np.hypot(away[:, 0], away[:, 1])
        ranges = raycast.cast(World("r", room()), origins, away / far[:, None], 10.0)
        np.testing.assert_allclose(ranges, far, atol=1e-9)


def test_segments_and_circles_equal_the_naive_twin():
    rng = np.random.default_rng(2)
    for _ in range(20):
        segments = rng.uniform(-5, 5, (12, 4))
        segments[0, 2:] = segments[0, :2]  # no length
        segments[1] = segments[2]  # twice the same
        circles = np.column_stack([rng.uniform(-5, 5, (4, 2)), rng.uniform(0.1, 2, 4)])
        origins, rays = rng.uniform(-5, 5, (40, 2)), directions(rng.uniform(-4, 4, 40))
        found = raycast.cast(World("w", segments, circles), origins, rays, 50.0)
        wanted = [naive_shapes(o, d, segments, circles) for o, d in zip(origins, rays, strict=True)]
        np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_grid_equals_the_naive_twin_from_inside_and_outside():
    rng = np.random.default_rng(3)
    for _ in range(10):
        occupied = rng.random((9, 13)) < 0.15
        grid = OccupancyGrid(np.where(occupied, 100, 0).astype(np.int8), 1.0)
        origins = rng.uniform([-3, -3], [16, 12], (60, 2))
        angles = rng.uniform(-4, 4, 60)
        angles[:8] = np.arange(8) * math.pi / 2
        rays = directions(angles).round(15)
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        found = raycast.cast(World("g", grid=grid), origins, rays, 40.0)
        wanted = [naive_grid(o, d, occupied) for o, d in zip(origins, rays, strict=True)]
        np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_a_turned_grid_gives_the_same_ranges_as_turned_rays():
    cells = np.zeros((20, 30), np.int8)
    cells[5:9, 20] = 100
    cells[15, 3:25] = 100
    yaw, shift = 0.7, np.array([3.0, -2.0])
    plain = World("g", grid=OccupancyGrid(cells, 0.1))
    turned = World("g", grid=OccupancyGrid(cells, 0.1, (*shift, yaw)))
    angles = np.linspace(-3, 3, 100)
    origin = np.array([1.0, 0.75])
    rotation = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    a = raycast.cast(plain, np.tile(origin, (100, 1)), directions(angles), 5.0)
    b = raycast.cast(turned, np.tile(rotation @ origin + shift, (100, 1)), directions(angles + yaw), 5.0)
    assert np.isfinite(a).sum() > 30
    np.testing.assert_allclose(a, b, atol=1e-9)


def test_nothing_within_reach_is_infinite_and_an_empty_world_too():
    rays = directions(np.linspace(0, 6, 50))
    assert np.isinf(raycast.cast(World("r", room()), np.tile([1.0, 0.5], (50, 1)), rays, 0.4)).all()
    assert np.isinf(raycast.cast(World("e", start=(0, 0, 0)), np.zeros((50, 2)), rays, 30.0)).all()
    assert raycast.cast(World("r", room()), np.zeros((0, 2)), np.zeros((0, 2)), 1.0).shape == (0,)


def test_moving_discs_are_met_where_they_are_when_the_beam_is_cast():
    origins, rays = np.zeros((3, 2)), np.tile([1.0, 0.0], (3, 1))
    discs = np.array([[2.0, 0.0, 0.25, 1.0, 0.0]])
    found = raycast.cast_moving(origins, rays, np.array([0.0, 0.5, 1.0]), discs, np.array([np.inf, np.inf, 2.0]))
    np.testing.assert_allclose(found, [1.75, 2.25, 2.0])


def test_a_ray_from_inside_a_disc_meets_its_far_side():
    found = raycast.cast_moving(
        np.zeros((1, 2)), np.array([[0.0, 1.0]]), np.zeros(1), np.array([[0, 0.1, 0.5, 0, 0.0]]), np.array([9.0])
    )
    assert found == pytest.approx([0.6])


def test_clearance_is_the_distance_to_the_nearest_wall():
    world = World("r", room(), np.array([[3.0, 1.0, 0.25]]))
    np.testing.assert_allclose(
        raycast.clearance(world, np.array([[1.0, 0.5], [2.0, 1.0], [3.1, 1.0], [-3.0, -4.0]])), [0.5, 0.75, 0.0, 5.0]
    )
