# SPDX-License-Identifier: MIT
"""Ground and obstacles, and the kernels against naive twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids.ground import GroundSettings, clusters, flat_points, segment, without_noise

pytestmark = pytest.mark.kernels
VIEW = np.array([0.0, 0.0, 1.0])


def sheet(x0, x1, y0, y1, z, step=0.05):
    x, y = np.meshgrid(np.arange(x0, x1, step), np.arange(y0, y1, step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def wall(x, z1, step=0.05):
    y, z = np.meshgrid(np.arange(-0.5, 0.5, step), np.arange(step, z1, step))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])


def naive_clusters(points, radius, least):
    label = np.arange(len(points))
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= radius
    for _ in range(len(points)):
        new = np.array([label[row].min() for row in near])
        if (new == label).all():
            break
        label = new
    numbers = {}
    for root in sorted(set(label.tolist())):
        if (label == root).sum() >= least:
            numbers[root] = len(numbers)
    return np.array([numbers.get(value, -1) for value in label.tolist()])


def naive_flat(points, view, settings):
    flat = []
    for i, point in enumerate(points):
        near = points[np.argsort(np.linalg.norm(points - point, axis=1), kind="stable")[: settings.normal_k]]
        values, vectors = np.linalg.eigh(np.cov(near.T))
        normal = vectors[:, 0]
        normal = normal if normal @ (view - point) >= 0 else -normal
        if values[1] > 1e-9 and normal[2] > math.cos(settings.max_angle_rad):
            flat.append(i)
    return np.array(flat, dtype=np.int64)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_clusters_are_those_of_the_naive_twin(seed):
    points = np.random.default_rng(seed).uniform(0.0, 1.0, (150, 3))
    for radius, least in ((0.05, 1), (0.13, 2), (0.2, 5)):
        np.testing.assert_array_equal(clusters(points, radius, least), naive_clusters(points, radius, least))


def test_points_exactly_one_radius_apart_are_joined():
    points = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.25, 0.0, 0.0]])
    assert clusters(points, 0.5, 1).tolist() == [0, 0, 1]
    assert clusters(points, 0.5, 2).tolist() == [0, 0, -1]
    assert clusters(points[:0], 0.5, 1).tolist() == []


@pytest.mark.parametrize("seed", [3, 4])
def test_flat_points_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    slope = sheet(0.5, 1.5, -0.5, 0.5, 0.0, 0.1)
    slope[:, 2] = 0.9 * (slope[:, 0] - 0.5)
    points = np.concatenate([sheet(-1, 0.3, -0.6, 0.6, 0.0, 0.1), slope, wall(2.0, 1.0, 0.1)])
    points += rng.normal(0.0, 0.01, points.shape)
    settings = GroundSettings(normal_k=8)
    np.testing.assert_array_equal(flat_points(points, VIEW, settings), naive_flat(points, VIEW, settings))


def test_a_floor_is_ground_and_a_wall_an_obstacle():
    floor, obstacle = sheet(0.2, 2.0, -0.5, 0.5, 0.0), wall(2.5, 1.0)
    found = segment(np.concatenate([floor, obstacle]), VIEW, GroundSettings())
    np.testing.assert_array_equal(found.ground, np.arange(len(floor)))
    np.testing.assert_array_equal(found.obstacles, len(floor) + np.arange(len(obstacle)))


def test_a_table_is_an_obstacle_only_with_a_limit_of_height():
    floor, table = sheet(0.0, 2.0, -0.5, 0.5, 0.0), sheet(0.5, 1.0, -0.3, 0.3, 0.7)
    points = np.concatenate([floor, table])
    assert len(segment(points, VIEW, GroundSettings()).ground) == len(points)
    limited = segment(points, VIEW, GroundSettings(max_ground_height_m=0.1))
    assert limited.ground.tolist() == list(range(len(floor)))
    assert limited.obstacles.tolist() == list(range(len(floor), len(points)))
    careless = segment(points, VIEW, GroundSettings(max_ground_height_m=0.1, flat_obstacles=False))
    assert len(careless.ground) == len(points)


def test_the_largest_surface_above_the_limit_is_no_ground():
    table = sheet(0.5, 1.0, -0.3, 0.3, 0.7)
    found = segment(table, VIEW, GroundSettings(max_ground_height_m=0.1))
    assert (len(found.ground), len(found.obstacles)) == (0, len(table))


def test_a_ceiling_seen_from_below_is_no_ground():
    ceiling = sheet(0.0, 1.0, -0.5, 0.5, 2.5)
    assert len(segment(ceiling, VIEW, GroundSettings()).ground) == 0


def test_small_clusters_are_noise():
    floor = sheet(0.0, 1.0, -0.5, 0.5, 0.0)
    speck = np.array([[0.5, 0.0, 0.5], [0.5, 0.0, 0.55]])
    found = segment(np.concatenate([floor, speck]), VIEW, GroundSettings())
    assert len(found.obstacles) == 0
    kept = segment(np.concatenate([floor, speck]), VIEW, GroundSettings(min_cluster_size=2, normal_k=5))
    assert kept.obstacles.tolist() == [len(floor), len(floor) + 1]


def test_heights_alone():
    points = np.array([[1.0, 0, 0.0], [1.0, 0, 0.1], [1.0, 0, 0.100001], [1.0, 0, -3.0]])
    found = segment(points, VIEW, GroundSettings(by_normals=False, max_ground_height_m=0.1))
    assert (found.ground.tolist(), found.obstacles.tolist()) == ([0, 1, 3], [2])


def test_normals_of_rings_are_turned_up():
    floor = sheet(0.0, 1.0, -0.5, 0.5, 0.0)
    below = np.array([0.5, 0.0, -1.0])
    assert len(flat_points(floor, below, GroundSettings())) == 0
    above = np.array([0.5, 0.0, 0.2])
    assert len(flat_points(floor, above, GroundSettings(ground_normals_up=0.8))) == len(floor)


def test_degenerate_clouds_have_no_ground():
    line = np.column_stack([np.linspace(0, 1, 12), np.zeros(12), np.zeros(12)])
    assert len(flat_points(line, VIEW, GroundSettings())) == 0
    assert len(flat_points(np.zeros((5, 3)), VIEW, GroundSettings())) == 0
    assert [len(part) for part in segment(np.zeros((0, 3)), VIEW, GroundSettings())] == [0, 0]
    assert [len(part) for part in segment(np.zeros((2, 3)), VIEW, GroundSettings())] == [0, 0]


def test_lonely_points_are_noise():
    points = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.1, 0, 0], [1.0, 0, 0]])
    assert without_noise(points, 0.06, 1).tolist() == [True, True, True, False]
    assert without_noise(points, 0.06, 2).tolist() == [False, True, False, False]
