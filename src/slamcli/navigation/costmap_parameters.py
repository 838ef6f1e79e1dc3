# SPDX-License-Identifier: MIT
"""Parameters of the global costmap under costmap_2d's names, and how its files' other spellings lead to them."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.navigation.footprint import parse_footprint
from slamcli.parameters import parameter

COSTMAP_2D_ROBOT_RADIUS_M = 0.46
"""What costmap_2d assumes of a robot that a configuration file does not describe."""

_NO_DATA = "Accepted; no meaning without live sensor data."
_NO_TIME = "Accepted; no meaning offline."
_NO_WINDOW = "Accepted; the costmap has the extent of the map."


@dataclass(frozen=True, slots=True, kw_only=True)
class CostmapParameters:
    """What the global costmap is computed from."""

    robot_radius: float | None = parameter(
        None,
        "Radius of a round robot, unless a footprint is given. auto: 0.46 as in costmap_2d if a costmap file is read,"
        " else 0 (a point, which keeps away from walls by inflation alone).",
        kind=float,
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    footprint: str = parameter(
        "[]", "Outline of the robot, [[x1, y1], [x2, y2], ...]; goes before robot_radius.", unit="m"
    )
    footprint_padding: float = parameter(
        0.01, "Moves each coordinate of each corner away from zero.", unit="m", minimum=-10.0, maximum=10.0
    )
    static_enabled: bool = parameter(True, "Use the map at all.", name="static_layer.enabled")
    track_unknown_space: bool = parameter(
        True, "Unknown cells stay unknown; false makes them free.", name="static_layer.track_unknown_space"
    )
    lethal_cost_threshold: int = parameter(
        100, "Occupancy from which a cell is lethal; clamped to 0..100.", name="static_layer.lethal_cost_threshold"
    )
    unknown_cost_value: int = parameter(
        -1, "Occupancy value that means unknown.", name="static_layer.unknown_cost_value", minimum=-128, maximum=255
    )
    trinary_costmap: bool = parameter(
        True,
        "Cells below the threshold are free; false gives them a cost in proportion.",
        name="static_layer.trinary_costmap",
    )
    inflation_enabled: bool = parameter(True, "Inflate obstacles.", name="inflation_layer.enabled")
    inflation_radius: float | None = parameter(
        None,
        "How far obstacles have a cost. auto: 0.55 as in costmap_2d, but 0 where robot_radius is set to 0.",
        name="inflation_layer.inflation_radius",
        kind=float,
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    cost_scaling_factor: float = parameter(
        10.0,
        "How fast the cost falls with the distance from the inscribed radius: 252 * exp(-factor * distance).",
        name="inflation_layer.cost_scaling_factor",
        unit="1/m",
        minimum=0.0,
    )
    inflate_unknown: bool = parameter(
        False, "Inflation also gives a cost to unknown cells.", name="inflation_layer.inflate_unknown"
    )
    global_frame: str = parameter("map", "Frame of the map and of the path that is written.")
    robot_base_frame: str = parameter("base_link", _NO_TIME, effective=False)
    transform_tolerance: float = parameter(0.3, _NO_TIME, unit="s", effective=False)
    update_frequency: float = parameter(5.0, _NO_TIME, unit="Hz", effective=False)
    publish_frequency: float = parameter(0.0, _NO_TIME, unit="Hz", effective=False)
    always_send_full_costmap: bool = parameter(False, _NO_TIME, effective=False)
    static_map: bool = parameter(True, "Accepted; the map is always used.", effective=False)
    rolling_window: bool = parameter(False, _NO_WINDOW, effective=False)
    width: float = parameter(10.0, _NO_WINDOW, unit="m", effective=False)
    height: float = parameter(10.0, _NO_WINDOW, unit="m", effective=False)
    resolution: float = parameter(
        0.05, "Accepted; the costmap has the resolution of the map.", unit="m", effective=False
    )
    origin_x: float = parameter(0.0, _NO_WINDOW, unit="m", effective=False)
    origin_y: float = parameter(0.0, _NO_WINDOW, unit="m", effective=False)
    map_type: str = parameter("costmap", _NO_DATA, choices=("costmap", "voxel"), effective=False)
    map_topic: str = parameter("map", _NO_TIME, name="static_layer.map_topic", effective=False)
    first_map_only: bool = parameter(False, _NO_TIME, name="static_layer.first_map_only", effective=False)
    subscribe_to_updates: bool = parameter(False, _NO_TIME, name="static_layer.subscribe_to_updates", effective=False)
    use_maximum: bool = parameter(
        False, "Accepted; the map is the only layer below inflation.", name="static_layer.use_maximum", effective=False
    )

    def __post_init__(self) -> None:
        parse_footprint(self.footprint)


# Pre-Hydro files (without a list of plugins) have these at the top; costmap_2d moves them into the layers.
ALIASES = {
    "inflation_radius": "inflation_layer.inflation_radius",
    "cost_scaling_factor": "inflation_layer.cost_scaling_factor",
    "inflate_unknown": "inflation_layer.inflate_unknown",
    "track_unknown_space": "static_layer.track_unknown_space",
    "lethal_cost_threshold": "static_layer.lethal_cost_threshold",
    "unknown_cost_value": "static_layer.unknown_cost_value",
    "trinary_costmap": "static_layer.trinary_costmap",
    "map_topic": "static_layer.map_topic",
    "first_map_only": "static_layer.first_map_only",
    "subscribe_to_updates": "static_layer.subscribe_to_updates",
    "use_maximum": "static_layer.use_maximum",
}

OBSTACLE_LAYER_NAMES = [
    "enabled",
    "footprint_clearing_enabled",
    "max_obstacle_height",
    "min_obstacle_height",
    "combination_method",
    "obstacle_range",
    "raytrace_range",
    "observation_sources",
    "origin_z",
    "z_resolution",
    "z_voxels",
    "unknown_threshold",
    "mark_threshold",
    "publish_voxel_map",
    "track_unknown_space",
    "inf_is_valid",
    "raytrace_max_range",
    "raytrace_min_range",
    "obstacle_max_range",
    "obstacle_min_range",
]
SOURCE_NAMES = [
    "topic",
    "sensor_frame",
    "observation_persistence",
    "expected_update_rate",
    "data_type",
    "min_obstacle_height",
    "max_obstacle_height",
    "inf_is_valid",
    "clearing",
    "marking",
    "obstacle_range",
    "raytrace_range",
    "raytrace_max_range",
    "raytrace_min_range",
    "obstacle_max_range",
    "obstacle_min_range",
]
LAYER_TYPES = {
    "StaticLayer": "static_layer",
    "InflationLayer": "inflation_layer",
    "ObstacleLayer": "obstacle_layer",
    "VoxelLayer": "obstacle_layer",
}
