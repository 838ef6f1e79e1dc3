# SPDX-License-Identifier: MIT
"""Rays and odds of space, by hand and against naive twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.grids.octree import Octree
from slamcli.grids.odds_plane import OddsSettings
from slamcli.grids.voxel_odds import VoxelOdds
from slamcli.grids.voxel_rays import free_voxels, indices_of, numbers_of

pytestmark = pytest.mark.kernels
NONE = np.zeros((0, 3))
HIT, MISS = math.log(0.7 / 0.3), math.log(0.4 / 0.6)


def naive_free(start, hits, ends, cell):
    free = set()
    for n, end in enumerate(np.concatenate([hits, ends])):
        last = tuple(np.floor(end / cell).astype(int).tolist())
        for share in np.linspace(0.0, 1.0, 20001):
            at = tuple(np.floor((start + share * (end - start)) / cell).astype(int).tolist())
            if at == last and n < len(hits):
                break
            free.add(at)
    return free - {tuple(c) for c in np.floor(hits / cell).astype(int).tolist()}


def naive_odds(views, settings):
    hit, miss, least, most = settings.log_odds
    odds = {}
    for ground, obstacles, empty in views:
        cells = [
            {tuple(c) for c in np.floor(points / 0.5).astype(int).tolist()} for points in (ground, obstacles, empty)
        ]
        for cell in cells[0] | cells[1] | cells[2]:
            change = hit if cell in cells[0] | cells[1] else miss
            odds[cell] = min(max(odds.get(cell, 0.0) + change, least), most)
    return odds


def test_numbers_of_cells_come_back():
    cells = np.array([[0, 0, 0], [-1, 5, -70000], [1048574, -1048575, 3]])
    np.testing.assert_array_equal(indices_of(numbers_of(cells)), cells)


def test_cells_before_a_hit_and_up_to_an_open_end():
    start = np.array([0.5, 0.5, 0.5])
    assert free_voxels(start, np.array([[0.5, 0.5, 3.5]]), NONE, 1.0).tolist() == [[0, 0, 0], [0, 0, 1], [0, 0, 2]]
    assert free_voxels(start, NONE, np.array([[-1.5, 0.5, 0.5]]), 1.0).tolist() == [[0, 0, 0], [-1, 0, 0], [-2, 0, 0]]
    assert free_voxels(start, NONE, NONE, 1.0).shape == (0, 3)


def test_what_is_hit_is_not_free_though_another_ray_passes():
    free = free_voxels(np.full(3, 0.5), np.array([[2.5, 0.5, 0.5]]), np.array([[4.5, 0.5, 0.5]]), 1.0)
    assert sorted(free.tolist()) == [[0, 0, 0], [1, 0, 0], [3, 0, 0], [4, 0, 0]]


@pytest.mark.parametrize("seed", range(3))
def test_free_voxels_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2, 2, 3)
    hits, ends = start + rng.normal(0, 3, (10, 3)), start + rng.normal(0, 3, (4, 3))
    found = {tuple(cell) for cell in free_voxels(start, hits, ends, 0.5).tolist()}
    expected = naive_free(start, hits, ends, 0.5)
    assert expected - found == set()
    assert len(found - expected) <= 2  # whose corner a ray just cuts


def test_many_cells_are_all_kept():
    rng = np.random.default_rng(1)
    hits = rng.normal(0, 1, (500, 3))
    hits *= 3.0 / np.linalg.norm(hits, axis=1, keepdims=True)
    free = free_voxels(np.zeros(3), hits, NONE, 0.05)
    assert len(free) == len(np.unique(free, axis=0)) > 10_000


def test_rays_without_end_are_refused():
    with pytest.raises(DataError, match="cannot be traced"):
        free_voxels(np.zeros(3), np.array([[1e7, 0.0, 0.0]]), NONE, 0.05)
    with pytest.raises(DataError, match="too far for cells"):
        VoxelOdds(0.05, OddsSettings()).add(NONE, np.array([[1e7, 0.0, 0.0]]), NONE)


@pytest.mark.parametrize("seed", [0, 1])
def test_odds_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    views = [tuple(rng.uniform(-30, 30, (n, 3)) for n in (400, 400, 900)) for _ in range(3)]
    views += views[:1] * 6
    voxels = VoxelOdds(0.5, OddsSettings())
    for view in views:
        voxels.add(*view)
    tree = voxels.octree()
    expected = naive_odds(views, OddsSettings())
    assert [tuple(cell) for cell in tree.indices.tolist()] == sorted(expected)
    np.testing.assert_allclose(tree.log_odds, [expected[cell] for cell in sorted(expected)], atol=1e-5)


def test_ground_and_obstacles_are_told_apart_and_a_hit_is_no_miss():
    voxels = VoxelOdds(1.0, OddsSettings())
    a, b, c = ([[x + 0.5, 0.5, 0.5]] for x in range(3))
    voxels.add(np.array(a + b), np.array(b), np.array(a + b + c))
    tree = voxels.octree()
    np.testing.assert_allclose(tree.log_odds, [HIT, HIT, MISS], rtol=1e-6)
    assert tree.ground.tolist() == [True, False, False]
    assert tree.occupied.tolist() == [True, True, False]
    np.testing.assert_allclose(tree.centres_m, [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [2.5, 0.5, 0.5]])
    grid = tree.projected("map")
    assert (grid.cells.tolist(), grid.origin) == ([[0, 100, 0]], (0.0, 0.0, 0.0))


def test_an_empty_tree():
    tree = VoxelOdds(1.0, OddsSettings()).octree()
    assert len(tree) == 0
    assert tree.projected("map") is None


def test_free_space_behind_walls_is_dropped():
    x = np.arange(7)
    log_odds = np.array([MISS, MISS, MISS, HIT, MISS, MISS, HIT], dtype=np.float32)
    tree = Octree(
        resolution_m=1.0, indices=np.column_stack([x, 0 * x, 0 * x]), edges=np.ones(7, np.int64), log_odds=log_odds,
        ground=np.zeros(7, bool),
    )  # fmt: skip
    left = tree.reached_from(np.zeros(3), 16)
    assert left.indices[:, 0].tolist() == [0, 1, 2, 3, 6]
    # One level up the cells are 0-1, 2-3, 4-5 and 6: 2-3 holds the wall.
    assert tree.reached_from(np.zeros(3), 15).indices[:, 0].tolist() == [0, 1, 2, 3, 6]
    beside = tree.reached_from(np.array([-0.5, 0.0, 0.0]), 16)
    assert beside.indices[:, 0].tolist() == [0, 1, 2, 3, 6]
    nowhere = tree.reached_from(np.array([0.0, 9.0, 0.0]), 16)
    assert nowhere.indices[:, 0].tolist() == [3, 6]
