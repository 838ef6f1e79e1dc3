# SPDX-License-Identifier: MIT
"""Frontiers on maps drawn by hand, and against a naive search."""

from __future__ import annotations

import heapq
import math
from collections import deque

import numpy as np
import pytest
from scipy import ndimage

from slamcli.grids import OccupancyGrid
from slamcli.navigation import _frontier_kernels as kernels
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.navigation.frontiers import FrontierSearch, costs_for_exploring, costs_of_map

pytestmark = pytest.mark.kernels

DEFAULTS = {"min_frontier_size": 0.0, "potential_scale": 1e-3, "goal_point": "centroid", "goal_distance": 0.0}
VALUES = {".": 0, "#": 254, "?": 255, "i": 253, "c": 100}
LITE = {
    "snap_goal": False, "distance": "straight", "through_cost": 0, "look_in": False, "min_frontier_size": 0.0,
}  # fmt: skip


def drawn(*rows):
    """Costs of rows from the top one on."""
    return np.array([[VALUES[c] for c in row] for row in rows[::-1]], np.uint8)


def find(costs, pose=(0.5, 0.5, 0.0), resolution_m=1.0, origin=(0.0, 0.0), **parameters):
    p = ExploreParameters(**DEFAULTS | parameters)
    return FrontierSearch(p).find(costs, origin, resolution_m, np.array(pose))


def cells(frontier):
    return {tuple(cell) for cell in frontier.cells.tolist()}


def test_one_frontier_by_hand():
    costs = drawn(
        "####?",
        "#...?",
        "#...?",
        "#####",
    )
    (found,) = find(costs, (1.5, 1.5, 0.0))
    assert cells(found) == {(1, 4), (2, 4)}
    assert found.centroid.tolist() == [4.5, 2.0]
    assert found.middle.tolist() == [4.5, 1.5]
    assert found.length_m == 2.0
    assert found.distance_m == 3.0
    assert found.way_m == 2.0
    assert found.goal[:2].tolist() in ([3.5, 1.5], [3.5, 2.5])
    assert abs(found.goal[2]) < 0.6
    assert found.cost == pytest.approx(1e-3 * 2.0 - 2.0)


def test_cost_of_explore_lite():
    costs = drawn("?....?", "?....#")
    found = find(costs, (1.5, 0.5, 0.0), potential_scale=3.0, gain_scale=0.5, **LITE)
    assert [len(one.cells) for one in found] == [2, 1]
    assert found[0].cost == pytest.approx(3.0 * 1.0 - 0.5 * 2)
    assert found[1].cost == pytest.approx(3.0 * math.hypot(4.0, 1.0) - 0.5 * 1)
    assert found[0].goal[:2].tolist() == [0.5, 1.0]


def test_behind_walls_there_is_nothing_to_reach():
    costs = drawn("...#..?", "...#..?", "...####")
    assert find(costs) == ()
    costs[2, 3] = 0
    assert len(find(costs)) == 1


def test_corners_hold_together_and_small_ones_are_left_out():
    costs = drawn("..?..", ".?...", ".....", "....?")
    found = find(costs, (0.5, 1.5, 0.0))
    assert sorted(len(one.cells) for one in found) == [1, 2]
    assert [len(one.cells) for one in find(costs, (0.5, 1.5, 0.0), min_frontier_size=1.5)] == [2]


def test_inflated_cells_are_crossed_where_the_robot_fits():
    costs = drawn("#####", ".ccc?", "#####")
    assert len(find(costs, (0.5, 1.5, 0.0))) == 1
    assert find(costs, (0.5, 1.5, 0.0), through_cost=0, look_in=False) == ()


def test_the_robot_looks_in_where_it_does_not_fit():
    costs = drawn(".....", "..#i#", "..#i#", "..#?#")
    (found,) = find(costs, (0.5, 3.5, 0.0))
    assert found.goal[:2].tolist() == [3.5, 3.5]
    assert found.way_m == 3.0
    assert find(costs, (0.5, 3.5, 0.0), look_in=False) == ()


def test_a_centroid_in_a_wall_is_moved_to_where_the_robot_can_stand():
    costs = drawn("?????", "?...?", "?.#.?", "?...?", "?????")
    (as_lite,) = find(costs, (1.5, 1.5, 0.0), snap_goal=False)
    row, column = math.floor(as_lite.goal[1]), math.floor(as_lite.goal[0])
    assert costs[row, column] == 254
    (snapped,) = find(costs, (1.5, 1.5, 0.0))
    assert costs[math.floor(snapped.goal[1]), math.floor(snapped.goal[0])] == 0


def test_goals_keep_away_from_walls():
    costs = drawn("cc?", "..?", "cc?", "cc?", "cc?")
    costs[costs == 100] = 252
    near = {
        clearance: find(costs, (0.5, 3.5, 0.0), goal_clearance=clearance)[0].goal[1] for clearance in (0.0, 0.9, 1.1)
    }
    assert near == {0.0: 2.5, 0.9: 2.5, 1.1: 3.5}  # the centroid is at 2.5, the cell that costs nothing one above it


@pytest.mark.parametrize("point", ["centroid", "middle", "initial"])
def test_goal_points(point):
    costs = drawn("......?", "#####.?", "......?")
    (found,) = find(costs, (0.5, 0.5, 0.0), goal_point=point, snap_goal=False)
    assert found.goal[:2].tolist() == getattr(found, point).tolist()
    assert found.initial.tolist() == [6.5, 0.5]


def test_visible_gain_counts_what_is_in_sight():
    open_, walled = drawn("...?????"), drawn("...?#???")
    sees = {"gain": "visible", "gain_range": 4.0}
    assert find(open_, **sees)[0].gain_m == pytest.approx(4 / 4.0)
    assert find(walled, **sees)[0].gain_m == pytest.approx(1 / 4.0)


def test_a_robot_in_a_wall_starts_beside_it_and_far_from_all_nowhere():
    costs = drawn("#..?", "#..?")
    assert len(find(costs, (0.5, 0.5, 0.0))) == 1
    assert find(costs, (-3.0, 0.5, 0.0)) == ()
    assert find(costs, (1e6, 0.5, 0.0)) == ()
    assert find(np.full((3, 3), 255, np.uint8)) == ()


def test_frames_and_sizes_of_cells():
    costs = drawn("?????", ".....", "#####")
    (found,) = find(costs, (-9.7, 5.3, 0.0), resolution_m=0.2, origin=(-10.0, 5.0))
    assert found.centroid == pytest.approx([-9.5, 5.5])
    assert found.length_m == pytest.approx(1.0)
    assert found.goal[2] == pytest.approx(math.pi / 2)


def test_costs_of_a_map():
    grid = OccupancyGrid(np.array([[0, 100, -1], [64, 65, 10]], np.int8), 0.05)
    assert costs_of_map(grid).tolist() == [[0, 254, 255], [0, 254, 0]]


def window(costs, origin, resolution_m=0.5):
    return CostWindow(
        costs=costs, origin_m=origin, resolution_m=resolution_m, frame="map", footprint=np.zeros((3, 2)),
        inscribed_radius_m=0.1, circumscribed_radius_m=0.2,
    )  # fmt: skip


@pytest.mark.parametrize("yaw", [0.0, 1e-9, math.pi / 2])
def test_what_the_map_does_not_know_is_unknown(yaw):
    costs = np.array([[0, 0, 0, 254], [253, 253, 60, 0]], np.uint8)
    known = {(0, 0), (1, 0), (1, 2)}
    cells = np.full((2, 3), -1, np.int8)
    for cell in known:
        cells[cell] = 0
    grid = OccupancyGrid(cells, 0.5, (1.0, 1.0, yaw))
    if yaw > 1.0:
        grid = OccupancyGrid(np.ascontiguousarray(cells[::-1].T), 0.5, (1.0, 2.0, -yaw))
    found = costs_for_exploring(window(costs, (1.0, 1.0)), grid)
    assert found.tolist() == [[0, 255, 255, 254], [253, 255, 60, 255]]


def test_room_is_kept_and_shapes_may_change():
    search = FrontierSearch(ExploreParameters(min_frontier_size=0.0))
    first = search.find(drawn("..?", "..?"), (0.0, 0.0), 1.0, np.array([0.5, 0.5, 0.0]))
    other = search.find(drawn("....?"), (0.0, 0.0), 1.0, np.array([0.5, 0.5, 0.0]))
    again = search.find(drawn("..?", "..?"), (0.0, 0.0), 1.0, np.array([0.5, 0.5, 0.0]))
    assert len(other) == 1
    assert [cells(one) for one in first] == [cells(one) for one in again]


def naive_lengths(costs, start, through):
    """Dijkstra with steps of 5 and 7."""
    best, heap = {start: 0}, [(0, start)]
    height, width = costs.shape

    def free(i, j):
        return 0 <= i < height and 0 <= j < width and costs[i, j] <= through

    while heap:
        length, (i, j) = heapq.heappop(heap)
        if length > best[i, j]:
            continue
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                if not free(i + di, j + dj) or (di and dj and not (free(i + di, j) and free(i, j + dj))):
                    continue
                step = length + (7 if di and dj else 5)
                if step < best.get((i + di, j + dj), 1 << 60):
                    best[i + di, j + dj] = step
                    heapq.heappush(heap, (step, (i + di, j + dj)))
    return best


def naive_sides(cell, shape):
    i, j = cell
    return [
        (a, b) for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)) if 0 <= a < shape[0] and 0 <= b < shape[1]
    ]


def naive_frontiers(costs, start, through):
    """Sets of cells, each with the least length of the way to a cell in front."""
    lengths = naive_lengths(costs, start, through)
    front, queue = dict(lengths), deque(sorted(lengths))
    while queue:
        cell = queue.popleft()
        for other in naive_sides(cell, costs.shape):
            if other not in front and through < costs[other] < 254:
                front[other] = front[cell]
                queue.append(other)
    beside = {}
    for i, j in np.argwhere(costs == 255).tolist():
        near = [front[other] for other in naive_sides((i, j), costs.shape) if other in front]
        if near:
            beside[i, j] = min(near)
    mask = np.zeros(costs.shape, bool)
    for cell in beside:
        mask[cell] = True
    labels, count = ndimage.label(mask, np.ones((3, 3)))
    groups = [{tuple(cell) for cell in np.argwhere(labels == k + 1).tolist()} for k in range(count)]
    return [(group, min(beside[cell] for cell in group)) for group in groups]


@pytest.mark.parametrize("seed", range(12))
def test_equals_the_naive_search(seed):
    random = np.random.default_rng(seed)
    costs = random.choice(
        np.array([0, 60, 252, 253, 254, 255], np.uint8), random.integers(3, 30, 2), p=[0.4, 0.1, 0.1, 0.13, 0.12, 0.15]
    )
    free = np.argwhere(costs <= 252)
    start = tuple(free[random.integers(len(free))].tolist())
    found = find(costs, (start[1] + 0.5, start[0] + 0.5, 0.0))
    twin = naive_frontiers(costs, start, 252)
    assert sorted((sorted(cells(one)), round(5 * one.way_m)) for one in found) == sorted(
        (sorted(group), length) for group, length in twin
    )


def test_what_is_seen_equals_its_naive_twin():
    random = np.random.default_rng(3)
    costs = random.choice(np.array([0, 254, 255], np.uint8), (30, 40), p=[0.6, 0.05, 0.35])
    costs[[0, -1]], costs[:, [0, -1]] = 254, 254
    seen = np.zeros(costs.size, np.int64)
    naive = set()
    for k in range(60):
        for step in range(1, 13):
            angle = 2.0 * math.pi * k / 60
            i, j = math.floor(12 + 0.5 + step * math.sin(angle)), math.floor(20 + 0.5 + step * math.cos(angle))
            if costs[i, j] == 254:
                break
            if costs[i, j] == 255:
                naive.add((i, j))
    assert kernels.visible_unknown(costs.ravel(), 40, 12 * 40 + 20, 12.0, 60, seen, 1) == len(naive)
    assert {divmod(k, 40) for k in np.flatnonzero(seen).tolist()} == naive


@pytest.mark.parametrize("point", ["initial", "middle", "centroid"])
def test_a_goal_is_not_where_the_robot_is_already(point):
    costs = drawn("?????????", ".........", "#########")
    pose = (1.5, 1.5, 0.0)
    (near,) = find(costs, pose, goal_point=point, goal_clearance=0.0)
    (far,) = find(costs, pose, goal_point=point, goal_clearance=0.0, goal_distance=2.5)
    assert near.goal[:2] == pytest.approx([4.5, 1.5] if point == "centroid" else [1.5, 1.5])
    assert far.goal[:2] == pytest.approx([4.5, 1.5])  # the nearest that is 2.5 m away or more
    (all_near,) = find(costs, pose, goal_point=point, goal_clearance=0.0, goal_distance=50.0)
    assert all_near.goal[:2] == pytest.approx(
        near.goal[:2]
    )  # where there is none so far away, the distance does not count
    assert (far.way_m, far.cost) == (near.way_m, near.cost)
