# SPDX-License-Identifier: MIT
"""Theta* against brute force: no dearer than the cheapest way on the grid, no shorter than the shortest there is."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.grid_search import GridSearch
from slamcli.navigation.path_shape import line_integral
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.search_space import SearchSpace, UnreachableError
from slamcli.navigation.shortest_path import ShortestField
from slamcli.navigation.theta_star import ThetaStar

pytestmark = pytest.mark.kernels


def space_of(seed: int, share: float, factor: float) -> SearchSpace:
    cells = np.where(np.random.default_rng(seed).random((40, 44)) < share, 100, 0).astype(np.int8)
    costmap = compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters(robot_radius=0.1, inflation_radius=0.4))
    return SearchSpace.build(costmap, PlannerParameters(cost_factor=factor))


def brute_line_cost(space: SearchSpace, a: np.ndarray, b: np.ndarray) -> float:
    """Mean weight at many points of the line times its length."""
    points = a + (np.arange(20000)[:, None] + 0.5) / 20000 * (b - a)
    cells = np.floor(points + 0.5).astype(int) + 1
    return float(space.weight[space.levels[cells[:, 0], cells[:, 1]]].mean() * np.linalg.norm(b - a))


@pytest.mark.parametrize("factor", [0.0, 0.8])
@pytest.mark.parametrize("seed", range(4))
def test_between_the_grid_and_the_optimum(seed: int, factor: float) -> None:
    space = space_of(seed, 0.04, factor)
    theta, dijkstra = ThetaStar(space), GridSearch(space, guided=False)
    random = np.random.default_rng(seed)
    free = np.argwhere(space.regions > 0)
    found = []
    for _ in range(10):
        start, goal = (tuple(int(v) for v in free[i]) for i in random.integers(len(free), size=2))
        if space.regions[start] != space.regions[goal]:
            with pytest.raises(UnreachableError):
                theta.find(start, goal)
            assert not theta.reached(goal)
            continue
        path, cost = theta.find(start, goal)
        assert theta.reached(goal)
        assert tuple(path[0]) == start
        assert tuple(path[-1]) == goal
        assert line_integral(space, path) == pytest.approx(cost, abs=1e-9)
        assert sum(brute_line_cost(space, a, b) for a, b in itertools.pairwise(path)) == pytest.approx(
            cost, rel=2e-3, abs=1e-6
        )
        assert cost <= dijkstra.find(start, goal)[1] * 1.005 + 1e-9
        length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        if length:
            found.append(length)
            points = [((c + 0.5), (r + 0.5)) for r, c in (start, goal)]
            assert length >= ShortestField(WindowOf(space), points[0]).length(points[1]) - 1e-9
    assert len(found) > 4


class WindowOf:
    resolution_m = 1.0
    origin_m = (0.0, 0.0)

    def __init__(self, space: SearchSpace) -> None:
        self.costs = space.costmap.costs


def test_straight_where_nothing_is_in_the_way() -> None:
    space = space_of(0, 0.0, 0.8)
    path, cost = ThetaStar(space).find((3, 4), (30, 39))
    np.testing.assert_array_equal(path, [[3, 4], [30, 39]])
    assert cost == pytest.approx(math.hypot(27, 35))
    path, cost = ThetaStar(space).find((3, 4), (3, 4))
    assert (len(path), cost) == (1, 0.0)
