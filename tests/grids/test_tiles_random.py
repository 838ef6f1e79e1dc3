# SPDX-License-Identifier: MIT
"""Tiled maps under random sequences of scans, resamplings and clearings: equal to maps that share nothing (naive twin)."""

from __future__ import annotations

import copy
import math
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.errors import DataError
from slamcli.grids import _tile_kernels as kernels
from slamcli.grids.tiles import TiledMaps

pytestmark = pytest.mark.kernels

DELTA = 0.1


class NaiveMaps:
    """One dictionary of cells per map: (row, column) from the map's zero to visits, hits, sum of hit points."""

    def __init__(self, num_maps):
        self.maps = [{} for _ in range(num_maps)]

    def add_scan(self, poses, start, ends, hit, maps=None):
        for index, pose in zip(range(len(self.maps)) if maps is None else maps, poses, strict=True):
            c, s = math.cos(pose[2]), math.sin(pose[2])
            turn, cells = np.array([[c, s], [-s, c]]), self.maps[index]
            origin = start[0] @ turn + pose[:2]
            for end, is_hit in zip(ends @ turn + pose[:2], hit, strict=True):
                for key in bresenham(origin, end):
                    cells.setdefault(key, [0, 0, 0.0, 0.0])[0] += 1
                if is_hit:
                    entry = cells[key]
                    cells[key] = [entry[0], entry[1] + 1, entry[2] + end[0], entry[3] + end[1]]

    def resample(self, parents):
        self.maps = [copy.deepcopy(self.maps[parent]) for parent in parents]

    def clear(self, index):
        self.maps[index] = {}


def bresenham(a, b):
    (j, i), (je, ie) = (np.floor(p / DELTA).astype(int).tolist() for p in (a, b))
    dj, di, sj, si = abs(je - j), abs(ie - i), 1 if j < je else -1, 1 if i < ie else -1
    error = dj - di
    yield i, j
    while (i, j) != (ie, je):
        double = 2 * error
        if double > -di:
            error, j = error - di, j + sj
        if double < dj:
            error, i = error + dj, i + si
        yield i, j


def contents(maps, index):
    """Cells of one tiled map as the twin holds them, mean hits in place of sums."""
    found, (x, y) = {}, maps.origin
    row0, column0 = round(y / DELTA), round(x / DELTA)
    for row, column in zip(*np.nonzero(maps.tables[index]), strict=True):
        tile = maps.cells[maps.tables[index, row, column]]
        for i, j in zip(*np.nonzero(tile[..., 0]), strict=True):
            found[int(row0 + 32 * row + i), int(column0 + 32 * column + j)] = tile[i, j].tolist()
    return found


def assert_equal(maps, twin):
    for index, cells in enumerate(twin.maps):
        found = contents(maps, index)
        assert found.keys() == cells.keys()
        for key, (visits, hits, x, y) in cells.items():
            assert found[key][:2] == [visits, hits]
            if hits:
                mean = [x / hits - key[1] * DELTA, y / hits - key[0] * DELTA]
                np.testing.assert_allclose(found[key][2:], mean, atol=1e-5)


def assert_sound(maps):
    """Owners are counted right, free tiles are empty, and nobody owns a free one."""
    used = Counter(maps.tables[maps.tables > 0].tolist())
    assert maps.num_tiles == len(used)
    assert all(maps._owners[tile] == count for tile, count in used.items())
    assert not used.keys() & set(maps._free)
    assert len(maps._free) == len(set(maps._free))
    assert not maps.cells[maps._free].any()
    assert not maps.cells[0].any()
    assert not maps.cells[maps._next : maps._next + 3].any()


@given(st.integers(0, 2**32 - 1), st.lists(st.sampled_from(["scan", "some", "resample", "fewer", "clear"]), max_size=7))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_any_sequence_leaves_what_maps_of_their_own_would_hold(seed, actions):
    rng = np.random.default_rng(seed)
    maps, twin = TiledMaps(3, DELTA, (-0.5, -0.5, 0.5, 0.5)), NaiveMaps(3)
    for action in ["scan", *actions]:
        count = len(maps.tables)
        if action in ("scan", "some"):
            chosen = np.arange(count) if action == "scan" else np.flatnonzero(rng.random(count) < 0.6)
            poses = rng.normal(0, 2.0, (count, 3))[chosen]
            ends = rng.uniform(-2.5, 2.5, (6, 2))
            hit, start = rng.random(6) < 0.7, rng.normal(0, 0.2, (1, 2))
            if len(chosen):
                for each in (maps, twin):
                    each.add_scan(poses, start, ends, hit, chosen)
        elif action == "clear":
            index = int(rng.integers(count))
            maps.clear(index)
            twin.clear(index)
        else:
            parents = np.sort(rng.integers(0, count, count if action == "resample" else max(1, count - 1)))
            maps.resample(parents)
            twin.resample(parents.tolist())
        assert_sound(maps)
    assert_equal(maps, twin)


def test_freed_tiles_are_used_again():
    rng = np.random.default_rng(5)
    maps = TiledMaps(4, DELTA, (-3.0, -3.0, 3.0, 3.0))
    ends, start = rng.uniform(-2.5, 2.5, (30, 2)), np.zeros((1, 2))
    reserved = []
    for _ in range(6):
        maps.add_scan(rng.normal(0, 0.1, (4, 3)), start, ends, np.ones(30, np.bool_))
        maps.resample(np.full(4, rng.integers(4)))
        reserved.append(maps._next)
        assert_sound(maps)
    assert reserved[1:] == reserved[1:2] * 5  # nothing new after the second round
    assert maps.num_tiles == len(np.unique(maps.tables[maps.tables > 0]))


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1)])
def test_growth_in_every_direction_keeps_what_was_there(direction):
    maps, twin = TiledMaps(2, DELTA, (-0.5, -0.5, 0.5, 0.5)), NaiveMaps(2)
    ends, hit = np.array([[1.03, 0.52], [-0.48, 0.97], [0.51, -1.2]]), np.array([True, False, True])
    for distance in (0.0, 7.3, 31.7):
        poses = np.array([[*(distance * np.array(direction)), 0.1], [*(-0.5 * distance * np.array(direction)), 2.0]])
        for each in (maps, twin):
            each.add_scan(poses, np.array([[0.12, 0.0]]), ends, hit)
    assert_equal(maps, twin)
    assert_sound(maps)


def test_threads_change_nothing():
    def run(executor, jobs):
        rng = np.random.default_rng(6)
        maps = TiledMaps(5, DELTA, (-1.0, -1.0, 1.0, 1.0), executor, jobs)
        for _ in range(4):
            ends = rng.uniform(-3, 3, (40, 2))
            maps.add_scan(rng.normal(0, 1, (5, 3)), np.zeros((1, 2)), ends, rng.random(40) < 0.8)
            maps.resample(np.sort(rng.integers(0, 5, 5)))
        return maps

    with ThreadPoolExecutor(3) as executor:
        one, many = run(None, 1), run(executor, 3)
    np.testing.assert_array_equal(one.tables, many.tables)
    np.testing.assert_array_equal(one.cells[: one._next], many.cells[: one._next])


def test_touched_tiles_are_those_that_register_writes_to():
    rng = np.random.default_rng(7)
    for _ in range(10):
        cells, table = np.zeros((17, 32, 32, 4), np.float32), np.arange(1, 17, dtype=np.int32).reshape(4, 4)
        ends, start = rng.uniform(-4, 4, (5, 2)), rng.uniform(-0.5, 0.5, (1, 2))
        pose = np.array([6.4, 6.4, rng.uniform(-3, 3)])
        touched = np.zeros((4, 4), np.uint8)
        assert kernels.touched_tiles(touched, 0.0, 0.0, DELTA, start, ends, pose)
        kernels.register(cells, table, 0.0, 0.0, DELTA, start, ends, np.ones(5, np.bool_), pose)
        np.testing.assert_array_equal(touched > 0, cells[table][..., 0].any(axis=(2, 3)))


@pytest.mark.parametrize("end", [(20.0, 0.0), (-20.0, 0.0), (0.0, 20.0), (0.0, -20.0)])
def test_touched_tiles_says_when_a_beam_leaves_the_table(end):
    touched = np.zeros((4, 4), np.uint8)
    pose = np.array([6.4, 6.4, 0.0])
    assert not kernels.touched_tiles(touched, 0.0, 0.0, DELTA, np.zeros((1, 2)), np.array([end]), pose)


def test_a_scan_without_beams_and_one_of_no_length():
    maps, twin = TiledMaps(1, DELTA, (-1.0, -1.0, 1.0, 1.0)), NaiveMaps(1)
    maps.add_scan(np.zeros((1, 3)), np.zeros((1, 2)), np.empty((0, 2)), np.empty(0, np.bool_))
    assert maps.num_tiles == 0
    for each in (maps, twin):  # duplicates, and a beam that ends where it begins
        each.add_scan(np.zeros((1, 3)), np.zeros((1, 2)), np.zeros((3, 2)), np.array([True, True, False]))
    assert_equal(maps, twin)
    assert contents(maps, 0) == {(0, 0): [3.0, 2.0, 0.0, 0.0]}


@pytest.mark.parametrize(
    "pose", [(1e12, 0.0, 0.0), (0.0, -1e300, 0.0), (np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, np.nan)]
)
def test_absurd_poses_are_refused_and_leave_the_maps_alone(pose):
    maps, twin = TiledMaps(1, DELTA, (-1.0, -1.0, 1.0, 1.0)), NaiveMaps(1)
    good, ends, hit = np.zeros((1, 3)), np.array([[0.5, 0.2]]), np.array([True])
    for each in (maps, twin):
        each.add_scan(good, np.zeros((1, 2)), ends, hit)
    with pytest.raises(DataError):
        maps.add_scan(np.array([pose]), np.zeros((1, 2)), ends, hit)
    assert_equal(maps, twin)


def test_a_first_extent_that_is_too_large_starts_small_and_one_without_end_is_refused():
    maps, twin = TiledMaps(1, DELTA, (-1e6, -1e6, 1e6, 1e6)), NaiveMaps(1)
    assert maps.tables.size < 100
    for each in (maps, twin):
        each.add_scan(np.array([[20.0, -30.0, 0.5]]), np.zeros((1, 2)), np.array([[1.0, 0.3]]), np.array([True]))
    assert_equal(maps, twin)
    for bounds in ((-np.inf, -1.0, 1.0, 1.0), (-1.0, -1.0, 1.0, np.nan)):
        with pytest.raises(DataError, match="extent"):
            TiledMaps(1, DELTA, bounds)


def test_occupancy_equals_the_twins_shares():
    rng = np.random.default_rng(8)
    maps, twin = TiledMaps(1, DELTA, (-1.0, -1.0, 1.0, 1.0)), NaiveMaps(1)
    for _ in range(4):
        ends, hit = rng.uniform(-3, 3, (50, 2)), rng.random(50) < 0.7
        pose = rng.normal(0, 0.5, (1, 3))
        for each in (maps, twin):
            each.add_scan(pose, np.zeros((1, 2)), ends, hit)
    for threshold in (0.0, 0.25, 0.5, 1.0):
        grid = maps.occupancy(0, threshold, "world", margin_cells=3)
        assert grid.frame_id == "world"
        assert (grid.cells >= 0).sum() == len(twin.maps[0])
        row0, column0 = (round(value / DELTA) for value in (grid.origin[1], grid.origin[0]))
        for (i, j), (visits, hits, *_) in twin.maps[0].items():
            assert grid.cells[i - row0, j - column0] == (100 if hits > np.float32(threshold) * visits else 0)


@pytest.mark.parametrize("end", [np.nan, np.inf])
def test_ends_that_are_not_finite_are_refused(end):
    maps = TiledMaps(1, DELTA, (-1.0, -1.0, 1.0, 1.0))
    with pytest.raises(DataError, match="finite"):
        maps.add_scan(np.zeros((1, 3)), np.zeros((1, 2)), np.array([[0.5, 0.0], [end, 0.0]]), np.ones(2, np.bool_))
