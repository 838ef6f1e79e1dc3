# SPDX-License-Identifier: MIT
"""global_planner's options against naive implementations."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.navigation import _potential_kernels as kernels
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.potential_search import PotentialSearch, potential_tolls
from slamcli.navigation.search_space import SearchSpace, UnreachableError

pytestmark = pytest.mark.kernels


def space_of(seed: int, share: float = 0.05, **options: object) -> SearchSpace:
    cells = np.where(np.random.default_rng(seed).random((24, 26)) < share, 100, 0).astype(np.int8)
    costmap = compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters(robot_radius=0.0, inflation_radius=0.3))
    return SearchSpace.build(costmap, PlannerParameters(**options))  # type: ignore[arg-type]


def naive_tolls(costs: np.ndarray, dijkstra: bool, lethal: int = 253, factor: float = 3.0) -> np.ndarray:
    tolls = np.full(costs.shape, math.inf)
    for cell, cost in np.ndenumerate(costs):
        value = int(cost)
        if dijkstra and (value < lethal - 1 or value == 255):
            tolls[cell] = min(50 + factor * value, lethal - 1)
        elif not dijkstra and (value < lethal or value == 255):
            tolls[cell] = 50 + value
    return tolls


def naive_plain_wave(tolls: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    best = np.full(tolls.shape, math.inf)
    best[start] = 0.0
    queue = [(0.0, start)]
    while queue:
        cost, (r, c) = heapq.heappop(queue)
        for a, b in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            if 0 <= a < tolls.shape[0] and 0 <= b < tolls.shape[1] and cost + tolls[a, b] < best[a, b]:
                best[a, b] = cost + tolls[a, b]
                heapq.heappush(queue, (best[a, b], (a, b)))
    return best


def free_pairs(space: SearchSpace, seed: int, count: int) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    random = np.random.default_rng(seed)
    inner = space.costmap.costs < 252
    inner[[0, -1], :] = inner[:, [0, -1]] = False
    free = np.argwhere(inner)
    return [tuple(tuple(int(v) for v in free[i]) for i in random.integers(len(free), size=2)) for _ in range(count)]  # type: ignore[misc]


@pytest.mark.parametrize("seed", range(4))
def test_the_plain_wave_is_dijkstra_on_four_neighbours(seed: int) -> None:
    space = space_of(seed, use_quadratic=False, old_navfn_behavior=True, outline_map=False, use_grid_path=True)
    search = PotentialSearch(space)
    tolls = naive_tolls(space.costmap.costs, dijkstra=True)
    for start, goal in free_pairs(space, seed, 8):
        expected = naive_plain_wave(tolls, start)[goal]
        if math.isinf(expected):
            with pytest.raises(UnreachableError):
                search.find(start, goal)
            continue
        path, cost = search.find(start, goal)
        # The wave stops in the round in which it reaches the goal and drops changes below 0.7 of a cell.
        assert expected / 50.0 - 1e-3 <= cost <= expected / 50.0 * 1.3 + 1.0
        np.testing.assert_array_equal(path[[0, -1]], [start, goal])
        assert np.abs(np.diff(path, axis=0)).max(initial=0) <= 1


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_astar_gives_each_cell_the_first_potential(seed: int, quadratic: bool) -> None:
    space = space_of(seed, use_dijkstra=False, use_quadratic=quadratic, outline_map=False, use_grid_path=True)
    search = PotentialSearch(space)
    tolls = naive_tolls(space.costmap.costs, dijkstra=False)
    shape = tolls.shape
    for start, goal in free_pairs(space, seed, 6):
        potential = np.full((shape[0] + 2, shape[1] + 2), 1e10)
        at = (start[0] + 1, start[1] + 1)
        potential[at] = 0.0
        queue, order = [(0.0, 0, at)], itertools.count(1)
        while queue:
            _, _, (r, c) = heapq.heappop(queue)
            if (r, c) == (goal[0] + 1, goal[1] + 1):
                break
            for a, b in ((r, c + 1), (r, c - 1), (r + 1, c), (r - 1, c)):
                if not (1 <= a <= shape[0] and 1 <= b <= shape[1]) or potential[a, b] < 1e10:
                    continue
                toll = tolls[a - 1, b - 1]
                if math.isinf(toll):
                    continue
                low, other = (
                    min(potential[a, b - 1], potential[a, b + 1]),
                    min(potential[a - 1, b], potential[a + 1, b]),
                )
                gap, low = abs(low - other), min(low, other)
                if not quadratic:
                    potential[a, b] = potential[r, c] + toll
                elif gap >= toll:
                    potential[a, b] = low + toll
                else:
                    d = gap / toll
                    potential[a, b] = low + toll * (-0.2301 * d * d + 0.5307 * d + 0.7040)
                far = abs(goal[0] + 1 - a) + abs(goal[1] + 1 - b)
                heapq.heappush(queue, (potential[a, b] + 50.0 * far, next(order), (a, b)))
        reached = potential[goal[0] + 1, goal[1] + 1]
        if reached >= 1e10:
            with pytest.raises(UnreachableError):
                search.find(start, goal)
            continue
        path, cost = search.find(start, goal)
        # Ties are taken in another order, which may give a cell another first potential.
        assert cost == pytest.approx(reached / 50.0, rel=0.1)
        np.testing.assert_array_equal(path[[0, -1]], [start, goal])


def test_tolls_are_those_of_the_original() -> None:
    for dijkstra in (True, False):
        space = space_of(0, use_dijkstra=dijkstra)
        costs = np.arange(256, dtype=np.uint8).reshape(16, 16)
        expected = naive_tolls(costs, dijkstra).ravel()
        np.testing.assert_allclose(potential_tolls(space), expected)
    low = potential_tolls(space_of(0, lethal_cost=100, cost_factor=1.0))
    assert np.isfinite(low).sum() == 99 + 1  # and unknown cells
    assert low[:99].max() == 99.0


@pytest.mark.parametrize("dijkstra", [True, False])
@pytest.mark.parametrize("grid_path", [True, False])
def test_every_combination_finds_a_free_path(dijkstra: bool, grid_path: bool) -> None:
    for seed, quadratic, old in itertools.product(range(3), (True, False), (True, False)):
        space = space_of(
            seed, use_dijkstra=dijkstra, use_grid_path=grid_path, use_quadratic=quadratic, old_navfn_behavior=old
        )
        search = PotentialSearch(space)
        before = space.levels.copy()
        for start, goal in free_pairs(space, seed, 5):
            try:
                path, _ = search.find(start, goal, np.array(start) + 0.3)
            except UnreachableError:
                continue
            np.testing.assert_allclose(path[0], start)
            np.testing.assert_allclose(path[-1], goal)
            cells = np.floor(path[1:] + 0.5).astype(int)
            assert (space.costmap.costs[cells[:, 0], cells[:, 1]] < 253).all()
            # outline_map: never along the rim.
            assert cells.min() >= 1
            assert (cells.max(axis=0) <= [22, 24]).all()
        np.testing.assert_array_equal(space.levels, before)


def test_the_wave_begins_at_the_exact_start() -> None:
    space = space_of(0, 0.0)
    exact, middle = PotentialSearch(space), PotentialSearch(space_of(0, 0.0, old_navfn_behavior=True))
    at_middle = middle.find((12, 5), (12, 20))[1]
    assert exact.find((12, 5), (12, 20), np.array([12.0, 5.4]))[1] < at_middle
    assert middle.find((12, 5), (12, 20), np.array([12.0, 5.4]))[1] == at_middle


def test_cells_around_the_goal_get_a_potential() -> None:
    levels = np.zeros(81, dtype=np.uint8)
    potential = np.full(81, kernels.UNREACHED, dtype=np.float32)
    potential[40] = 100.0
    toll = np.full(256, 50.0, dtype=np.float32)
    kernels.clear_endpoint(levels, toll, 9, 40, False, potential)
    assert potential[41] == potential[31] == 150.0
    assert potential[40] == 100.0
