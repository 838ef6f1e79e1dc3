# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.errors import ConfigError
from slamcli.native import read_ros_yaml
from slamcli.native.launch import read_launch
from slamcli.navigation.layered_files import read_costmaps
from slamcli.navigation.layered_parameters import LayeredParameters

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def of_files(*files: tuple[str, str]) -> list[tuple[str, object, str]]:
    return [(s.name, s.value, s.source) for name, space in files for s in read_ros_yaml(CONFIGS / name, space)]


def layers(costmap: LayeredParameters) -> list[tuple[str, str]]:
    return [(layer.name, layer.kind) for layer in costmap.layers]


def check_mission(found) -> None:
    world, near = found.global_costmap, found.local_costmap
    assert layers(world) == [
        ("static_layer", "static"),
        ("obstacle_layer", "obstacle"),
        ("inflation_layer", "inflation"),
    ]
    assert layers(near) == [("obstacle_layer", "obstacle"), ("inflation_layer", "inflation")]
    for costmap in (world, near):
        own = costmap.costmap
        assert (own.robot_radius, own.inflation_radius, own.cost_scaling_factor) == (0.18, 0.5, 10.0)
        (source,) = costmap.sources
        assert (source.name, source.topic, source.sensor_frame, source.data_type) == (
            "laser_scan",
            "/scan",
            "laser_link",
            "LaserScan",
        )
        assert (source.marking, source.clearing, source.inf_is_valid) == (True, True, None)
        assert (costmap.layers[-2].obstacle.obstacle_range, costmap.layers[-2].obstacle.raytrace_range) == (2.5, 3.0)
    assert (world.costmap.global_frame, world.costmap.update_frequency, world.costmap.rolling_window) == (
        "map",
        1.0,
        False,
    )
    own = near.costmap
    assert (own.global_frame, own.update_frequency, own.publish_frequency, own.rolling_window) == (
        "odom",
        5.0,
        2.0,
        True,
    )
    assert (own.width, own.height, own.resolution) == (4.0, 4.0, 0.05)


def test_mission_files_plain_and_loaded_into_namespaces() -> None:
    both = ("local_costmap_params.yaml", ""), ("global_costmap_params.yaml", "")
    check_mission(read_costmaps(of_files(("costmap_common_params.yaml", ""), *both)))
    common = [("costmap_common_params.yaml", space) for space in ("global_costmap", "local_costmap")]
    found = read_costmaps(of_files(*common, *both, ("base_local_planner_params.yaml", "")))
    check_mission(found)
    assert found.notes == (
        "accepted without effect: robot_base_frame, sensor_frame, data_type, topic (no meaning for a simulated robot)",
    )
    assert all(name.startswith("DWAPlannerROS") for name, _, _ in found.rest)
    assert len(found.rest) > 10


def test_mission_launch_file() -> None:
    node = read_launch(CONFIGS / "move_base.launch").find("move_base")[0]
    check_mission(read_costmaps([(s.name, s.value, s.source) for s in node.params.values()]))


def test_nothing_said_is_standard() -> None:
    found = read_costmaps([])
    assert found.global_costmap == LayeredParameters.standard("global")
    assert found.local_costmap == LayeredParameters.standard("local")
    assert read_costmaps([("base_local_planner", "x", "f:1")]).rest == (("base_local_planner", "x", "f:1"),)


def test_before_hydro_everything_is_the_costmaps_own() -> None:
    found = read_costmaps(
        [
            ("global_costmap/static_map", True, "g:1"),
            ("global_costmap/map_type", "voxel", "g:2"),
            ("global_costmap/z_voxels", 8, "g:3"),
            ("global_costmap/obstacle_range", 4.0, "g:4"),
            ("global_costmap/obstacle_layer/obstacle_range", 1.0, "g:5"),
            ("global_costmap/observation_sources", "base tilt", "g:6"),
            ("global_costmap/base/data_type", "LaserScan", "g:7"),
            ("global_costmap/base/expected_update_rate", 0.4, "g:8"),
            ("global_costmap/track_unknown_space", True, "g:9"),
            ("global_costmap/inflation_radius", 0.7, "g:10"),
            ("global_costmap/lethal_cost_threshold", 80, "g:11"),
            ("local_costmap/static_map", False, "l:1"),
        ]
    )
    world = found.global_costmap
    assert layers(world) == [("static_layer", "static"), ("obstacle_layer", "voxel"), ("inflation_layer", "inflation")]
    assert (world.layers[1].obstacle.z_voxels, world.layers[1].obstacle.obstacle_range) == (8, 4.0)
    assert [(s.name, s.data_type, s.expected_update_rate) for s in world.sources] == [
        ("base", "LaserScan", 0.4),
        ("tilt", "PointCloud", 0.0),
    ]
    assert (world.costmap.track_unknown, world.costmap.track_unknown_space) == (True, True)
    assert (world.costmap.inflation_radius, world.costmap.lethal_cost_threshold) == (0.7, 80)
    own = found.local_costmap.costmap
    assert (own.width, own.rolling_window, own.global_frame) == (10.0, True, "odom")


def test_a_list_of_plugins() -> None:
    plugins = [
        {"name": "map", "type": "costmap_2d::StaticLayer"},
        {"name": "sonar", "type": "range_sensor_layer::RangeSensorLayer"},
        {"name": "obstacles", "type": "costmap_2d::VoxelLayer"},
        {"name": "inflater", "type": "costmap_2d::InflationLayer"},
    ]
    found = read_costmaps(
        [
            ("local_costmap/plugins", plugins, "p:1"),
            ("local_costmap/obstacles/observation_sources", "scan", "p:2"),
            ("local_costmap/obstacles/scan/clearing", True, "p:3"),
            ("local_costmap/obstacles/scan/obstacle_range", 1.5, "p:4"),
            ("local_costmap/obstacle_range", 2.0, "p:5"),
            ("local_costmap/raytrace_range", 6.0, "p:6"),
            ("local_costmap/inflater/inflation_radius", 0.3, "p:7"),
            ("local_costmap/map/use_maximum", True, "p:8"),
            ("local_costmap/inflation_radius", 0.9, "p:9"),
            ("local_costmap/inflation_layer/inflation_radius", 0.8, "p:10"),
            ("local_costmap/footprint", [[0.2, 0.1], [-0.2, 0.1], [-0.2, -0.1], [0.2, -0.1]], "p:11"),
        ]
    )
    near = found.local_costmap
    assert layers(near) == [("map", "static"), ("obstacles", "voxel"), ("inflater", "inflation")]
    layer = near.layers[1]
    assert layer.obstacle.obstacle_ranges(layer.sources[0]) == (0.0, 1.5)
    assert layer.obstacle.raytrace_ranges(layer.sources[0]) == (0.0, 6.0)
    assert (near.costmap.inflation_radius, near.costmap.use_maximum) == (0.3, True)
    assert near.costmap.footprint.startswith("[[0.2, 0.1]")
    notes = "\n".join(found.notes)
    assert "'sonar' of type 'range_sensor_layer::RangeSensorLayer' has no counterpart" in notes
    assert "p:9: inflation_radius of the local costmap is not read" in notes
    assert "p:10: the local costmap has no layer 'inflation_layer'" in notes


def test_nav2_spellings() -> None:
    head = "global_costmap/global_costmap/ros__parameters"
    found = read_costmaps(
        [
            (f"{head}/plugins", ["static_layer", "obstacle_layer", "inflation_layer"], "n:1"),
            (f"{head}/use_sim_time", True, "n:2"),
            (f"{head}/track_unknown_space", True, "n:3"),
            (f"{head}/static_layer/plugin", "nav2_costmap_2d::StaticLayer", "n:4"),
            (f"{head}/static_layer/map_subscribe_transient_local", True, "n:5"),
            (f"{head}/obstacle_layer/plugin", "nav2_costmap_2d::ObstacleLayer", "n:6"),
            (f"{head}/obstacle_layer/observation_sources", "scan", "n:7"),
            (f"{head}/obstacle_layer/scan/obstacle_max_range", 2.4, "n:8"),
            (f"{head}/obstacle_layer/scan/raytrace_max_range", 3.3, "n:9"),
            (f"{head}/obstacle_layer/scan/raytrace_min_range", 0.1, "n:10"),
            (f"{head}/inflation_layer/plugin", "nav2_costmap_2d::InflationLayer", "n:11"),
            (f"{head}/inflation_layer/cost_scaling_factor", 3.0, "n:12"),
            (f"{head}/lethal_cost_threshold", 90, "n:13"),
        ]
    )
    world = found.global_costmap
    assert [layer.kind for layer in world.layers] == ["static", "obstacle", "inflation"]
    layer = world.layers[1]
    assert layer.obstacle.obstacle_ranges(layer.sources[0]) == (0.0, 2.4)
    assert layer.obstacle.raytrace_ranges(layer.sources[0]) == (0.1, 3.3)
    assert (world.costmap.track_unknown, world.costmap.lethal_cost_threshold) == (True, 90)
    assert found.notes == ()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("local_costmap/widht", 4.0, "did you mean width"),
        ("local_costmap/width", float("nan"), "not a number"),
        ("local_costmap/width", float("inf"), "between"),
        ("local_costmap/resolution", -0.05, "between"),
        ("inflation_layer/cost_scaling_factor", float("inf"), "between"),
        ("obstacle_layer/combination_method", 7, "choose 0, 1 or 99"),
        ("obstacle_layer/obstcle_range", 1.0, "obstacle_range"),
        ("local_costmap/plugins", "obstacle_layer", "not a list"),
        ("local_costmap/plugins", [3], "needs a name and a type"),
    ],
)
def test_wrong_values_are_refused_in_one_line(name: str, value: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        read_costmaps([(name, value, "c.yaml:7")])
    assert "\n" not in str(error.value)


def test_wrong_sources_are_refused() -> None:
    named = ("obstacle_layer/observation_sources", "scan", "c:1")
    for name, value, message in (
        ("markin", True, "did you mean marking"),
        ("data_type", "Image", "choose one of"),
        ("min_obstacle_height", 3.0, "source 'scan': min_obstacle_height=3 is above"),
    ):
        with pytest.raises(ConfigError, match=message):
            read_costmaps([named, (f"obstacle_layer/scan/{name}", value, "c:2")])


def test_a_local_costmap_stays_in_odom() -> None:
    found = read_costmaps(
        [("local_costmap/global_frame", "map", "l:1"), ("local_costmap/transform_tolerance", 0.5, "l:2")]
    )
    assert found.local_costmap.costmap.global_frame == "odom"
    assert "stays in frame odom" in found.notes[-1]
    assert "accepted without effect: transform_tolerance" in found.notes[0]
