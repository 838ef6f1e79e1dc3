# SPDX-License-Identifier: MIT
"""Parameters of the global costmap under costmap_2d's names, and how its files' other spellings lead to them."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.navigation.footprint import parse_footprint
from slamcli.parameters import parameter

COSTMAP_2D_ROBOT_RADIUS_M = 0.46
"""What costmap_2d assumes of a robot that a configuration file does not describe."""

_NO_TIME = "Accepted; poses are known without waiting."
_NO_TOPIC = "Accepted; maps come whole."


@dataclass(frozen=True, slots=True, kw_only=True)
class CostmapParameters:
    """What a costmap is computed from: its extent, the robot, the static layer and inflation."""

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
        maximum=1e6,
    )
    inflate_unknown: bool = parameter(
        False, "Inflation also gives a cost to unknown cells.", name="inflation_layer.inflate_unknown"
    )
    track_unknown: bool = parameter(
        False,
        "Cells of which no layer says anything, and those of obstacle layers that no beam has met, are unknown, not free. With"
        " false an obstacle layer frees the unknown cells of the map below it, as in costmap_2d.",
        name="track_unknown_space",
    )
    global_frame: str = parameter("map", "Frame of the map and of the path that is written.")
    robot_base_frame: str = parameter("base_link", "Accepted; the simulator says what its frames are.", effective=False)
    transform_tolerance: float = parameter(0.3, _NO_TIME, unit="s", maximum=1e6, effective=False)
    update_frequency: float = parameter(
        5.0, "How often the costmap is updated; 0: never.", unit="Hz", minimum=0.0, maximum=1000.0
    )
    publish_frequency: float = parameter(
        0.0, "How often the costmap is recorded; 0: never.", unit="Hz", minimum=0.0, maximum=1000.0
    )
    always_send_full_costmap: bool = parameter(False, "Accepted; costmaps are recorded whole.", effective=False)
    static_map: bool | None = parameter(
        None, "Have a static layer, in files without a list of plugins. auto: what the costmap is for.", kind=bool
    )
    rolling_window: bool = parameter(False, "The costmap moves with the robot, who stays in its middle.")
    width: float = parameter(10.0, "Of a costmap without a map below.", unit="m", minimum=1e-3, maximum=1e5)
    height: float = parameter(10.0, "Of a costmap without a map below.", unit="m", minimum=1e-3, maximum=1e5)
    resolution: float = parameter(
        0.05, "Of a costmap without a map below: side of a cell.", unit="m", minimum=1e-4, maximum=1e3
    )
    origin_x: float = parameter(
        0.0, "Lower left corner of a costmap without a map below.", unit="m", minimum=-1e6, maximum=1e6
    )
    origin_y: float = parameter(
        0.0, "Lower left corner of a costmap without a map below.", unit="m", minimum=-1e6, maximum=1e6
    )
    map_type: str = parameter(
        "costmap",
        "Layer for what sensors see, in files without a list of plugins: the obstacle layer or the voxel layer.",
        choices=("costmap", "voxel"),
    )
    map_topic: str = parameter("map", _NO_TOPIC, name="static_layer.map_topic", effective=False)
    first_map_only: bool = parameter(
        False, "The first map stays, whatever SLAM says later.", name="static_layer.first_map_only"
    )
    subscribe_to_updates: bool = parameter(False, _NO_TOPIC, name="static_layer.subscribe_to_updates", effective=False)
    use_maximum: bool = parameter(
        False, "The map takes the greater cost where layers lie below it; else it overwrites them.", name="static_layer.use_maximum"
    )  # fmt: skip

    def __post_init__(self) -> None:
        parse_footprint(self.footprint)


WITHOUT_EFFECT_ON_A_SAVED_MAP = frozenset(
    {
        "track_unknown_space",
        "robot_base_frame",
        "transform_tolerance",
        "update_frequency",
        "publish_frequency",
        "always_send_full_costmap",
        "static_map",
        "rolling_window",
        "width",
        "height",
        "resolution",
        "origin_x",
        "origin_y",
        "map_type",
        "static_layer.map_topic",
        "static_layer.first_map_only",
        "static_layer.subscribe_to_updates",
        "static_layer.use_maximum",
    }
)
"""What has no meaning where no robot moves: the costmap has the extent of the map, which is the only layer below inflation."""

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
