# SPDX-License-Identifier: MIT
from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.grids import OccupancyGrid
from slamcli.navigation.costmap import compute_costmap, static_costs
from slamcli.navigation.costmap_files import read_settings
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.footprint import padded_polygon, parse_footprint, radii

pytestmark = pytest.mark.kernels


def naive_costs(cells: np.ndarray, resolution: float, inscribed: float, inflation: float, factor: float) -> np.ndarray:
    """Costmap of a trinary map, cell by cell, as costmap_2d's formulas have it."""
    costs = np.zeros(cells.shape, dtype=np.uint8)
    obstacles = np.argwhere(cells == 100)
    reach = math.ceil(inflation / resolution)
    for r, c in np.ndindex(*cells.shape):
        distance = min((math.hypot(r - a, c - b) for a, b in obstacles), default=math.inf)
        if distance == 0:
            cost = 254
        elif distance > reach:
            cost = 0
        elif distance * resolution <= inscribed:
            cost = 253
        else:
            cost = int(252 * math.exp(-factor * (distance * resolution - inscribed)))
        if cells[r, c] == -1:
            cost = cost if cost >= 253 else 255
        costs[r, c] = cost
    return costs


@pytest.mark.parametrize("seed", range(4))
def test_equals_the_formulas(seed: int) -> None:
    random = np.random.default_rng(seed)
    cells = random.choice(np.array([0, 0, 0, 0, 0, 0, 100, -1], dtype=np.int8), (25, 31))
    parameters = CostmapParameters(robot_radius=0.11, inflation_radius=0.4, cost_scaling_factor=4.0)
    costmap = compute_costmap(OccupancyGrid(cells, 0.05), parameters)
    inscribed = radii(padded_polygon((), 0.11, 0.01))[0]
    np.testing.assert_array_equal(costmap.costs, naive_costs(cells, 0.05, inscribed, 0.4, 4.0))


def test_round_robot_has_sixteen_padded_corners() -> None:
    polygon = padded_polygon((), 0.46, 0.01)
    assert polygon.shape == (16, 2)
    assert polygon[2] == pytest.approx([0.46 * math.sqrt(0.5) + 0.01] * 2)
    inscribed, circumscribed = radii(polygon)
    assert 0.46 * math.cos(math.pi / 16) < inscribed < 0.47
    assert circumscribed == pytest.approx(np.linalg.norm(polygon, axis=1).max())


def test_polygon_radii() -> None:
    corners = parse_footprint("[[0.3, 0.2], [0.3, -0.2], [-0.1, -0.2], [-0.1, 0.2]]")
    assert radii(padded_polygon(corners, 9.0, 0.0)) == pytest.approx((0.1, math.hypot(0.3, 0.2)))
    assert radii(padded_polygon(corners, 9.0, 0.05))[0] == pytest.approx(0.15)


def test_a_point_has_no_radius_and_no_inflation() -> None:
    costmap = compute_costmap(
        OccupancyGrid(np.array([[0, 100]], dtype=np.int8), 0.05), CostmapParameters(robot_radius=0.0)
    )
    assert costmap.costs.tolist() == [[0, 254]]
    assert (costmap.inscribed_radius_m, costmap.inflation_radius_m) == (0.0, 0.0)


def test_defaults_with_and_without_a_costmap_file() -> None:
    grid = OccupancyGrid(np.array([[0, 100]], dtype=np.int8), 0.05)
    plain = compute_costmap(grid, CostmapParameters())
    assert (plain.inscribed_radius_m, plain.inflation_radius_m) == (0.0, 0.55)
    ros = compute_costmap(grid, CostmapParameters(), from_file=True)
    assert ros.inscribed_radius_m == pytest.approx(0.46, abs=0.01)


def test_static_layer_thresholds() -> None:
    grid = OccupancyGrid(np.array([[-1, 0, 1, 50, 64, 65, 99, 100, 127]], dtype=np.int8), 0.05)
    trinary = static_costs(grid, CostmapParameters()).tolist()
    assert trinary == [[255, 0, 0, 0, 0, 0, 0, 254, 254]]
    lower = static_costs(grid, CostmapParameters(lethal_cost_threshold=65)).tolist()
    assert lower == [[255, 0, 0, 0, 0, 254, 254, 254, 254]]
    scaled = static_costs(grid, CostmapParameters(trinary_costmap=False)).tolist()
    assert scaled == [[255, 0, 2, 127, 162, 165, 251, 254, 254]]
    untracked = static_costs(grid, CostmapParameters(track_unknown_space=False)).tolist()
    assert untracked[0][0] == 0
    other = static_costs(grid, CostmapParameters(unknown_cost_value=50)).tolist()
    assert other == [[254, 0, 0, 255, 0, 0, 0, 254, 254]]


def test_inflate_unknown() -> None:
    grid = OccupancyGrid(np.array([[100, -1, -1, -1, -1, -1, -1, -1]], dtype=np.int8), 0.1)
    parameters = CostmapParameters(robot_radius=0.1, footprint_padding=0.0, inflation_radius=0.4, inflate_unknown=True)
    costs = compute_costmap(grid, parameters).costs[0]
    assert costs[0] == 254
    assert 0 < costs[3] < costs[2] < 253
    assert costs[5] == 255


def test_too_small_an_inflation_is_said() -> None:
    grid = OccupancyGrid(np.array([[0, 100]], dtype=np.int8), 0.05)
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.3, inflation_radius=0.1))
    assert "below the robot's inscribed radius" in costmap.warnings[0]


def entries(**values: object) -> list[tuple[str, object, str]]:
    return [(name, value, "f.yaml:1") for name, value in values.items()]


def test_mission_files_in_costmap_2d_spelling() -> None:
    settings = read_settings(
        [
            ("robot_radius", 0.18, "c.yaml:2"),
            ("inflation_layer/inflation_radius", 0.5, "c.yaml:4"),
            ("obstacle_layer/observation_sources", "laser_scan", "c.yaml:8"),
            ("obstacle_layer/laser_scan/sensor_frame", "laser_link", "c.yaml:10"),
            ("obstacle_layer/laser_scan/clearing", True, "c.yaml:11"),
            ("global_costmap/static_map", True, "g.yaml:1"),
            ("global_costmap/update_frequency", 1.0, "g.yaml:2"),
            ("NavfnROS/default_tolerance", 0.2, "n.yaml:2"),
        ]
    )
    costmap, planner = settings.build()
    assert (costmap.robot_radius, costmap.inflation_radius, planner.default_tolerance) == (0.18, 0.5, 0.2)
    assert any("obstacle_layer" in note for note in settings.notes)
    assert any("update_frequency" in note for note in settings.notes)


def test_layers_under_other_names_nav2_nesting_and_later_wins() -> None:
    settings = read_settings(
        [
            ("global_costmap/global_costmap/ros__parameters/plugins", [{"name": "inflater", "type": "costmap_2d::InflationLayer"}], "x"),
            ("global_costmap/global_costmap/ros__parameters/inflater/inflation_radius", 0.7, "x"),
            ("global_costmap/global_costmap/ros__parameters/robot_radius", 0.2, "x"),
            ("local_costmap/width", 4.0, "x"),
            ("inflation_radius", "0.9", "--set"),
        ]
    )  # fmt: skip
    costmap, _ = settings.build()
    assert (costmap.robot_radius, costmap.inflation_radius) == (0.2, 0.9)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("robot_radus", 0.2, "did you mean robot_radius"),
        ("inflation_layer/cost_scaling", 1, "cost_scaling_factor"),
        ("obstacle_layer/observation_source", "a", "observation_sources"),
        ("NavfnROS/allow_unkown", True, "allow_unknown"),
        ("robot_radius", "wide", "not a number"),
        ("robot_radius", -1, "between 0 and 1000"),
        ("robot_radius", float("nan"), "not a number"),
    ],
)
def test_wrong_settings_name_file_and_nearest(name: str, value: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        read_settings([(name, value, "c.yaml:7")])
    assert "c.yaml:7" in str(error.value)


@pytest.mark.parametrize(
    "text", ["[[1,2]]", "[[1,2],[3,4]]", "nonsense", "[[1,2],[3,4],[5]]", "[" * 3000, "[[1,2],[3,4],[1e999,0]]"]
)
def test_wrong_footprints(text: str) -> None:
    with pytest.raises(ConfigError, match="footprint"):
        CostmapParameters(footprint=text)
