# SPDX-License-Identifier: MIT
"""Grids of signed distances: normals, updates, growth, cropping and what a map shows equal their naive twins."""

from __future__ import annotations

import math
from dataclasses import replace

import naive_tsdf as naive
import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.geometry import se2
from slamcli.grids import _tsdf_kernels as kernels
from slamcli.grids.distance_drawing import drawn_distances, trinary_by_distance
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.submap_drawing import draw_submaps
from slamcli.grids.submap_grid import shown
from slamcli.grids.tsdf_grid import TsdfGrid, TsdfInserter

pytestmark = pytest.mark.kernels

NONE = np.empty((0, 2))
PLAIN = TsdfInserter(angle_bandwidth_rad=0.0, distance_bandwidth_m=0.0)
START = np.array([0.025, 0.025])


def empty(resolution=0.05, size=160, truncation=0.3, most=10.0):
    return TsdfGrid.empty(resolution, (0.0, 0.0), truncation, most, size)


def weights_of(grid):
    return np.where(grid.weights == 0, 0.0, (grid.weights - 1.0) * grid.max_weight / 32766.0)


def cell(grid, x, y):
    return tuple(math.floor((v - o) / grid.resolution_m) for v, o in ((y, grid.origin[1]), (x, grid.origin[0])))


def wall(x, count=81, half=1.5):
    """Points on a wall across the way ahead, sorted by nothing."""
    return np.column_stack([np.full(count, x), np.linspace(half, -half, count)])


def test_values_are_distances():
    grid = TsdfGrid(np.array([[0, 1, 16384, 32767]], np.uint16), np.full((1, 4), 9, np.uint16), 0.1, (0, 0), 0.3, 10.0)
    np.testing.assert_allclose(grid.distances(), [[np.nan, -0.3, 0.0, 0.3]], atol=1e-6)
    assert grid.cells is grid.tsd


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 7])
def test_normals_equal_the_naive_twin(samples):
    rng = np.random.default_rng(samples)
    start = rng.normal(0, 0.3, 2)
    for points in (
        rng.uniform(-3, 3, (60, 2)),
        np.repeat(rng.uniform(-3, 3, (9, 2)), 3, axis=0),
        rng.uniform(1, 2, (1, 2)),
    ):
        ordered = naive.by_bearing(start, points)
        found = kernels.normals(ordered, start, samples, 0.7)
        expected = naive.normals(start, ordered, samples, 0.7)
        np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * np.array(expected)), atol=1e-9)
    assert kernels.normals(NONE, start, samples, 0.7).shape == (0,)


def test_the_normal_of_a_wall_points_back_at_the_scanner():
    points = naive.by_bearing(np.zeros(2), wall(2.0))
    np.testing.assert_allclose(np.abs(kernels.normals(points, np.zeros(2), 4, 0.5)), math.pi, atol=1e-9)
    alone = kernels.normals(np.array([[2.0, 1.0]]), np.zeros(2), 4, 0.5)
    np.testing.assert_allclose(alone, math.atan2(-1.0, -2.0))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"update_free_space": True},
        {"project_sdf_distance_to_scan_normal": False},
        {"update_weight_range_exponent": 2},
        {"angle_bandwidth_rad": 0.0, "distance_bandwidth_m": 0.1},
        {"angle_bandwidth_rad": 0.3, "distance_bandwidth_m": 0.0, "num_normal_samples": 2, "sample_radius_m": 2.0},
    ],
    ids=str,
)
def test_random_scans_equal_the_naive_twin(changes):
    settings, grid = replace(TsdfInserter(), **changes), empty(0.07, 140, 0.25, 1.5)
    rng = np.random.default_rng(3)
    tsd, weights = np.zeros(grid.tsd.shape), np.zeros(grid.tsd.shape)
    for _ in range(4):
        pose, start = rng.normal(0, 0.4, 3), rng.normal(0, 0.2, 2)
        points = rng.uniform(-3, 3, (25, 2))
        points[:2] = start + 0.1  # nearer than the truncation distance
        placed = se2.transform_points(pose, points)
        tsd, weights = naive.inserted(tsd, weights, grid, settings, se2.transform_points(pose, [start])[0], placed)
        assert settings.insert(grid, pose, start, points, rng.uniform(-3, 3, (4, 2))) is grid
    known = weights > 1e-3
    assert known.sum() > 200
    np.testing.assert_array_equal((grid.weights > 1)[known], True)
    np.testing.assert_array_equal(grid.tsd[weights == 0.0], 0)
    np.testing.assert_allclose(weights_of(grid), weights, atol=4 * 1.5 / 32766)
    np.testing.assert_allclose(grid.distances()[known], tsd[known], atol=2e-3)
    assert weights_of(grid).max() == pytest.approx(1.5) or not changes.get("update_free_space")


def test_a_wall_is_a_ramp_of_distances_along_its_normal():
    grid, points = empty(), wall(2.0)
    TsdfInserter().insert(grid, np.zeros(3), START, points, NONE)
    rows, columns = np.nonzero(grid.weights > 1)
    x = grid.origin[0] + (columns + 0.5) * 0.05
    np.testing.assert_allclose(grid.distances()[rows, columns], np.clip(2.0 - x, -0.3, 0.3), atol=1e-4)
    assert x.min() > 1.5  # only a band around the wall is known
    assert x.max() < 2.5
    whole = replace(TsdfInserter(), update_free_space=True)
    free = whole.insert(empty(), np.zeros(3), START, points, NONE)
    assert free.distances()[cell(free, 1.0, 0.025)] == pytest.approx(0.3)


def test_along_the_beam_distances_are_those_of_the_range():
    settings, grid = replace(PLAIN, project_sdf_distance_to_scan_normal=False), empty()
    settings.insert(grid, np.zeros(3), START, np.array([[1.525, 1.525]]), NONE)
    rows, columns = np.nonzero(grid.tsd)
    x, y = (grid.origin[k] + (index + 0.5) * 0.05 for k, index in ((0, columns), (1, rows)))
    expected = 1.5 * math.sqrt(2.0) - np.hypot(x - START[0], y - START[1])
    np.testing.assert_allclose(grid.distances()[rows, columns], np.clip(expected, -0.3, 0.3), atol=1e-5)


def test_weights_add_up_to_the_most():
    grid, point = empty(most=3.5), np.array([[1.025, 0.025]])
    where = cell(grid, 1.025, 0.025)
    for expected in (1.0, 2.0, 3.0, 3.5, 3.5):
        PLAIN.insert(grid, np.zeros(3), START, point, NONE)
        assert weights_of(grid)[where] == pytest.approx(expected, abs=3e-4)
    both = replace(TsdfInserter(), update_weight_range_exponent=1).insert(empty(), np.zeros(3), START, point, NONE)
    assert weights_of(both)[where] == pytest.approx(naive.bell(0, 0.5) ** 2 / 1.0, abs=3e-4)


def test_surfaces_that_move_are_averaged_by_weight():
    grid = empty()
    for x in (1.0, 1.1, 1.1, 1.1):
        PLAIN.insert(grid, np.zeros(3), START, np.array([[x, 0.025]]), NONE)
    assert grid.distances()[cell(grid, 1.025, 0.025)] == pytest.approx(1.075 - 1.025, abs=1e-4)


def test_in_one_scan_a_cell_changes_once_and_near_points_and_misses_not_at_all():
    grid, same = empty(), np.repeat([[1.025, 0.025]], 5, axis=0)
    PLAIN.insert(grid, np.zeros(3), START, same, NONE)
    assert weights_of(grid).max() == pytest.approx(1.0, abs=3e-4)
    nothing = PLAIN.insert(empty(), np.zeros(3), START, np.array([[0.2, 0.1]]), same)
    assert not nothing.tsd.any()
    assert not PLAIN.insert(empty(), np.zeros(3), START, NONE, NONE).tsd.any()


def test_a_surface_seen_along_weighs_little():
    grid, settings = empty(), TsdfInserter()
    steep = np.array([[1.5, 0.3], [1.6, 0.305], [1.7, 0.31]])
    settings.insert(grid, np.zeros(3), START, steep, NONE)
    facing = settings.insert(empty(), np.zeros(3), START, wall(1.6, 9, 0.2), NONE)
    assert weights_of(grid).max() < 0.05 * weights_of(facing).max()


def test_a_grid_grows_and_keeps_what_it_knows():
    small = TsdfInserter().insert(empty(size=60), np.zeros(3), START, wall(1.0, 40, 0.5), NONE)
    larger = TsdfInserter().insert(small, np.array([0.0, 0.0, 2.0]), START, wall(8.0, 40, 2.0), NONE)
    assert larger.tsd.size > small.tsd.size
    assert np.count_nonzero(small.tsd) > 100
    for i, j in np.argwhere(small.tsd).tolist():
        x, y = small.origin[0] + (j + 0.5) * 0.05, small.origin[1] + (i + 0.5) * 0.05
        assert larger.tsd[cell(larger, x, y)] == small.tsd[i, j]
        assert larger.weights[cell(larger, x, y)] == small.weights[i, j]
    assert larger.with_room(np.zeros(2), np.ones(2)) is larger
    with pytest.raises(DataError, match="the ranges are broken"):
        small.with_room(np.zeros(2), np.full(2, 9000.0))


def test_cropping_leaves_what_is_known():
    grid = TsdfInserter().insert(empty(), np.zeros(3), START, wall(2.0), NONE)
    small = grid.cropped()
    assert small.tsd.shape == small.weights.shape
    assert small.tsd.size < grid.tsd.size / 4
    i, j = cell(grid, 1.92, 0.12)
    assert small.tsd[cell(small, 1.92, 0.12)] == grid.tsd[i, j] > 0
    assert (small.truncation_distance_m, small.max_weight, small.resolution_m) == (0.3, 10.0, 0.05)
    assert np.count_nonzero(small.tsd) == np.count_nonzero(grid.tsd)
    assert empty().cropped().tsd.tolist() == [[0]]


def drawn_at(drawn, x, y=0.025):
    column, row = (math.floor((v - drawn.origin[k]) / 0.05) for k, v in ((0, x), (1, y)))
    return int(drawn.cells[row, column])


def free_wall(x, pose=(0.0, 0.0, 0.0), count=81):
    """A grid in which a wall across the way ahead is seen, free space and all."""
    settings = replace(TsdfInserter(), update_free_space=True)
    ends = se2.transform_points(se2.inverse(pose), wall(x, count))
    return settings.insert(empty(), np.array(pose), np.zeros(2), ends, NONE)


@pytest.mark.parametrize("mixed", [False, True])
def test_a_map_shows_the_surface_and_the_free_side(mixed):
    grid = free_wall(2.02)
    drawn = draw_submaps([grid, shown(grid)] if mixed else [grid], np.zeros((2 if mixed else 1, 3)), 0.05)
    assert [drawn_at(drawn, x) for x in (0.5, 1.5, 1.975, 2.025, 2.075, 2.2)] == [0, 0, 0, 100, -1, -1]
    probabilities = grid.as_probabilities()
    assert isinstance(probabilities, ProbabilityGrid)
    assert shown(probabilities) is probabilities
    assert np.nanmax(probabilities.probabilities()) > 0.8
    assert np.nanmin(probabilities.probabilities()) == pytest.approx(0.1)


def test_submaps_that_differ_by_two_cells_draw_one_wall_between():
    drawn = draw_submaps([free_wall(1.975), free_wall(2.075)], np.zeros((2, 3)), 0.05)
    assert [drawn_at(drawn, x) for x in (1.875, 1.925, 1.975, 2.025, 2.075, 2.125)] == [0, 0, 0, 100, -1, -1]


def test_a_thin_wall_seen_from_both_sides_has_two_faces():
    drawn = draw_submaps([free_wall(1.975), free_wall(2.075, (4.0, 0.0, math.pi))], np.zeros((2, 3)), 0.05)
    row = [drawn_at(drawn, x) for x in (0.5, 1.5, 1.875, 1.975, 2.075, 2.175, 2.5, 3.5)]
    assert row[:3] == [0, 0, 0]
    assert row[-3:] == [0, 0, 0]
    assert 100 in [drawn_at(drawn, x) for x in (1.925, 1.975, 2.025)]
    assert 100 in [drawn_at(drawn, x) for x in (2.025, 2.075, 2.125)]


def test_where_the_sign_changes_the_nearer_of_two_cells_is_the_surface():
    nan = np.nan
    distances = np.array([[2.0, 0.9, -0.7, -2.0], [2.0, 0.6, -0.8, nan], [nan, 2.0, nan, -0.6], [2.0, 0.5, 0.2, -1.4]])
    expected = [[0, 0, 100, -1], [0, 100, -1, -1], [-1, 0, -1, -1], [0, 100, 100, -1]]
    assert trinary_by_distance(distances.astype(np.float32)).tolist() == expected


def test_a_map_takes_no_more_than_two_cells_behind_a_surface():
    grid = free_wall(2.0)
    cells, table = drawn_distances(grid, 0.05)
    x = grid.origin[0] + (np.nonzero(cells)[1] + 0.5) * 0.05
    assert 2.05 < x.max() < 2.1
    assert table.max() == 2.0
    assert table[16384] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("heading", [0.3, 0.79, 2.5])
def test_drawn_turned_a_wall_has_no_holes(heading):
    grid = TsdfInserter().insert(empty(), np.zeros(3), START, wall(2.0, 200), NONE)
    drawn = draw_submaps([grid], np.array([[0.3, 0.2, heading]]), 0.05)
    for y in np.arange(-1.2, 1.2, 0.01):
        point = se2.transform_points([0.3, 0.2, heading], [[2.0, y]])[0]
        column, row = (math.floor((point[k] - drawn.origin[k]) / 0.05) for k in (0, 1))
        assert (drawn.cells[row - 1 : row + 2, column - 1 : column + 2] == 100).any()
