# SPDX-License-Identifier: MIT
"""From ``Grid/`` and ``GridGlobal/`` to what local grids and their assembly are told."""

from __future__ import annotations

import math
from dataclasses import replace

from slamcli.grids.ground import GroundSettings
from slamcli.grids.odds_plane import OddsSettings
from slamcli.rtabmap.assembly import AssemblySettings
from slamcli.rtabmap.local_grid import LocalGridSettings
from slamcli.rtabmap.node_points import DepthSettings
from slamcli.rtabmap.parameters import RtabmapParameters

_STEP_M, _HEAD_ROOM_M = 0.15, 2.0
"""Above the floor: up to where ground can be, and from where nothing is in the way."""


def local_grid_settings(parameters: RtabmapParameters) -> LocalGridSettings:
    """Return how local grids are made. Limits of height that exclude each other are off, and heights alone need a limit, as in RTAB-Map."""
    grid = parameters.grid
    ground = grid.max_ground_height
    if ground == 0.0 and not grid.normals_segmentation:
        ground = grid.cell_size
    obstacle = 0.0 if ground != 0.0 and grid.max_obstacle_height < ground else grid.max_obstacle_height
    least = 0.0 if ground != 0.0 and ground < grid.min_ground_height else grid.min_ground_height
    return LocalGridSettings(
        cell_size_m=grid.cell_size, sensor=grid.sensor, spatial=grid.is_3d, ray_tracing=grid.ray_tracing,
        range_min_m=grid.range_min, range_max_m=grid.range_max,
        depth=DepthSettings(decimation=grid.depth_decimation, roi_ratios=grid.depth_roi),
        scan_decimation=grid.scan_decimation, footprint_m=(grid.footprint_length, grid.footprint_width, grid.footprint_height),
        pre_voxel_filtering=grid.pre_voxel_filtering, map_frame_projection=grid.map_frame_projection,
        min_ground_height_m=least, max_obstacle_height_m=max(obstacle, 0.0),
        ground=GroundSettings(
            by_normals=grid.normals_segmentation, max_ground_height_m=ground, max_angle_rad=math.radians(grid.max_ground_angle),
            normal_k=grid.normal_k, cluster_radius_m=grid.cluster_radius, min_cluster_size=grid.min_cluster_size,
            flat_obstacles=grid.flat_obstacle_detected, ground_normals_up=parameters.icp.point_to_plane_ground_normals_up,
        ),
        ground_is_obstacle=grid.ground_is_obstacle, noise_radius_m=grid.noise_filtering_radius,
        noise_min_neighbours=grid.noise_filtering_min_neighbors, scan_2d_unknown_space_filled=grid.scan_2d_unknown_space_filled,
    )  # fmt: skip


def above_floor(settings: LocalGridSettings, floor_m: float) -> LocalGridSettings:
    """Return how local grids are made above a floor at that z of the map, where the user left all limits of height alone."""
    heights = (settings.ground.max_ground_height_m, settings.max_obstacle_height_m, settings.min_ground_height_m)
    if settings.map_frame_projection or any(heights):
        return settings
    ground, obstacle = (floor_m + above or 1e-6 for above in (_STEP_M, _HEAD_ROOM_M))  # 0 would be no limit
    return replace(
        settings, map_frame_projection=True, ground=replace(settings.ground, max_ground_height_m=ground),
        max_obstacle_height_m=obstacle,
    )  # fmt: skip


def assembly_settings(parameters: RtabmapParameters) -> AssemblySettings:
    """Return how local grids are put together."""
    world = parameters.grid_global
    return AssemblySettings(
        odds=OddsSettings(
            hit=world.prob_hit, miss=world.prob_miss, least=world.prob_clamping_min, most=world.prob_clamping_max,
            threshold=world.occupancy_thr,
        ),
        min_size_m=world.min_size, eroded=world.eroded, footprint_radius_m=world.footprint_radius, max_nodes=world.max_nodes,
        altitude_delta_m=world.altitude_delta,
    )  # fmt: skip
