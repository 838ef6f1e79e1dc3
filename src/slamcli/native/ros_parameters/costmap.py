# SPDX-License-Identifier: MIT
"""Parameters of ROS costmap_2d and its layers (ros-planning/navigation, noetic)."""

from __future__ import annotations

from slamcli.native.ros_parameters.declare import Table, row

COSTMAP: Table = (
    row("global_frame", "map", "Frame of the costmap."),
    row("robot_base_frame", "base_link", "Frame of the robot."),
    row("transform_tolerance", 0.3, "Oldest transform that is used.", "s", minimum=0),
    row("update_frequency", 5.0, "Rate of updates.", "Hz", minimum=0),
    row("publish_frequency", 0.0, "Rate of publishing.", "Hz", minimum=0),
    row("rolling_window", False, "The map moves with the robot."),
    row("width", 10.0, "Width of the map.", "m", minimum=0),
    row("height", 10.0, "Height of the map.", "m", minimum=0),
    row("resolution", 0.05, "Size of a cell.", "m", minimum=0.001),
    row("origin_x", 0.0, "Left edge of the map.", "m"),
    row("origin_y", 0.0, "Lower edge of the map.", "m"),
    row("robot_radius", 0.46, "Radius of a round robot.", "m", minimum=0),
    row("footprint_padding", 0.01, "Added around the footprint.", "m", minimum=0),
    row("track_unknown_space", False, "Unknown stays unknown instead of free."),
    row("always_send_full_costmap", False, "Publish the whole map at each update."),
    row("unknown_cost_value", -1, "Map value that means unknown.", minimum=-1, maximum=255),
    row("lethal_cost_threshold", 100, "Map value from which a cell is lethal.", minimum=0, maximum=255),
)
"""Of the costmap itself; ``footprint`` and ``plugins`` are lists and checked apart."""

STATIC_LAYER: Table = (
    row("enabled", True, "Use this layer."),
    row("map_topic", "map", "Topic of the map."),
    row("first_map_only", False, "Keep the first map that comes."),
    row("subscribe_to_updates", False, "Take partial updates of the map."),
    row("track_unknown_space", True, "Unknown cells of the map stay unknown."),
    row("use_maximum", False, "Keep the larger of map and layers below."),
    row("lethal_cost_threshold", 100, "Map value from which a cell is lethal.", minimum=0, maximum=255),
    row("unknown_cost_value", -1, "Map value that means unknown.", minimum=-1, maximum=255),
    row("trinary_costmap", True, "Only free, lethal and unknown."),
)

OBSTACLE_LAYER: Table = (
    row("enabled", True, "Use this layer."),
    row("observation_sources", "", "Names of the sensors, separated by blanks."),
    row("footprint_clearing_enabled", True, "The robot's own cells are free."),
    row("max_obstacle_height", 2.0, "Highest point that counts.", "m", minimum=0),
    row("combination_method", 1, "0 overwrite, 1 maximum, 99 nothing.", choices=("0", "1", "99")),
    row("obstacle_range", 2.5, "Farthest point that marks.", "m", minimum=0),
    row("raytrace_range", 3.0, "Farthest point up to which is cleared.", "m", minimum=0),
    row("track_unknown_space", False, "Unknown stays unknown instead of free."),
    row("transform_tolerance", 0.2, "Oldest transform that is used.", "s", minimum=0),
)

VOXEL_LAYER: Table = (
    *OBSTACLE_LAYER,
    row("origin_z", 0.0, "Height of the lowest voxel.", "m"),
    row("z_resolution", 0.2, "Height of a voxel.", "m", minimum=0.001),
    row("z_voxels", 10, "Voxels in a column.", minimum=1, maximum=16),
    row("unknown_threshold", 15, "Unknown voxels at which a column is still known.", minimum=0, maximum=16),
    row("mark_threshold", 0, "Marked voxels at which a column is still free.", minimum=0, maximum=16),
    row("publish_voxel_map", False, "Publish the voxels."),
)

INFLATION_LAYER: Table = (
    row("enabled", True, "Use this layer."),
    row("inflation_radius", 0.55, "Distance up to which obstacles cost.", "m", minimum=0),
    row("cost_scaling_factor", 10.0, "Rate at which the cost falls with distance.", "1/m", minimum=0),
    row("inflate_unknown", False, "Unknown cells get a cost as well."),
)

SOURCE: Table = (
    row("topic", "", "Topic of the sensor; empty is the source's own name."),
    row("sensor_frame", "", "Frame of the sensor; empty is that of the message."),
    row("observation_persistence", 0.0, "How long a reading counts; 0 is the last one only.", "s", minimum=0),
    row("expected_update_rate", 0.0, "Longest time between readings; 0 is any.", "s", minimum=0),
    row("data_type", "PointCloud", "Message type.", choices=("LaserScan", "PointCloud", "PointCloud2")),
    row("min_obstacle_height", 0.0, "Lowest point that counts.", "m"),
    row("max_obstacle_height", 2.0, "Highest point that counts.", "m"),
    row("inf_is_valid", False, "An infinite range clears up to the maximum range."),
    row("clearing", False, "Readings clear the space before them."),
    row("marking", True, "Readings mark obstacles."),
    row("obstacle_range", 2.5, "Farthest point that marks.", "m", minimum=0),
    row("raytrace_range", 3.0, "Farthest point up to which is cleared.", "m", minimum=0),
)
"""Of one observation source of an obstacle or voxel layer."""

LAYERS: dict[str, Table] = {
    "static_layer": STATIC_LAYER,
    "obstacle_layer": OBSTACLE_LAYER,
    "voxel_layer": VOXEL_LAYER,
    "inflation_layer": INFLATION_LAYER,
}
PLUGIN_TYPES = {
    "costmap_2d::StaticLayer": "static_layer",
    "costmap_2d::ObstacleLayer": "obstacle_layer",
    "costmap_2d::VoxelLayer": "voxel_layer",
    "costmap_2d::InflationLayer": "inflation_layer",
}

PRE_HYDRO: Table = (
    row("static_map", True, "There is a static layer."),
    row("map_type", "costmap", "voxel or costmap.", choices=("voxel", "costmap")),
    row("map_topic", "map", "Topic of the map."),
    *(entry for entry in VOXEL_LAYER if entry.name not in ("enabled", "track_unknown_space", "transform_tolerance")),
    row("inflation_radius", 0.55, "Distance up to which obstacles cost.", "m", minimum=0),
    row("cost_scaling_factor", 10.0, "Rate at which the cost falls with distance.", "1/m", minimum=0),
)
"""Top-level parameters from before Hydro: moved into layers when there is no ``plugins`` list."""
