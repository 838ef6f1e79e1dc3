# SPDX-License-Identifier: MIT
from __future__ import annotations

import dataclasses
import math
import os
from pathlib import Path

import numpy as np
import pytest
from naive_layers import LETHAL, NaiveCostmap

from slamcli.errors import ConfigError
from slamcli.formats.maps import read_map
from slamcli.grids import OccupancyGrid
from slamcli.measurements.laser import LaserScan
from slamcli.navigation import inflation_layer, obstacle_layer, scan_observation
from slamcli.navigation.cell_bounds import CellBounds
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.layered_parameters import LayeredParameters
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_parameters import ObservationSource, ObstacleParameters
from slamcli.navigation.scan_observation import observe_scan

pytestmark = pytest.mark.kernels

# Rows from y = 0 upwards.
TEN = OccupancyGrid(
    np.array(
        [
            [0, 0, 0, 0, 0, 0, 0, 100, 100, 100],
            [0, 0, 0, 0, 0, 0, 0, 100, 100, 100],
            [0, 0, 0, 100, 100, 100, 0, 0, 0, 0],
            [0, 0, 0, 0, 100, 0, 0, 0, 0, 0],
            [100, 0, 0, 0, 100, 0, 0, 100, 100, 100],
            [0, 0, 0, 0, 0, 0, 0, 100, 100, 100],
            [0, 0, 0, 0, 0, 0, 0, 100, 100, 100],
            [0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0, 0, 0, 0, 0, -1],
        ],
        dtype=np.int8,
    ),
    1.0,
)


def costmap(
    grid: OccupancyGrid | None = TEN, *, obstacle: ObstacleParameters | None = None, **values: object
) -> LayeredCostmap:
    """A costmap whose robot clears nothing and whose sensor sees far, without inflation."""
    name = "local" if grid is None else "global"
    obstacle = obstacle or ObstacleParameters(
        footprint_clearing_enabled=False, obstacle_range=100.0, raytrace_range=100.0
    )
    values = {"robot_radius": 0.1, "inflation_radius": 0.0} | values
    return LayeredCostmap(LayeredParameters.standard(name, obstacle=obstacle, **values), name=name, static=grid)


def seen(*points: tuple[float, float], origin=(0.5, 0.5, 0.5), nothing=(), z: float = 0.5) -> Observation:
    return Observation(
        source="laser_scan",
        time_s=0.0,
        origin=np.array(origin, dtype=np.float64),
        points=np.array([(x, y, z) for x, y in points], dtype=np.float64).reshape(-1, 3),
        clear_points=np.array([(x, y, z) for x, y in nothing], dtype=np.float64).reshape(-1, 3),
    )


def lethal(layered: LayeredCostmap) -> int:
    return int((layered.window().costs == LETHAL).sum())


STATIC_LETHAL = int((TEN.cells == 100).sum())


def test_the_static_layer_alone() -> None:
    layered = costmap()
    assert layered.update([0.5, 0.5, 0.0]) == CellBounds(0, 10, 0, 10)
    assert lethal(layered) == STATIC_LETHAL == 21
    assert (
        layered.window().costs[9, 9] == 0
    )  # the obstacle layer below which nothing is tracked frees it, as in costmap_2d
    tracking = costmap(track_unknown=True)
    tracking.update([0.5, 0.5, 0.0])
    assert tracking.window().costs[9, 9] == 255


def test_a_point_marks_its_cell_and_the_beam_clears_none_of_the_map() -> None:
    layered = costmap()
    layered.observe(seen((0.5, 8.5)))
    layered.update([0.5, 0.5, 0.0])
    # The beam passes (4, 0), an obstacle of the map: the greater cost stays.
    assert layered.window().costs[4, 0] == LETHAL
    assert layered.window().costs[8, 0] == LETHAL
    assert lethal(layered) == STATIC_LETHAL + 1


def test_marks_on_obstacles_of_the_map_add_nothing() -> None:
    layered = costmap()
    layered.observe(seen((7.5, 0.5), (8.5, 1.5), (4.5, 3.5)))
    layered.update([0.5, 0.5, 0.0])
    assert lethal(layered) == STATIC_LETHAL


def test_a_beam_clears_what_was_marked_before_and_the_hit_is_marked_after() -> None:
    layered = costmap()
    layered.observe(seen((2.5, 0.5), (4.5, 0.5)))
    layered.update([0.5, 0.5, 0.0])
    row = layered.window().costs[0].tolist()
    assert row[:7] == [0, 0, 254, 0, 254, 0, 0]  # all beams clear before any point marks
    layered.observe(seen((5.5, 0.5)))
    bounds = layered.update([0.5, 0.5, 0.0])
    assert layered.window().costs[0].tolist()[:7] == [0, 0, 0, 0, 0, 254, 0]
    assert bounds == CellBounds(0, 1, 2, 6)


def test_a_beam_that_met_nothing_clears_and_does_not_mark() -> None:
    layered = costmap()
    layered.observe(seen((2.5, 0.5)))
    layered.update([0.5, 0.5, 0.0])
    layered.observe(seen(nothing=[(6.5, 0.5)]))
    layered.update([0.5, 0.5, 0.0])
    assert lethal(layered) == STATIC_LETHAL


def test_heights_and_ranges() -> None:
    high = seen((0.5, 1.5), z=2.1)
    layered = costmap()
    layered.observe(high)
    layered.update([0.5, 0.5, 0.0])
    assert lethal(layered) == STATIC_LETHAL
    near = ObstacleParameters(
        footprint_clearing_enabled=False, obstacle_range=3.0, raytrace_range=2.0, obstacle_min_range=1.5
    )
    layered = costmap(obstacle=near)
    layered.observe(seen((0.5, 3.4), (1.5, 3.5), (1.5, 0.5)))  # 2.9, 3.16 and 1 m away
    layered.update([0.5, 0.5, 0.0])
    assert layered.window().costs[3, 0] == LETHAL
    assert lethal(layered) == STATIC_LETHAL + 1
    layered.observe(seen(nothing=[(0.5, 9.5)]))  # clears the cells at 0, 1 and 2 m only
    layered.update([0.5, 0.5, 0.0])
    assert layered.window().costs[3, 0] == LETHAL


def test_unknown_space_is_tracked() -> None:
    layered = costmap(OccupancyGrid(np.full((4, 6), -1, dtype=np.int8), 1.0), track_unknown=True)
    layered.observe(seen((4.5, 0.5)))
    layered.update([0.5, 0.5, 0.0])
    assert layered.window().costs.tolist() == [[0, 0, 0, 0, 254, 255]] + [[255] * 6] * 3


def test_combination_methods() -> None:
    for method, expected in ((0, [0, 0, 0, 254]), (1, [0, 254, 0, 254]), (99, [0, 254, 0, 0])):
        layered = costmap(
            OccupancyGrid(np.array([[0, 100, 0, 0]], dtype=np.int8), 1.0),
            obstacle=ObstacleParameters(combination_method=method, footprint_clearing_enabled=False),
        )
        layered.observe(seen((3.0, 0.5), z=0.5, origin=(0.6, 0.5, 0.5)))
        layered.update([0.5, 0.5, 0.0])
        assert layered.window().costs[0].tolist() == expected


def test_inflation_by_hand() -> None:
    grid = OccupancyGrid(np.zeros((9, 9), dtype=np.int8), 1.0)
    layered = costmap(
        grid,
        robot_radius=1.0,
        footprint_padding=0.0,
        inflation_radius=3.0,
        cost_scaling_factor=0.5,
        obstacle=ObstacleParameters(footprint_clearing_enabled=False, obstacle_range=9.0, raytrace_range=9.0),
    )
    layered.observe(seen((4.5, 4.5)))
    layered.update([0.5, 0.5, 0.0])
    inscribed = layered.inscribed_radius_m
    assert inscribed == pytest.approx(math.cos(math.pi / 16))

    def cost(distance: float) -> int:
        return int(252 * math.exp(-0.5 * (distance - inscribed)))

    costs = layered.window().costs
    assert costs[4, 1:8].tolist() == [cost(3), cost(2), cost(1), 254, cost(1), cost(2), cost(3)]
    assert costs[4, 0] == 0
    assert costs[5, 5] == cost(math.sqrt(2))
    assert costs[6, 6] == cost(math.sqrt(8))
    assert costs[7, 6] == 0  # sqrt(13) > 3
    # A second obstacle: each cell takes the nearer one; then the first one goes.
    layered.observe(seen((6.5, 4.5), origin=(0.5, 4.5, 0.5)))
    layered.update([0.5, 0.5, 0.0])
    assert layered.window().costs[4, 4:9].tolist() == [cost(2), cost(1), 254, cost(1), cost(2)]
    assert layered.window().costs[4, 1:4].tolist() == [0, 0, cost(3)]


@pytest.mark.parametrize("seed", range(6))
def test_random_updates_equal_the_naive_twin_and_a_full_recompute(seed: int) -> None:
    random = np.random.default_rng(seed)
    local = seed % 2 == 1
    values = {
        "robot_radius": 0.11,
        "inflation_radius": [0.0, 0.3, 0.5, 0.42, 0.25, 0.9][seed],
        "cost_scaling_factor": 5.0,
        "track_unknown": seed in (2, 3, 4),
        "inflate_unknown": seed == 4,
    }
    obstacle = ObstacleParameters(obstacle_range=1.6, raytrace_range=2.0, combination_method=[1, 1, 0, 1, 1, 0][seed])
    if local:
        parameters = LayeredParameters.standard(
            "local", obstacle=obstacle, width=2.1, height=1.7, resolution=0.1, **values
        )
        layered, grid = LayeredCostmap(parameters, name="local"), None
    else:
        cells = random.choice(np.array([0] * 12 + [100, -1], dtype=np.int8), (27, 35))
        grid = OccupancyGrid(cells, 0.1, (-1.0, -0.7, 0.0))
        parameters = LayeredParameters.standard("global", obstacle=obstacle, **values)
        layered = LayeredCostmap(parameters, name="global", static=grid)
    naive = NaiveCostmap(parameters, grid)
    pose = np.array([0.3, 0.4, 0.0])
    before = layered.window().costs.copy()
    for step in range(25):
        pose = pose + random.normal(0, [0.12, 0.12, 0.3])
        pose[:2] = np.clip(pose[:2], -0.6, 1.2)
        count = int(random.integers(0, 12))
        points = np.column_stack([pose[:2] + random.normal(0, 0.9, (count, 2)), random.uniform(0, 2.2, count)])
        nothing = np.column_stack([pose[:2] + random.normal(0, 2.0, (4, 2)), np.full(4, 0.2)])
        observation = Observation(
            source="laser_scan",
            time_s=float(step),
            origin=np.append(pose[:2], 0.2),
            points=points,
            clear_points=nothing,
        )
        layered.observe(observation)
        bounds = layered.update(pose)
        expected = naive.update([observation], layered.footprint, pose, layered.inscribed_radius_m)
        np.testing.assert_array_equal(layered.window().costs, expected)
        assert layered.window().origin_m == pytest.approx(tuple(naive.corner))
        outside = np.ones(expected.shape, dtype=bool)
        outside[bounds.rows, bounds.columns] = False
        assert (before[outside] == expected[outside]).all()
        before = expected
    assert (before == LETHAL).sum() > 3
    layered.start_over()
    layered.update(pose)
    np.testing.assert_array_equal(layered.window().costs, before)


def test_equals_the_static_costmap_of_plan() -> None:
    random = np.random.default_rng(3)
    cells = random.choice(np.array([0] * 30 + [100, 100, -1], dtype=np.int8), (120, 150))
    cells[40:60, 30:70] = 100
    grid = OccupancyGrid(cells, 0.05, (3.0, -4.0, 0.0))
    for values in ({"inflation_radius": 0.5}, {"inflation_radius": 7.0, "inflate_unknown": True}):
        parameters = LayeredParameters.standard("global", robot_radius=0.18, track_unknown=True, **values)
        layered = LayeredCostmap(parameters, name="global", static=grid)
        far = [100.0, 100.0, 0.0]
        layered.update(far)
        expected = compute_costmap(grid, parameters.costmap)
        np.testing.assert_array_equal(layered.window().costs, expected.costs)
        assert layered.window().inscribed_radius_m == expected.inscribed_radius_m


def test_the_window_rolls_by_whole_cells_and_keeps_what_overlaps() -> None:
    layered = costmap(None, width=10.0, height=10.0, resolution=1.0)
    layered.update([5.0, 5.0, 0.0])
    corner = layered.window().origin_m
    assert corner == (0.0, 0.0)  # 5 - 9.5 / 2 is less than a cell away
    layered.observe(seen((8.5, 5.5), origin=(5.0, 5.5, 0.5)))
    layered.update([5.0, 5.0, 0.0])
    assert np.argwhere(layered.window().costs == LETHAL).tolist() == [[5, 8]]
    layered.observe(seen(origin=(8.0, 6.2, 0.5)))
    bounds = layered.update([8.0, 6.2, 0.0])
    assert layered.window().origin_m == (3.0, 1.0)
    assert np.argwhere(layered.window().costs == LETHAL).tolist() == [[4, 5]]
    assert bounds == CellBounds(0, 10, 0, 10)
    layered.update([28.0, 6.2, 0.0])
    assert lethal(layered) == 0


def test_a_rolling_window_shows_the_map_through_another_frame() -> None:
    parameters = LayeredParameters.standard("global", robot_radius=0.1, inflation_radius=0.0)
    parameters = parameters.replaced(rolling_window=True, width=6.0, height=6.0, resolution=1.0, global_frame="odom")
    layered = LayeredCostmap(parameters, name="local", static=TEN)
    # odom is turned by 90 degrees: its point (x, y) is (4 - y, x) of the map.
    layered.update([2.75, 2.75, 0.0], 0.0, [4.0, 0.0, math.pi / 2])
    costs, (left, bottom) = layered.window().costs, layered.window().origin_m
    assert (left, bottom) == (0.0, 0.0)
    for row, column in np.ndindex(6, 6):
        x, y = 4.0 - (row + 0.5), column + 0.5
        inside = 0 <= x < 10
        assert costs[row, column] == (LETHAL if inside and TEN.cells[math.floor(y), math.floor(x)] == 100 else 0)


def test_the_robot_stands_on_free_cells() -> None:
    obstacle = ObstacleParameters(obstacle_range=100.0, raytrace_range=0.0)
    layered = costmap(
        OccupancyGrid(np.zeros((10, 10), dtype=np.int8), 0.1),
        obstacle=obstacle,
        footprint="[[0.15, 0.1], [0.15, -0.1], [-0.15, -0.1], [-0.15, 0.1]]",
        footprint_padding=0.0,
    )
    layered.observe(seen((0.45, 0.45), (0.75, 0.45), (0.45, 0.75)))
    layered.update([0.45, 0.45, 0.0])
    assert np.argwhere(layered.window().costs == LETHAL).tolist() == [[4, 7], [7, 4]]
    layered.observe(seen(origin=(0.5, 0.5, 0.5)))
    layered.update([0.75, 0.45, 0.0])
    assert np.argwhere(layered.window().costs == LETHAL).tolist() == [[7, 4]]


def test_recovery_forgets_outside_or_inside_a_square() -> None:
    names = ["obstacles", "obstacle_layer", "voxel_layer"]
    grid = OccupancyGrid(np.zeros((10, 10), dtype=np.int8), 1.0)
    for inside, left in ((False, [[4, 4], [5, 4]]), (True, [[0, 4], [8, 4]])):
        layered = costmap(grid)
        layered.observe(seen((4.5, 0.5), (4.5, 4.5), (4.5, 5.5), (4.5, 8.5), origin=(0.5, 2.5, 0.5)))
        layered.update([4.5, 4.5, 0.0])
        assert lethal(layered) == 4
        assert layered.clear_outside([4.5, 4.5, 0.0], 1.5, ["obstacles"]) == ()
        clear = layered.clear_inside if inside else layered.clear_outside
        assert clear([4.5, 4.5, 0.0], 2.0, names) == ("obstacle_layer",)
        layered.observe(seen())
        assert layered.update([4.5, 4.5, 0.0]) == (CellBounds(4, 6, 4, 5) if inside else CellBounds(0, 9, 4, 5))
        assert np.argwhere(layered.window().costs == LETHAL).tolist() == left


def test_a_growing_map_keeps_obstacles_where_they_are() -> None:
    layered = costmap(OccupancyGrid(np.zeros((6, 6), dtype=np.int8), 0.5, (0.0, 0.0, 0.0)))
    layered.observe(seen((2.2, 1.7), origin=(0.2, 0.2, 0.5)))
    layered.update([0.2, 0.2, 0.0])
    assert np.argwhere(layered.window().costs == LETHAL).tolist() == [[3, 4]]
    bigger = np.zeros((9, 10), dtype=np.int8)
    bigger[0, 0] = 100
    layered.set_map(OccupancyGrid(bigger, 0.5, (-1.0, -0.5, 0.0)))
    layered.observe(seen(origin=(0.2, 0.2, 0.5)))
    layered.update([0.2, 0.2, 0.0])
    assert layered.window().origin_m == (-1.0, -0.5)
    assert np.argwhere(layered.window().costs == LETHAL).tolist() == [[0, 0], [4, 6]]
    first = costmap(TEN, first_map_only=True)
    first.set_map(OccupancyGrid(bigger, 0.5))
    first.update([0.5, 0.5, 0.0])
    assert first.window().costs.shape == (10, 10)


def test_a_turned_map_is_set_upright() -> None:
    cells = np.zeros((40, 60), dtype=np.int8)
    cells[20, :] = 100
    grid = OccupancyGrid(cells, 0.1, (1.0, 2.0, math.pi / 2))
    layered = costmap(grid, track_unknown=True)
    layered.update([100.0, 0.0, 0.0])
    window = layered.window()
    assert window.origin_m == pytest.approx((-3.0, 2.0))
    assert window.costs.shape == (60, 40)
    assert (window.costs == LETHAL).sum(axis=0).tolist() == [0] * 19 + [60] + [0] * 20
    turned = costmap(dataclasses.replace(grid, origin=(1.0, 2.0, 0.6)), track_unknown=True)
    turned.update([100.0, 0.0, 0.0])
    found = np.argwhere(turned.window().costs == LETHAL)
    centres = (found[:, ::-1] + 0.5) * 0.1 + np.array(turned.window().origin_m)
    rc = dataclasses.replace(grid, origin=(1.0, 2.0, 0.6)).map_to_cell(centres)
    assert set(rc[:, 0]) == {20}
    # The wall has no gap: its cells hang together over sides or corners.
    from scipy import ndimage

    assert ndimage.label(turned.window().costs == LETHAL, np.ones((3, 3)))[1] == 1


def test_observations_persist_as_long_as_they_should() -> None:
    source = ObservationSource(
        data_type="LaserScan", clearing=True, observation_persistence=1.0, expected_update_rate=0.5
    )
    parameters = LayeredParameters.standard(
        "global", robot_radius=0.1, inflation_radius=0.0, obstacle=ObstacleParameters(footprint_clearing_enabled=False)
    )
    layers = tuple(
        dataclasses.replace(layer, sources=(source,)) if layer.kind == "obstacle" else layer
        for layer in parameters.layers
    )
    layered = LayeredCostmap(
        dataclasses.replace(parameters, layers=layers),
        name="global",
        static=OccupancyGrid(np.zeros((4, 4), dtype=np.int8), 1.0),
    )
    assert layered.out_of_date(0.5) == ()
    assert layered.out_of_date(0.6) == ("laser_scan",)
    for time_s, column in ((0.0, 1.5), (0.6, 2.5), (1.5, 0.5)):
        layered.observe(dataclasses.replace(seen((column, 1.5), origin=(0.5, 0.5, 0.5)), time_s=time_s))
        layered.update([0.5, 0.5, 0.0], time_s)
        if time_s == 0.6:
            assert np.argwhere(layered.window().costs == LETHAL).tolist() == [[1, 1], [1, 2]]
    assert [o.time_s for o in layered._obstacles[0].buffers[0].observations] == [1.5, 0.6]
    assert layered.out_of_date(2.0) == ()
    assert layered.out_of_date(2.1) == ("laser_scan",)


def scan(ranges: list[float], **values: float) -> LaserScan:
    facts = {"range_min_m": 0.1, "range_max_m": 5.0} | values
    return LaserScan(
        stamp_ns=0,
        frame_id="laser",
        angle_min_rad=0.0,
        angle_increment_rad=math.pi / 2,
        ranges_m=np.array(ranges, dtype=np.float32),
        **facts,
    )


def test_a_scan_as_observation() -> None:
    source = ObservationSource(data_type="LaserScan")
    ranges = [2.0, math.inf, math.nan, 5.0]
    seen_by = observe_scan(scan(ranges), np.array([1.0, 2.0, math.pi / 2]), source, 7.0, 0.3)
    assert (seen_by.source, seen_by.time_s, seen_by.origin.tolist()) == ("laser_scan", 7.0, [1.0, 2.0, 0.3])
    np.testing.assert_allclose(seen_by.points, [[1.0, 4.0, 0.3]], atol=1e-12)
    np.testing.assert_allclose(seen_by.clear_points, [[1.0 - 4.9999, 2.0, 0.3], [1.0 + 4.9999, 2.0, 0.3]], atol=1e-9)
    as_original = observe_scan(scan(ranges), np.zeros(3), dataclasses.replace(source, inf_is_valid=False), 7.0, 0.3)
    assert (len(as_original.points), len(as_original.clear_points)) == (1, 0)
    near = observe_scan(scan([0.05, -math.inf, 0.1, 4.9999], range_max_m=math.nan), np.zeros(3), source, 0.0)
    assert (len(near.points), len(near.clear_points)) == (2, 0)
    above = observe_scan(scan(ranges), np.zeros(3), source, 0.0, 2.5)
    assert (len(above.points), len(above.clear_points)) == (0, 0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"robot_radius": 2.5}, "wider than the window"),
        ({"width": 0.02}, "no cell"),
        ({"width": 1e5, "height": 1e5}, "too many cells"),
    ],
)
def test_windows_that_cannot_be(values: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        LayeredCostmap(LayeredParameters.standard("local", **values), name="local")


def test_a_static_layer_needs_a_map_and_a_source_its_name() -> None:
    with pytest.raises(ConfigError, match="needs a map"):
        LayeredCostmap(LayeredParameters.standard("global"), name="global")
    with pytest.raises(ConfigError, match=r"no source 'sonar' \(there is: laser_scan\)"):
        costmap().observe(dataclasses.replace(seen(), source="sonar"))


def test_an_inflation_that_reaches_far_changes_with_obstacles() -> None:
    grid = OccupancyGrid(np.zeros((150, 150), dtype=np.int8), 0.05)
    layered = costmap(grid, inflation_radius=9.0, cost_scaling_factor=0.3)
    for column in (1.0, 3.0):
        layered.observe(seen((column, 0.5), origin=(0.5, 0.5, 0.5)))
        layered.update([0.5, 0.5, 0.0])
        cells = np.zeros((150, 150), dtype=np.int8)
        cells[10, round(column / 0.05)] = 100
        expected = compute_costmap(OccupancyGrid(cells, 0.05), layered.parameters.costmap)
        np.testing.assert_array_equal(layered.window().costs, expected.costs)


def test_a_map_that_changes_in_place_equals_one_that_is_new() -> None:
    random = np.random.default_rng(9)
    cells = random.choice(np.array([0] * 9 + [100, -1], dtype=np.int8), (60, 70))
    layered = costmap(OccupancyGrid(cells, 0.05), inflation_radius=0.4, track_unknown=True)
    layered.update([0.5, 0.5, 0.0])
    changed = cells.copy()
    changed[20:33, 40:52] = random.choice(np.array([0, 100, -1], dtype=np.int8), (13, 12))
    layered.set_map(OccupancyGrid(changed, 0.05))
    bounds = layered.update([0.5, 0.5, 0.0])
    assert min(bounds.first_row - 12, 41 - bounds.last_row) >= 0
    assert min(bounds.first_column - 32, 60 - bounds.last_column) >= 0
    fresh = costmap(OccupancyGrid(changed, 0.05), inflation_radius=0.4, track_unknown=True)
    fresh.update([0.5, 0.5, 0.0])
    np.testing.assert_array_equal(layered.window().costs, fresh.window().costs)


DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
MAPS = [
    DATA / "maps" / f"{name}.yaml"
    for name in ("stdr/simple_rooms", "meeting/meeting", "nav2/depot", "turtlebot3/map", "mrpt/demo_world2")
]


@pytest.mark.real_data
@pytest.mark.skipif(not (DATA / "maps").is_dir(), reason=f"no maps under {DATA}")
@pytest.mark.parametrize("path", MAPS, ids=lambda path: path.stem)
def test_scans_on_real_maps_equal_a_full_recompute(path: Path) -> None:
    grid = read_map(path).grid
    parameters = LayeredParameters.standard("global", robot_radius=0.18, track_unknown=True)
    layered = LayeredCostmap(parameters, name="global", static=grid)
    low = layered.extent.corner
    high = low + np.array(layered.extent.shape[::-1]) * grid.resolution_m
    layered.update([*(low - 9.0), 0.0])
    if abs(grid.origin[2]) < 1e-9:
        np.testing.assert_array_equal(layered.window().costs, compute_costmap(grid, parameters.costmap).costs)
    random = np.random.default_rng(5)
    pose = np.append((low + high) / 2, 0.0)
    facts = {"angle_min_rad": -math.pi, "angle_increment_rad": math.pi / 90, "range_min_m": 0.1, "range_max_m": 8.0}
    for step in range(12):
        pose = pose + random.normal(0.0, [0.2, 0.2, 0.5])
        ranges = random.uniform(0.0, 9.0, 180).astype(np.float32)
        sweep = LaserScan(stamp_ns=step, frame_id="laser", ranges_m=ranges, **facts)
        layered.observe(observe_scan(sweep, pose, parameters.sources[0], 0.1 * step, 0.2))
        layered.update(pose)
    incremental = layered.window().costs.copy()
    layered.start_over()
    layered.update(pose)
    np.testing.assert_array_equal(layered.window().costs, incremental)


def test_the_same_input_gives_the_same_bytes() -> None:
    def run() -> bytes:
        random = np.random.default_rng(4)
        layered = costmap(None, width=4.0, height=4.0, resolution=0.05, inflation_radius=0.5)
        for step in range(20):
            layered.observe(seen(*random.uniform(-2, 3, (40, 2)).tolist(), origin=(0.1 * step, 0.0, 0.2)))
            layered.update([0.1 * step, 0.0, 0.3])
        return layered.window().costs.tobytes()

    assert run() == run()


def test_kernels_compile_once() -> None:
    from slamcli.navigation import _master_kernels, _obstacle_kernels

    kernels = [getattr(module, name) for module in (_master_kernels, _obstacle_kernels) for name in dir(module)]
    kernels = [kernel for kernel in kernels if hasattr(kernel, "signatures")]
    if not kernels:
        pytest.skip("kernels run as plain Python")
    inflation_layer.warm()
    obstacle_layer.warm()
    scan_observation.warm()
    before = [len(kernel.signatures) for kernel in kernels]
    for grid in (TEN, None):
        layered = costmap(grid, inflation_radius=1.0)
        layered.observe(
            observe_scan(scan([1.0, math.inf, 2.0, math.nan]), np.array([4.5, 4.5, 0.1]), ObservationSource(), 0.0)
        )
        for x in (4.5, 7.0):
            layered.update([x, 4.5, 0.0])
        layered.clear_outside([4.5, 4.5, 0.0], 1.0, ["obstacle_layer"])
        layered.update([7.0, 4.5, 0.0])
    assert [len(kernel.signatures) for kernel in kernels] == before


def test_counts_around_one_obstacle() -> None:
    # The 29 cells within three cells of one; four of them touch it. costmap_2d's own tests count the same.
    square = "[[1, 1], [1, -1], [-1, -1], [-1, 1]]"
    grid = OccupancyGrid(np.zeros((10, 10), dtype=np.int8), 1.0)
    layered = costmap(grid, footprint=square, footprint_padding=0.0, inflation_radius=3.0, cost_scaling_factor=0.1)
    layered.observe(seen((5.0, 5.0)))
    layered.update([0.5, 0.5, 0.0])
    costs = layered.window().costs
    assert [int((costs == value).sum()) for value in (254, 253)] == [1, 4]
    assert int((costs > 0).sum()) == 29


def test_a_diagonal_beam_frees_the_diagonal() -> None:
    layered = costmap(OccupancyGrid(np.full((10, 10), -1, dtype=np.int8), 1.0), track_unknown=True)
    layered.observe(seen((9.5, 9.5)))
    layered.update([0.5, 0.5, 0.0])
    assert np.diag(layered.window().costs).tolist() == [0] * 9 + [254]
    assert int((layered.window().costs == 255).sum()) == 90
