# SPDX-License-Identifier: MIT
"""Hybrid A* against brute checks of what it promises: exact ends, the turning radius, an outline clear of obstacles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.navigation import _hybrid_kernels as kernels
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.curves import shortest_curve
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.global_planner import GlobalPlanner
from slamcli.navigation.hybrid_astar import DrivablePath, HybridAStar, outline_points
from slamcli.navigation.hybrid_parameters import HybridParameters
from slamcli.navigation.live_planner import LivePlanner
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.search_space import SearchSpace, UnreachableError

RESOLUTION = 0.1
RADIUS = 0.5
OUTLINE = np.array([[0.3, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.3, -0.2]])
MODELS = ("DUBIN", "REEDS_SHEPP")


def space_of(cells: np.ndarray) -> SearchSpace:
    parameters = CostmapParameters(
        footprint=str(OUTLINE.tolist()),
        footprint_padding=0.0,
        inflation_radius=0.4,
    )
    return SearchSpace.build(compute_costmap(OccupancyGrid(cells, RESOLUTION), parameters), PlannerParameters())


def planner(space: SearchSpace, model: str, **changes: float) -> HybridAStar:
    return HybridAStar(
        space,
        HybridParameters(
            motion_model_for_search=model, minimum_turning_radius=RADIUS, **{"max_iterations": 50_000, **changes}
        ),
    )


def find(space: SearchSpace, model: str, start: np.ndarray, goal: np.ndarray) -> DrivablePath:
    return planner(space, model).find(start, goal, OUTLINE / RESOLUTION, RESOLUTION)


def brute_touches(space: SearchSpace, pose: np.ndarray) -> bool:
    """Whether the centre of a lethal cell lies in the robot's outline."""
    lethal = np.argwhere(space.costmap.costs == 254)[:, ::-1].astype(float)
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    in_base = (lethal - pose[:2]) @ np.array([[cosine, -sine], [sine, cosine]]) * RESOLUTION
    return bool(((in_base > [-0.2, -0.2]) & (in_base < [0.3, 0.2])).all(axis=1).any())


def assert_drivable(path: DrivablePath, space: SearchSpace, start: np.ndarray, goal: np.ndarray, model: str) -> None:
    np.testing.assert_allclose(path.poses[0], start, atol=1e-9)
    np.testing.assert_allclose(path.poses[-1, :2], goal[:2], atol=1e-6)
    assert abs(math.remainder(path.poses[-1, 2] - goal[2], 2 * math.pi)) < 1e-6
    steps = np.diff(path.poses, axis=0)
    chord = np.linalg.norm(steps[:, :2], axis=1)
    turn = np.abs(np.arctan2(np.sin(steps[:, 2]), np.cos(steps[:, 2])))
    assert chord.max() <= 1.0 + 1e-9
    # Chord of an arc: 2 R sin(turn / 2).
    assert (2.0 * RADIUS / RESOLUTION * np.sin(turn / 2) <= chord + 1e-6).all()
    middle = path.poses[:-1, 2] + 0.5 * np.arctan2(np.sin(steps[:, 2]), np.cos(steps[:, 2]))
    along = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)
    moving = chord > 1e-6
    np.testing.assert_array_equal(np.sign(along[moving]), path.directions[1:][moving])
    assert model == "REEDS_SHEPP" or (path.directions == 1).all()
    assert not any(brute_touches(space, pose) for pose in path.poses)


@pytest.mark.parametrize("model", MODELS)
def test_paths_in_random_worlds_are_drivable(model: str) -> None:
    found = 0
    for seed in range(4):
        random = np.random.default_rng(seed)
        cells = np.where(random.random((50, 60)) < 0.006, 100, 0).astype(np.int8)
        space = space_of(cells)
        free = np.argwhere(space.costmap.costs == 0)
        for _ in range(4):
            start, goal = (
                np.array([*free[i][::-1], random.uniform(-3, 3)], dtype=float)
                for i in random.integers(len(free), size=2)
            )
            if brute_touches(space, start) or brute_touches(space, goal):
                continue
            try:
                path = find(space, model, start, goal)
            except UnreachableError:
                continue
            found += 1
            assert_drivable(path, space, start, goal, model)
    assert found >= 6


@pytest.mark.parametrize("model", MODELS)
def test_on_an_open_floor_it_is_the_shortest_curve(model: str) -> None:
    space = space_of(np.zeros((100, 100), dtype=np.int8))
    start, goal = np.array([30.0, 40.0, 0.4]), np.array([70.0, 55.0, 2.0])
    path = find(space, model, start, goal)
    curve = shortest_curve(start, goal, RADIUS / RESOLUTION, "dubins" if model == "DUBIN" else "reeds_shepp")
    length = np.linalg.norm(np.diff(path.poses[:, :2], axis=0), axis=1).sum()
    assert length == pytest.approx(curve.length_m, rel=0.1)
    assert path.cost <= 1.2 * curve.length_m + 4 * 2.0


def dead_end() -> SearchSpace:
    cells = np.full((30, 60), 100, dtype=np.int8)
    cells[12:18, 4:40] = 0
    cells[4:26, 40:56] = 0
    return space_of(cells)


@pytest.mark.kernels
def test_a_dead_end_is_left_in_reverse() -> None:
    space = dead_end()
    start, goal = np.array([10.0, 14.5, math.pi]), np.array([48.0, 14.5, math.pi])
    path = find(space, "REEDS_SHEPP", start, goal)
    assert_drivable(path, space, start, goal, "REEDS_SHEPP")
    assert (path.directions < 0).all()
    with pytest.raises(UnreachableError):
        find(space, "DUBIN", start, goal)


def test_no_way_and_no_room() -> None:
    cells = np.zeros((30, 60), dtype=np.int8)
    cells[:, 30] = 100
    space = space_of(cells)
    with pytest.raises(UnreachableError, match="no way on the grid"):
        find(space, "REEDS_SHEPP", np.array([10.0, 15.0, 0.0]), np.array([50.0, 15.0, 0.0]))
    with pytest.raises(UnreachableError, match="outline touches an obstacle at the goal"):
        find(space, "REEDS_SHEPP", np.array([10.0, 15.0, 0.0]), np.array([27.0, 15.0, 0.0]))
    cells = dead_end().costmap.grid.cells.copy()
    cells[2:28, 42:58] = 0
    hall = planner(space_of(np.pad(cells, ((0, 60), (0, 0)))), "DUBIN", max_iterations=1000)
    ends = np.array([48.0, 14.5, math.pi]), np.array([10.0, 14.5, 0.0])
    with pytest.raises(UnreachableError, match="gave up"):
        hall.find(*ends, OUTLINE / RESOLUTION, RESOLUTION)


def test_the_planner_of_saved_maps_turns_with_the_map() -> None:
    """Also: a goal without yaw is reached along the way."""
    cells = np.zeros((60, 60), dtype=np.int8)
    cells[30, 10:50] = 100
    parameters = PlannerParameters(hybrid=HybridParameters(minimum_turning_radius=RADIUS))
    costmap_parameters = CostmapParameters(footprint=str(OUTLINE.tolist()), inflation_radius=0.4)
    yaw, shift = 0.6, np.array([-12.5, 40.25])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    start, goal = np.array([1.03, 1.02]), np.array([3.07, 5.04])
    paths = []
    for origin, (a, b), turned in (
        ((0.0, 0.0, 0.0), (start, goal), 0.0),
        ((-12.5, 40.25, yaw), (turn @ start + shift, turn @ goal + shift), yaw),
    ):
        grid = OccupancyGrid(cells, RESOLUTION, origin)
        plan = GlobalPlanner(compute_costmap(grid, costmap_parameters), parameters, "hybrid_astar")
        paths.append(plan.plan((*a, 1.0 + turned), (*b, -2.0 + turned)))
        assert plan.plan(a, b).length_m < paths[-1].length_m
    np.testing.assert_allclose(paths[1].points_m, paths[0].points_m @ turn.T + shift, atol=1e-6)
    np.testing.assert_allclose(np.cos(paths[1].yaws_rad - paths[0].yaws_rad - yaw), 1.0, atol=1e-9)
    np.testing.assert_allclose(paths[0].yaws_rad[[0, -1]], [1.0, -2.0], atol=1e-9)
    with pytest.raises(NoPathError, match="outline touches an obstacle at the start"):
        GlobalPlanner(
            compute_costmap(OccupancyGrid(cells, RESOLUTION), costmap_parameters), parameters, "hybrid_astar"
        ).plan((2.0, 2.75, 0.9), (1.0, 1.0, 0.0))


def test_the_live_planner_replans() -> None:
    parameters = PlannerParameters(hybrid=HybridParameters(minimum_turning_radius=RADIUS))
    live = LivePlanner(parameters, "hybrid_astar")
    cells = np.zeros((60, 60), dtype=np.int8)
    lengths = []
    for column in (10, 40):
        cells[30, 5:column] = 100
        costmap = space_of(cells).costmap
        window = CostWindow(
            costs=costmap.costs,
            origin_m=(-1.0, 2.0),
            resolution_m=RESOLUTION,
            frame="map",
            footprint=OUTLINE,
            inscribed_radius_m=0.2,
            circumscribed_radius_m=0.4,
        )
        path = live.plan(window, (1.5, 3.0, 1.5), (1.5, 6.5, 1.5))
        np.testing.assert_allclose(path.poses[[0, -1]], [[1.5, 3.0, 1.5], [1.5, 6.5, 1.5]], atol=1e-6)
        assert path.directions is not None
        assert len(path.directions) == len(path.poses)
        lengths.append(path.length_m)
    assert lengths[0] == pytest.approx(3.5, rel=0.05)
    assert lengths[1] > 4.5


@pytest.mark.kernels
def test_pose_cost_equals_the_brute_check() -> None:
    random = np.random.default_rng(5)
    cells = np.where(random.random((30, 30)) < 0.03, 100, 0).astype(np.int8)
    space = space_of(cells)
    hit = np.zeros(256, dtype=bool)
    hit[254] = True
    outline = outline_points(OUTLINE / RESOLUTION)
    agree = 0
    for _ in range(400):
        pose = random.uniform([3, 3, -4], [26, 26, 4])
        cost = kernels.pose_cost(
            space.levels.reshape(-1), space.stride, space.blocked, hit, space.weight, outline,
            pose[0] + 1, pose[1] + 1, pose[2],
        )  # fmt: skip
        if brute_touches(space, pose):
            assert math.isinf(cost)
            agree += 1
        if math.isfinite(cost):
            cell = space.costmap.costs[math.floor(pose[1] + 0.5), math.floor(pose[0] + 0.5)]
            assert cost == space.weight[cell]
            agree += 1
    # The others touch only a part of a lethal cell.
    assert agree > 200
