# SPDX-License-Identifier: MIT
"""``Grid`` and ``GridGlobal``: local grids of the nodes and the map that they make."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.errors import ConfigError
from slamcli.rtabmap.parameters.declaring import choice, count, length, number, region, switch, text


@dataclass(frozen=True, slots=True, kw_only=True)
class GridGroup:
    """``Grid``."""

    sensor: int = choice("Sensor", 1, "local grids come from", {0: "scans", 1: "depth images", 2: "both"})
    depth_decimation: int = count("DepthDecimation", 4, "depth images are made smaller by this", "", 1, 64)
    range_min: float = length("RangeMin", 0.0, "points nearer to the sensor are dropped")
    range_max: float = length("RangeMax", 5.0, "points farther from the sensor are dropped; 0: none")
    depth_roi_ratios: str = text(
        "DepthRoiRatios", "0.0 0.0 0.0 0.0", "shares of the depth image that are left out: left, right, top, bottom"
    )
    footprint_length: float = length(
        "FootprintLength", 0.0, "points within the robot's box are dropped: its length; 0: none"
    )
    footprint_width: float = length("FootprintWidth", 0.0, "width of that box")
    footprint_height: float = length("FootprintHeight", 0.0, "height of that box; 0: any")
    scan_decimation: int = count("ScanDecimation", 1, "every this many points of a scan are taken", "points", 1)
    cell_size: float = length("CellSize", 0.05, "edge of a cell", 1e-3)
    pre_voxel_filtering: bool = switch(
        "PreVoxelFiltering", True, "thin points to one per cell before ground is told from obstacles"
    )
    map_frame_projection: bool = switch(
        "MapFrameProjection", False, "heights are the map's; false: above the robot, turned upright"
    )
    normals_segmentation: bool = switch(
        "NormalsSegmentation", True, "normals tell ground from obstacles; false: heights alone"
    )
    max_obstacle_height: float = number("MaxObstacleHeight", 0.0, "higher points are dropped; 0: none", "m", -1e6, 1e6)
    min_ground_height: float = number("MinGroundHeight", 0.0, "lower points are dropped; 0: none", "m", -1e6, 1e6)
    max_ground_height: float = number(
        "MaxGroundHeight", 0.0, "higher points are obstacles; 0: any height may be ground", "m", -1e6, 1e6
    )
    max_ground_angle: float = number("MaxGroundAngle", 45.0, "steeper surfaces are obstacles", "deg", 0.0, 90.0)
    normal_k: int = count("NormalK", 20, "neighbours of which a normal is made", "points", 3, 10_000)
    cluster_radius: float = length("ClusterRadius", 0.1, "points this near to each other are one thing", 1e-4)
    min_cluster_size: int = count("MinClusterSize", 10, "smaller things are dropped", "points", 1)
    flat_obstacle_detected: bool = switch(
        "FlatObstacleDetected", True, "flat things above the largest ground are obstacles"
    )
    is_3d: bool = switch("3D", True, "local grids keep heights, as the cloud and the octree need; false: they are flat")
    ground_is_obstacle: bool = switch(
        "GroundIsObstacle", False, "ground is not told from obstacles (3D; flying robots)"
    )
    noise_filtering_radius: float = length(
        "NoiseFilteringRadius", 0.0, "points with too few neighbours within this are dropped; 0: none"
    )
    noise_filtering_min_neighbors: int = count("NoiseFilteringMinNeighbors", 5, "neighbours that they need", "points")
    scan_2d_unknown_space_filled: bool = switch(
        "Scan2dUnknownSpaceFilled", False, "beams of a planar scanner that meet nothing clear up to Grid/RangeMax"
    )
    ray_tracing: bool = switch("RayTracing", False, "what lies between sensor and points is free")

    def __post_init__(self) -> None:
        """Refuse a text that is no region."""
        self.depth_roi  # noqa: B018

    @property
    def depth_roi(self) -> tuple[float, float, float, float]:
        """`depth_roi_ratios` as numbers: left, right, top, bottom."""
        return region("Grid/DepthRoiRatios", self.depth_roi_ratios)


@dataclass(frozen=True, slots=True, kw_only=True)
class GridGlobalGroup:
    """``GridGlobal``."""

    update_error: float = length(
        "UpdateError", 0.01, "poses that moved more redraw the map; here it is drawn once, at the end", effective=False
    )
    footprint_radius: float = length("FootprintRadius", 0.0, "cells this near to the robot's path are free; 0: none")
    min_size: float = length("MinSize", 0.0, "edge of the map at least")
    eroded: bool = switch("Eroded", False, "take away obstacle cells that touch no other")
    max_nodes: int = count("MaxNodes", 0, "only so many of the newest nodes are drawn; 0: all", "nodes")
    altitude_delta: float = length(
        "AltitudeDelta", 0.0, "only nodes as high as the last one, give or take this, are drawn; 0: all"
    )
    occupancy_thr: float = number("OccupancyThr", 0.5, "probability from which a cell is occupied", "", 0.0, 1.0)
    prob_hit: float = number("ProbHit", 0.7, "probability of an obstacle where one was seen", "", 0.5, 0.999)
    prob_miss: float = number("ProbMiss", 0.4, "probability of an obstacle where free space was seen", "", 0.001, 0.5)
    prob_clamping_min: float = number(
        "ProbClampingMin", 0.1192, "probability that no cell falls below", "", 0.0001, 0.9999
    )
    prob_clamping_max: float = number("ProbClampingMax", 0.971, "probability that no cell exceeds", "", 0.0001, 0.9999)
    flood_fill_depth: int = count(
        "FloodFillDepth",
        0,
        "free cells of the octree that cannot be reached from the robot at this depth are dropped; 0: none",
        "",
        0,
        16,
    )

    def __post_init__(self) -> None:
        """Refuse limits of the probability that leave nothing in between."""
        if not self.prob_clamping_min < self.prob_clamping_max:
            raise ConfigError(
                f"GridGlobal/ProbClampingMin {self.prob_clamping_min:g} must be below GridGlobal/ProbClampingMax"
                f" {self.prob_clamping_max:g}"
            )
