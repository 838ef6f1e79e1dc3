# SPDX-License-Identifier: MIT
from __future__ import annotations

import heapq
import math
import os
from gzip import open as open_gzip
from pathlib import Path

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.navigation import _navfn_kernels as navfn_kernels
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.global_planner import METHODS, GlobalPlanner
from slamcli.navigation.grid_search import GridSearch
from slamcli.navigation.navfn import NavFn, traversal_costs
from slamcli.navigation.path_shape import headings, line_integral
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.search_space import SearchSpace

pytestmark = pytest.mark.kernels

CELL_METHODS = [method for method in METHODS if method != "hybrid_astar"]  # that one: test_hybrid_astar.py

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
SQRT2 = math.sqrt(2.0)


def random_world(
    seed: int, share: float = 0.2, shape: tuple[int, int] = (24, 30), unknown: float = 0.0
) -> OccupancyGrid:
    random = np.random.default_rng(seed)
    draw = random.random(shape)
    cells = np.where(draw < share, 100, np.where(draw > 1 - unknown, -1, 0)).astype(np.int8)
    return OccupancyGrid(cells, 0.1, (-1.0, 2.0, 0.0))


def naive_dijkstra(costs: np.ndarray, start: tuple[int, int], goal: tuple[int, int], factor: float) -> float:
    """Cheapest way with a heap; edges weigh the mean of their cells, no corner cutting, unknown as 253."""
    weight = np.where(costs == 255, 253, costs).astype(float) * factor / 50.0 + 1.0
    blocked = (costs == 253) | (costs == 254)
    best = {start: 0.0}
    queue = [(0.0, start)]
    while queue:
        cost, (r, c) = heapq.heappop(queue)
        if (r, c) == goal:
            return cost
        if cost > best[r, c]:
            continue
        for dr, dc in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
            a, b = r + dr, c + dc
            if not (0 <= a < costs.shape[0] and 0 <= b < costs.shape[1]) or blocked[a, b]:
                continue
            if dr and dc and (blocked[r, b] or blocked[a, c]):
                continue
            onward = cost + math.hypot(dr, dc) * (weight[r, c] + weight[a, b]) / 2
            if onward < best.get((a, b), math.inf) - 1e-12:
                best[a, b] = onward
                heapq.heappush(queue, (onward, (a, b)))
    return math.inf


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("inflation", [0.0, 0.35])
def test_dijkstra_and_astar_equal_the_naive_search(seed: int, inflation: float) -> None:
    grid = random_world(seed, 0.12 if inflation else 0.3, unknown=0.05)
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.0, inflation_radius=inflation))
    space = SearchSpace.build(costmap, PlannerParameters())
    searches = [GridSearch(space, guided=guided) for guided in (False, True)]
    prepared = GridSearch(space, guided=True)
    prepared.prepare(space.regions)
    random = np.random.default_rng(seed)
    free = np.argwhere(space.regions > 0)
    for _ in range(12):
        start, goal = (tuple(int(v) for v in free[i]) for i in random.integers(len(free), size=2))
        expected = naive_dijkstra(costmap.costs, start, goal, 0.8)
        if math.isinf(expected):
            assert space.regions[start] != space.regions[goal]
            continue
        assert space.regions[start] == space.regions[goal]
        for search in [*searches, prepared]:
            path, cost = search.find(start, goal)
            assert cost == pytest.approx(expected, abs=1e-9)
            assert tuple(path[0]) == start
            assert tuple(path[-1]) == goal
            assert np.abs(np.diff(path, axis=0)).max(initial=0) <= 1


def test_a_search_finds_the_same_way_however_often_it_was_used() -> None:
    costmap = compute_costmap(random_world(3, 0.2, unknown=0.0), CostmapParameters(robot_radius=0.0))
    space = SearchSpace.build(costmap, PlannerParameters())
    random = np.random.default_rng(0)
    free = np.argwhere(space.regions == 1)
    used = GridSearch(space, guided=True)
    for _ in range(300):  # its marks are wiped twice
        start, goal = (tuple(int(v) for v in free[i]) for i in random.integers(len(free), size=2))
        path, cost = used.find(start, goal)
        fresh, expected = GridSearch(space, guided=True).find(start, goal)
        assert cost == expected
        assert np.array_equal(path, fresh)
        assert used.reached(goal)


def test_no_corner_is_cut() -> None:
    cells = np.zeros((3, 3), dtype=np.int8)
    cells[1, 0] = 100
    planner = GlobalPlanner(
        compute_costmap(OccupancyGrid(cells, 1.0), CostmapParameters(robot_radius=0.0)), None, "astar"
    )
    path = planner.plan((0.5, 0.5), (0.5, 2.5))
    assert path.length_m == pytest.approx(4.0)
    cells[0, 1] = 100
    with pytest.raises(NoPathError, match="cannot be reached"):
        GlobalPlanner(compute_costmap(OccupancyGrid(cells, 1.0), CostmapParameters(robot_radius=0.0))).plan(
            (0.5, 0.5), (2.5, 2.5)
        )


@pytest.mark.parametrize("method", CELL_METHODS)
def test_straight_line_in_the_open(method: str) -> None:
    grid = OccupancyGrid(np.zeros((40, 40), dtype=np.int8), 0.1)
    planner = GlobalPlanner(compute_costmap(grid, CostmapParameters(robot_radius=0.0)), None, method)
    path = planner.plan((0.55, 2.05), (3.55, 2.05))
    assert path.length_m == pytest.approx(3.0, rel=1e-3)
    # global_planner's wave begins at the corners of the start's cell.
    assert path.cost == pytest.approx(3.0, rel=0.02, abs=0.11 if method == "global_planner" else 0.0)
    assert path.clearance_m == math.inf
    np.testing.assert_allclose(path.points_m[[0, -1]], [[0.55, 2.05], [3.55, 2.05]])
    np.testing.assert_allclose(path.yaws_rad, 0.0, atol=0.2 if method == "global_planner" else 1e-6)


@pytest.mark.parametrize("method", CELL_METHODS)
@pytest.mark.parametrize("seed", range(6))
def test_paths_never_touch_blocked_cells(method: str, seed: int) -> None:
    grid = random_world(seed, 0.03, (60, 70), unknown=0.02)
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.12, inflation_radius=0.4))
    planner = GlobalPlanner(costmap, PlannerParameters(allow_unknown=False, simplify=seed % 2 == 1), method)
    space = SearchSpace.build(costmap, PlannerParameters(), allow_unknown=False)
    blocked, lethal = np.argwhere(costmap.costs >= 253), np.argwhere(costmap.costs == 254)
    random = np.random.default_rng(seed)
    found = 0
    for _ in range(9):
        points = random.uniform([-1.0, 2.0], [6.0, 8.0], (2, 2))
        try:
            path = planner.plan(points[0], points[1])
        except NoPathError:
            continue
        found += 1
        in_cells = (path.points_m - [-1.0, 2.0])[:, ::-1] / 0.1 - 0.5
        assert math.isfinite(line_integral(space, in_cells))
        # Independent of the traversal: fine samples of the line against every cell's square.
        share = np.linspace(0, 1, 13)[:, None, None]
        samples = (in_cells[:-1] * (1 - share) + in_cells[1:] * share).reshape(-1, 2)
        assert (np.abs(samples[:, None] - blocked[None]).max(axis=2) > 0.5 - 1e-9).all()
        assert path.unknown_m == 0.0
        gaps = np.maximum(np.abs(samples[:, None] - lethal[None]) - 0.5, 0)
        assert path.clearance_m == pytest.approx(0.1 * np.sqrt((gaps**2).sum(axis=2).min()), abs=0.01)
    assert found > 1


def test_navfn_potential_equals_a_plain_implementation() -> None:
    grid = random_world(3, 0.15, (14, 16))
    space = SearchSpace.build(
        compute_costmap(grid, CostmapParameters(robot_radius=0.0, inflation_radius=0.2)), PlannerParameters()
    )
    start = tuple(int(v) for v in np.argwhere(space.regions > 0)[0])
    planner = NavFn(space)
    # A target that cannot be reached: the wave runs until nothing changes.
    target = tuple(int(v) for v in np.argwhere(space.regions == 0)[0])
    potential = planner.compute_potential(start, target).copy()
    costs = traversal_costs(space)[space.levels]
    naive = np.full(costs.shape, 1e10)
    naive[start[0] + 1, start[1] + 1] = 0.0
    for _ in range(400):
        for r, c in np.argwhere(costs < 254):
            low = min(naive[r, c - 1], naive[r, c + 1])
            other = min(naive[r - 1, c], naive[r + 1, c])
            toll, gap = float(costs[r, c]), abs(low - other)
            low = min(low, other)
            d = gap / toll
            value = low + toll * (1.0 if d >= 1 else -0.2301 * d * d + 0.5307 * d + 0.7040)
            naive[r, c] = min(naive[r, c], value)
    reached = naive[1:-1, 1:-1] < 1e9
    assert reached.sum() > 100
    # The original stops passing a change on where it is worth less than 0.7 of a cell: it ends close above the limit.
    difference = potential[reached] - naive[1:-1, 1:-1][reached]
    assert difference.min() > -0.05
    assert difference.max() < 50.0
    assert np.median(difference) < 2.0
    assert (potential[~reached] >= navfn_kernels.UNREACHED).all()


@pytest.mark.parametrize("method", CELL_METHODS)
def test_moving_and_turning_the_map_moves_and_turns_the_path(method: str) -> None:
    cells = random_world(5, 0.05, (50, 50)).cells
    base = GlobalPlanner(compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters(robot_radius=0.1)), None, method)
    start, goal = np.array([0.33, 0.31]), np.array([4.61, 4.27])
    yaw, shift = 0.6, np.array([-12.5, 40.25])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    moved_grid = OccupancyGrid(cells, 0.1, (float(shift[0]), float(shift[1]), yaw))
    moved = GlobalPlanner(compute_costmap(moved_grid, CostmapParameters(robot_radius=0.1)), None, method)
    expected = base.plan(start, goal)
    path = moved.plan(turn @ start + shift, turn @ goal + shift)
    np.testing.assert_allclose(path.points_m, expected.points_m @ turn.T + shift, atol=1e-6)
    assert path.cost == pytest.approx(expected.cost, rel=1e-6)
    assert path.clearance_m == pytest.approx(expected.clearance_m, abs=1e-6)


def corridor() -> GlobalPlanner:
    cells = np.zeros((20, 40), dtype=np.int8)
    cells[:, 20] = 100
    cells[9:11, 35] = -1
    grid = OccupancyGrid(cells, 0.1)
    return GlobalPlanner(compute_costmap(grid, CostmapParameters(robot_radius=0.15, inflation_radius=0.3)))


@pytest.mark.parametrize(
    ("start", "goal", "status", "nearest"),
    [
        ((0.5, 1.0), (2.05, 1.0), "goal_blocked", (1.85, 0.95)),
        ((0.5, 1.0), (3.0, 1.0), "unreachable", (1.85, 0.95)),
        ((0.5, 1.0), (-0.5, 1.0), "goal_outside", (0.05, 0.95)),
        ((5.0, 1.05), (0.5, 1.0), "start_outside", (3.95, 1.05)),
        ((1.95, 1.05), (0.5, 1.0), "start_blocked", (1.85, 1.05)),
    ],
)
def test_what_is_nearest(
    start: tuple[float, ...], goal: tuple[float, ...], status: str, nearest: tuple[float, ...]
) -> None:
    with pytest.raises(NoPathError) as error:
        corridor().plan(start, goal)
    assert error.value.status == status
    assert abs(error.value.nearest_m[0] - nearest[0]) < 1e-9
    assert abs(error.value.nearest_m[1] - nearest[1]) < 0.11
    wanted = start if status.startswith("start") else goal
    assert error.value.distance_m == pytest.approx(math.dist(error.value.nearest_m, wanted))
    assert f"{error.value.nearest_m[0]:.3f}" in str(error.value)


def test_default_tolerance_ends_at_the_nearest_point_of_the_lattice() -> None:
    cells = np.zeros((20, 40), dtype=np.int8)
    cells[:, 20] = 100
    costmap = compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters(robot_radius=0.0))
    planner = GlobalPlanner(costmap, PlannerParameters(default_tolerance=0.3))
    path = planner.plan((0.5, 1.0), (2.05, 1.05))
    assert path.goal_offset_m == pytest.approx(0.1)
    np.testing.assert_allclose(path.points_m[-1], [1.95, 1.05])
    with pytest.raises(NoPathError):
        planner.plan((0.5, 1.0), (3.0, 1.0))


@pytest.mark.parametrize("method", ["navfn", "dijkstra", "astar"])
def test_a_free_goal_behind_a_wall_is_moved_as_when_the_regions_are_known(method: str) -> None:
    cells = np.zeros((20, 40), dtype=np.int8)
    cells[:, 20] = 100
    costmap = compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters(robot_radius=0.0))
    parameters = PlannerParameters(default_tolerance=0.3)
    fresh, prepared = (GlobalPlanner(costmap, parameters, method) for _ in range(2))
    prepared.prepare_for_many()
    paths = [planner.plan((0.5, 1.0), (2.15, 1.05)) for planner in (fresh, prepared, fresh)]
    np.testing.assert_allclose(paths[0].points_m[-1], [1.95, 1.05])
    for path in paths[1:]:
        np.testing.assert_array_equal(path.points_m, paths[0].points_m)
        assert path.cost == paths[0].cost


def test_unknown_space_only_where_no_other_way_exists() -> None:
    cells = np.zeros((21, 41), dtype=np.int8)
    cells[:, 20] = 100
    cells[2, 20], cells[18:20, 20] = 0, -1
    grid = OccupancyGrid(cells, 0.1)
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.0))
    start, goal = (1.0, 1.85), (3.0, 1.85)
    known = GlobalPlanner(costmap).plan(start, goal)
    assert known.unknown_m == 0.0
    direct = GlobalPlanner(costmap, PlannerParameters(allow_unknown=True)).plan(start, goal)
    assert direct.unknown_m > 0.05
    assert direct.length_m < known.length_m
    cells[2, 20] = 100
    only = GlobalPlanner(compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters(robot_radius=0.0)))
    assert only.plan(start, goal).unknown_m > 0.05


@pytest.mark.parametrize("method", CELL_METHODS)
def test_within_one_cell_and_at_one_point(method: str) -> None:
    grid = OccupancyGrid(np.zeros((3, 3), dtype=np.int8), 1.0)
    planner = GlobalPlanner(compute_costmap(grid, CostmapParameters()), PlannerParameters(outline_map=False), method)
    assert planner.plan((0.2, 0.2), (0.8, 0.6)).length_m == pytest.approx(math.hypot(0.6, 0.4))
    assert planner.plan((0.2, 0.2), (0.2, 0.2)).length_m == 0.0
    assert planner.plan((0.1, 0.1), (2.9, 2.9)).length_m == pytest.approx(2.8 * SQRT2, rel=1e-6)


def test_simplified_path_is_no_dearer() -> None:
    grid = random_world(2, 0.04, (60, 60))
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.0))
    full = GlobalPlanner(costmap, None, "astar").plan((-0.9, 2.1), (4.7, 7.7))
    short = GlobalPlanner(costmap, PlannerParameters(simplify=True), "astar").plan((-0.9, 2.1), (4.7, 7.7))
    assert len(short.points_m) < len(full.points_m) / 2
    assert short.length_m <= full.length_m + 1e-9


def test_headings() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 2.0]])
    forward = headings(points, "forward", 1, None, None)
    np.testing.assert_allclose(forward, [0, math.pi / 4, math.pi / 2, math.pi / 2])
    np.testing.assert_allclose(headings(points, "forward", 1, None, 1.0)[-1], 1.0)
    np.testing.assert_allclose(
        headings(points, "backward", 1, 0.5, None), [0.5, -3 * math.pi / 4, -math.pi / 2, -math.pi / 2]
    )
    np.testing.assert_allclose(headings(points, "leftward", 1, None, None)[1], -math.pi / 4)
    np.testing.assert_allclose(headings(points, "rightward", 1, None, None)[1], 3 * math.pi / 4)
    np.testing.assert_allclose(headings(points, "interpolate", 1, 0.0, 0.9), [0, 0.3, 0.6, 0.9])
    np.testing.assert_allclose(headings(points, "none", 1, None, 0.9), [0, 0, 0, 0.9])
    turned = headings(points, "forward_then_interpolate", 1, None, 3.0)
    assert turned[0] == 0.0
    assert turned[-1] == pytest.approx(3.0)


def scenarios(name: str) -> tuple[OccupancyGrid, list[list[str]]]:
    folder = DATA / "movingai"
    with open_gzip(folder / f"{name}.map.gz", "rt") as stream:
        rows = stream.read().split("\n")[4:]
    with open_gzip(folder / f"{name}.map.scen.gz", "rt") as stream:
        lines = [line.split() for line in stream.read().split("\n")[1:] if line.strip()]
    free = np.array([[c in ".G" for c in row] for row in rows if row])
    return OccupancyGrid(np.where(free, 0, 100).astype(np.int8), 1.0), lines


@pytest.mark.real_data
@pytest.mark.skipif(not (DATA / "movingai").is_dir(), reason=f"no MovingAI maps under {DATA}")
@pytest.mark.parametrize("name", ["arena", "8room_000", "lak303d", "random512-30-0", "Berlin_0_256", "maze512-8-0"])
def test_movingai_optima(name: str) -> None:
    grid, lines = scenarios(name)
    planner = GlobalPlanner(compute_costmap(grid, CostmapParameters(robot_radius=0.0)), None, "astar")
    for line in lines[:: max(1, len(lines) // 25)]:
        x0, y0, x1, y1 = (int(v) + 0.5 for v in line[4:8])
        optimum = float(line[8])
        path = planner.plan((x0, y0), (x1, y1))
        assert path.length_m == pytest.approx(optimum, rel=6e-6, abs=6e-6)
        assert path.cost == pytest.approx(path.length_m, rel=1e-12)
