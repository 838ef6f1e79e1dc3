# SPDX-License-Identifier: MIT
"""Planning on a changing costmap, held against the planner for saved maps and against naive floods."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest

from slamcli.errors import PlanningError
from slamcli.grids import OccupancyGrid
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.global_planner import GlobalPlanner, PlannedPath
from slamcli.navigation.live_endpoints import surrounding_offsets
from slamcli.navigation.live_planner import LivePath, LivePlanner
from slamcli.navigation.planner_methods import METHODS
from slamcli.navigation.planner_parameters import PlannerParameters

pytestmark = pytest.mark.kernels

CELL_METHODS = [method for method in METHODS if method != "hybrid_astar"]  # that one: test_hybrid_astar.py
RADIUS = 0.15


def window_of(cells: np.ndarray, radius: float = RADIUS) -> tuple[CostWindow, GlobalPlanner]:
    grid = OccupancyGrid(cells, 0.1, (-1.0, 2.0, 0.0))
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=radius, inflation_radius=0.4))
    window = CostWindow(
        costs=costmap.costs,
        origin_m=(-1.0, 2.0),
        resolution_m=0.1,
        frame="map",
        footprint=radius * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]),
        inscribed_radius_m=radius,
        circumscribed_radius_m=radius,
    )
    return window, GlobalPlanner(costmap)


def random_cells(seed: int, share: float = 0.02, unknown: float = 0.02) -> np.ndarray:
    draw = np.random.default_rng(seed).random((60, 70))
    return np.where(draw < share, 100, np.where(draw > 1 - unknown, -1, 0)).astype(np.int8)


def naive_reachable(costs: np.ndarray, start: tuple[int, int], unknown: bool) -> np.ndarray:
    free = (costs < 253) | ((costs == 255) & unknown)
    seen = np.zeros(costs.shape, dtype=bool)
    seen[start] = True
    queue = deque([start])
    while queue:
        r, c = queue.popleft()
        for a, b in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            if 0 <= a < costs.shape[0] and 0 <= b < costs.shape[1] and free[a, b] and not seen[a, b]:
                seen[a, b] = True
                queue.append((a, b))
    return seen


def described(path: LivePath | PlannedPath) -> list[object]:
    """Without the points: the live planner adds some where they are far apart."""
    return [path.points_m[[0, -1]].tolist(), path.yaws_rad[[0, -1]].tolist(), round(path.length_m, 9), path.cost]


@pytest.mark.parametrize("method", CELL_METHODS)
def test_equals_the_planner_for_saved_maps_while_the_map_changes(method: str) -> None:
    parameters = PlannerParameters(allow_unknown=True)
    planner = LivePlanner(parameters, method)
    random = np.random.default_rng(0)
    compared = 0
    for seed in range(6):
        window, static = window_of(random_cells(seed))
        for _ in range(6):
            start, goal = (np.append(p, 0.3) for p in random.uniform([-1.0, 2.0], [6.0, 8.0], (2, 2)))
            row, column = int((start[1] - 2.0) / 0.1), int((start[0] + 1.0) / 0.1)
            if window.costs[row, column] in (253, 254):
                continue
            cleared = window.costs.copy()
            cleared[row, column] = 0
            before = window.costs.copy()
            outcomes = []
            for one in (
                lambda w, *ends: GlobalPlanner(replace(static.costmap, costs=cleared), parameters, method).plan(*ends),  # noqa: B023
                planner.plan,
            ):
                try:
                    path = one(window, start, goal)
                    outcomes.append(described(path))
                    compared += 1
                except NoPathError as failure:
                    outcomes.append(failure.status)
            assert outcomes[0] == outcomes[1]
            np.testing.assert_array_equal(window.costs, before)
    assert compared > 16


@pytest.mark.parametrize("method", CELL_METHODS)
def test_work_arrays_carry_nothing_over(method: str) -> None:
    planner = LivePlanner(None, method)
    random = np.random.default_rng(1)
    for seed in range(4):
        window, _ = window_of(random_cells(seed, 0.015))
        for _ in range(8):
            start, goal = random.uniform([-1.0, 2.0, 0.0], [6.0, 8.0, 0.0], (2, 3))
            outcomes = []
            for one in (planner, LivePlanner(None, method)):
                try:
                    outcomes.append(one.plan(window, start, goal).poses)
                except NoPathError as error:
                    outcomes.append(error.status)
            np.testing.assert_array_equal(outcomes[0], outcomes[1])


@pytest.mark.parametrize("unknown", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_path_is_found_exactly_where_the_flood_comes(seed: int, unknown: bool) -> None:
    window, _ = window_of(random_cells(seed, 0.04, 0.1))
    planner = LivePlanner(PlannerParameters(allow_unknown=unknown))
    random = np.random.default_rng(seed)
    free = np.argwhere(window.costs < 253)
    statuses = set()
    for _ in range(25):
        start = tuple(int(v) for v in free[random.integers(len(free))])
        goal = tuple(int(v) for v in random.integers([0, 0], [60, 70]))
        poses = [np.array([-1.0 + (c + 0.5) * 0.1, 2.0 + (r + 0.5) * 0.1, 0.0]) for r, c in (start, goal)]
        reachable = naive_reachable(window.costs, start, unknown)[goal]
        try:
            planner.plan(window, *poses)
            statuses.add("ok")
            assert reachable
        except NoPathError as error:
            statuses.add(error.status)
            assert not reachable
    assert {"ok", "goal_blocked"} <= statuses


def wall_with(cells: dict[tuple[int, int], int], radius: float = RADIUS) -> CostWindow:
    grid = np.zeros((20, 40), dtype=np.int8)
    grid[:, 20] = 100
    for cell, value in cells.items():
        grid[cell] = value
    return window_of(grid, radius)[0]


@pytest.mark.parametrize(
    ("start", "goal", "status"),
    [
        ((-0.5, 3.0), (1.05, 3.0), "goal_blocked"),
        ((-0.5, 3.0), (2.0, 3.0), "unreachable"),
        ((-0.5, 3.0), (-1.5, 3.0), "goal_outside"),
        ((-0.5, 3.0), (math.nan, 3.0), "goal_outside"),
        ((9.0, 3.0), (0.0, 3.0), "start_outside"),
    ],
)
@pytest.mark.parametrize("method", CELL_METHODS)
def test_errors_say_why(method: str, start: tuple[float, float], goal: tuple[float, float], status: str) -> None:
    with pytest.raises(NoPathError) as error:
        LivePlanner(None, method).plan(wall_with({}), (*start, 0.0), (*goal, 0.0))
    assert error.value.status == status
    assert "\n" not in str(error.value)


def test_a_start_too_near_to_an_obstacle_gets_out() -> None:
    window = wall_with({}, 0.25)
    before = window.costs.copy()
    # Columns 18 to 22 are lethal or inscribed: the start in column 19 has one blocked cell between it and the free ones.
    path = LivePlanner().plan(window, (0.97, 3.0, 0.0), (-0.5, 3.0, 0.0))
    assert path.length_m == pytest.approx(1.47, rel=0.04)
    np.testing.assert_array_equal(window.costs, before)
    with pytest.raises(NoPathError) as error:
        LivePlanner().plan(window_of(np.full((9, 9), 100, dtype=np.int8))[0], (-0.6, 2.4, 0.0), (-0.5, 2.5, 0.0))
    assert error.value.status == "start_blocked"


def test_the_way_out_never_crosses_an_obstacle() -> None:
    # In the wall's own column the robot may leave to either side, one column beside it only to its own.
    window = wall_with({}, 0.25)
    with pytest.raises(NoPathError, match="cannot be reached"):
        LivePlanner().plan(window, (0.97, 3.0, 0.0), (2.0, 3.0, 0.0))


def test_default_tolerance_ends_at_the_nearest_reachable_point() -> None:
    window = wall_with({})
    planner = LivePlanner(PlannerParameters(default_tolerance=0.3))
    path = planner.plan(window, (-0.5, 3.05, 0.0), (1.05, 3.05, 0.7))
    assert path.goal_offset_m == pytest.approx(0.2)
    np.testing.assert_allclose(path.poses[-1], [0.85, 3.05, 0.7])
    with pytest.raises(NoPathError, match="cannot be reached"):
        planner.plan(window, (-0.5, 3.05, 0.0), (2.0, 3.05, 0.0))


def test_unknown_space_only_where_no_other_way_exists() -> None:
    window = wall_with({(r, 20): -1 for r in range(8, 14)})
    path = LivePlanner().plan(window, (-0.5, 3.05, 0.0), (2.0, 3.05, 0.0))
    assert path.through_unknown
    with pytest.raises(NoPathError, match="cannot be reached"):
        LivePlanner(PlannerParameters(allow_unknown=False)).plan(window, (-0.5, 3.05, 0.0), (2.0, 3.05, 0.0))
    assert not LivePlanner().plan(window, (-0.5, 3.05, 0.0), (0.0, 3.05, 0.0)).through_unknown


def test_make_plan_searches_around_an_unreachable_goal() -> None:
    window = wall_with({})
    planner = LivePlanner()
    start, goal = (-0.5, 3.05, 0.0), (1.05, 3.05, 0.4)
    with pytest.raises(NoPathError, match="in an obstacle"):
        planner.make_plan(window, start, goal, tolerance_m=0.0)
    path = planner.make_plan(window, start, goal, tolerance_m=1.0)
    np.testing.assert_allclose(path.poses[-1], goal)
    np.testing.assert_allclose(path.points_m[-2], [0.75, 3.05])
    short = planner.make_plan(window, start, goal, tolerance_m=1.0, add_unreachable_goal=False)
    assert short.goal_offset_m == pytest.approx(0.3)
    assert len(short.points_m) == len(path.points_m) - 1


def test_offsets_go_round_in_squares() -> None:
    offsets = list(surrounding_offsets(0.1, 0.65))
    assert len(offsets) == len(set(offsets)) == 24
    np.testing.assert_allclose(
        offsets[:8],
        [(-0.3, 0.0), (0.3, 0.0), (0.0, -0.3), (0.0, 0.3), (-0.3, -0.3), (0.3, -0.3), (-0.3, 0.3), (0.3, 0.3)],
    )
    assert next(surrounding_offsets(0.1, 0.2)) == pytest.approx((-0.2, 0.0))


def test_wrong_method() -> None:
    with pytest.raises(PlanningError, match="choose one of navfn"):
        LivePlanner(None, "teleport")  # type: ignore[arg-type]
