# SPDX-License-Identifier: MIT
"""Smoothed paths against a naive smoother, and what smoothing promises: free, no dearer, straighter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.grid_search import GridSearch
from slamcli.navigation.path_shape import dense, line_integral, smooth
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.search_space import SearchSpace

pytestmark = pytest.mark.kernels


def space_of(seed: int, share: float) -> SearchSpace:
    cells = np.where(np.random.default_rng(seed).random((40, 44)) < share, 100, 0).astype(np.int8)
    costmap = compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters(robot_radius=0.1, inflation_radius=0.4))
    return SearchSpace.build(costmap, PlannerParameters())


def naive_smooth(space: SearchSpace, path: np.ndarray) -> np.ndarray:
    points = dense(path, 1.0).copy()
    for _ in range(200):
        most = 0.0
        for i in range(1, len(points) - 1):
            move = 0.25 * (points[i - 1] + points[i + 1]) - 0.5 * points[i]
            if np.abs(move).max() < 1e-4:
                continue
            trial = points[i - 1 : i + 2].copy()
            old = line_integral(space, trial[:2]) + line_integral(space, trial[1:])
            trial[1] += move
            if line_integral(space, trial[:2]) + line_integral(space, trial[1:]) <= old:
                points[i] = trial[1]
                most = max(most, float(np.abs(move).max()))
        if most < 1e-3:
            break
    return points


def turning(path: np.ndarray) -> float:
    steps = np.diff(path, axis=0)
    yaw = np.arctan2(steps[:, 0], steps[:, 1])
    return float((np.arctan2(np.sin(np.diff(yaw)), np.cos(np.diff(yaw))) ** 2).sum())


@pytest.mark.parametrize("seed", range(4))
def test_equals_the_naive_smoother_and_never_gets_dearer(seed: int) -> None:
    space = space_of(seed, 0.02)
    search = GridSearch(space, guided=True)
    free = np.argwhere(space.regions == np.argmax(np.bincount(space.regions.ravel())[1:]) + 1)
    random = np.random.default_rng(seed)
    for _ in range(4):
        start, goal = (tuple(int(v) for v in free[i]) for i in random.integers(len(free), size=2))
        path, _ = search.find(start, goal)
        if len(path) < 5:
            continue
        before = path.copy()
        smoothed = smooth(space, path)
        np.testing.assert_array_equal(path, before)
        np.testing.assert_allclose(smoothed, naive_smooth(space, path), atol=1e-6)
        np.testing.assert_array_equal(smoothed[[0, -1]], path[[0, -1]])
        assert line_integral(space, smoothed) <= line_integral(space, path) + 1e-9
        assert turning(smoothed) < turning(dense(path, 1.0)) + 1e-9
        assert math.isfinite(line_integral(space, smoothed))


def test_a_corner_in_the_open_is_rounded_off() -> None:
    space = space_of(0, 0.0)
    corner = np.array([[5.0, 5.0], [5.0, 25.0], [25.0, 25.0]])
    smoothed = smooth(space, corner)
    assert turning(smoothed) < 0.3 * turning(dense(corner, 1.0))
    straight = np.array([[5.0, 5.0], [5.0, 5.5]])
    np.testing.assert_array_equal(smooth(space, straight), straight)
