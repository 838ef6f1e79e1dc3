# SPDX-License-Identifier: MIT
"""What one node saw of ground, obstacles and free space (Labbé and Michaud, JFR 2019, section 3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.grids.ground import GroundSettings, segment, without_noise
from slamcli.grids.rays import free_cells, swept_ends
from slamcli.grids.voxel_means import means_of_cells
from slamcli.grids.voxel_rays import free_voxels
from slamcli.rtabmap.node_points import DepthSettings, depth_points, moved, within_range
from slamcli.rtabmap.signature import NodeImages, NodeScan

SCAN, DEPTH, BOTH = 0, 1, 2
Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalGridSettings:
    """What becomes of a node's sensors; named as RTAB-Map's ``Grid/`` parameters are."""

    cell_size_m: float = 0.05
    sensor: int = DEPTH
    """0: scans, 1: depth images, 2: both."""
    spatial: bool = True
    """``Grid/3D``: points keep their height; else they are cells of the plane."""
    ray_tracing: bool = False
    range_min_m: float = 0.0
    range_max_m: float = 5.0
    """0: no limit."""
    depth: DepthSettings = field(default_factory=DepthSettings)
    scan_decimation: int = 1
    footprint_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Length, width and height of the box about the base in which points are of the robot; zeros: none."""
    pre_voxel_filtering: bool = True
    map_frame_projection: bool = False
    """Whether heights are those in the map, not above the base."""
    min_ground_height_m: float = 0.0
    """Points below are left out; 0: none."""
    max_obstacle_height_m: float = 0.0
    """Points above are left out; 0: none."""
    ground: GroundSettings = field(default_factory=GroundSettings)
    ground_is_obstacle: bool = False
    noise_radius_m: float = 0.0
    """0: no filter."""
    noise_min_neighbours: int = 5
    scan_2d_unknown_space_filled: bool = False

    @property
    def reach_m(self) -> float:
        """How far points may be; 0: no limit. With ray tracing, what is too far still clears the way there."""
        return 0.0 if self.ray_tracing else self.range_max_m


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalGrid:
    """Ground, obstacles and free space about one node: of the plane (N, 2) or of space (N, 3).

    Those of space are in the base frame. Those of the plane are in the levelled base frame, at the same place, whose z is that
    of the map and whose yaw is that of the base.
    """

    ground: NDArray[np.float32]
    """(G, 2) or (G, 3), metres, as the next two."""
    obstacles: NDArray[np.float32]
    empty: NDArray[np.float32]
    """Centres of cells of the map that rays went through and that hold neither."""
    cell_size_m: float
    view_point: NDArray[np.float64]
    """float64 (3,), metres, base frame: where the sensor was."""

    @property
    def spatial(self) -> bool:
        """Whether its points have a height."""
        return self.obstacles.shape[1] == 3


def levelled(T_map_base: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return T_map_level (4, 4): the pose of the base without roll and pitch."""
    yaw = math.atan2(T_map_base[1, 0], T_map_base[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    return se3.from_rotation_translation(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), T_map_base[:3, 3])


def local_grid(
    images: NodeImages | None, scan: NodeScan | None, T_map_base: NDArray[np.float64], settings: LocalGridSettings
) -> LocalGrid | None:
    """Return what a node at `T_map_base` (4, 4) saw; None where the sensor that is asked for is not there.

    A planar scan alone is always traced: its free space is cells of the map's own lattice, so that the map gets no holes where
    a node stands askew.
    """
    if settings.sensor == SCAN and scan is not None and scan.planar:
        return _of_planar_scan(scan, T_map_base, settings)
    parts = []
    if settings.sensor in (SCAN, BOTH) and scan is not None:
        view = scan.T_base_sensor[:3, 3]
        points = scan.points[:: max(settings.scan_decimation, 1)].astype(np.float64)
        points = within_range(points, view, settings.range_min_m, settings.reach_m)
        parts.append(_of_points(points, view, T_map_base, settings, all_obstacles=scan.planar))
    if settings.sensor in (DEPTH, BOTH) and images is not None:
        seen = depth_points(images, settings.depth, settings.range_min_m, settings.reach_m)
        if seen is not None:
            parts.append(_of_points(seen.points, images.T_base_camera[:3, 3], T_map_base, settings))
    return _together(parts)


def _together(parts: list[LocalGrid]) -> LocalGrid | None:
    if len(parts) < 2:
        return parts[0] if parts else None
    return LocalGrid(
        ground=np.concatenate([part.ground for part in parts]), obstacles=np.concatenate([part.obstacles for part in parts]),
        empty=np.concatenate([part.empty for part in parts]), cell_size_m=parts[0].cell_size_m, view_point=parts[-1].view_point,
    )  # fmt: skip


def _of_planar_scan(scan: NodeScan, T_map_base: NDArray[np.float64], settings: LocalGridSettings) -> LocalGrid:
    T_map_level = levelled(T_map_base)
    to_level = (se3.inverse(T_map_level) @ T_map_base)[:3, :3]
    view = scan.T_base_sensor[:3, 3]
    start, hits = (to_level @ view)[:2], (scan.points.astype(np.float64) @ to_level.T)[:, :2]
    known = [range_m for range_m in (settings.range_max_m, scan.range_max_m) if range_m > 0.0]
    limit = settings.range_max_m
    if known and (settings.range_max_m > 0.0 or settings.scan_2d_unknown_space_filled):
        limit = min(known)
    distance = np.linalg.norm(hits - start, axis=1)
    hits, distance = hits[distance >= settings.range_min_m], distance[distance >= settings.range_min_m]
    ends = [np.zeros((0, 2)) if scan.open_ends is None else (scan.open_ends.astype(np.float64) @ to_level.T)[:, :2]]
    if settings.scan_2d_unknown_space_filled:
        ends.append(swept_ends(start, hits, limit or float(distance.max(initial=0.0)), settings.cell_size_m))
    near = distance <= (limit or np.inf)
    ends.append(hits[~near])
    return _traced(hits[near], _clipped(start, np.concatenate(ends), limit), start, T_map_level, view, settings)


def _clipped(start: Points, ends: Points, limit: float) -> Points:
    """Return ends (N, D) no farther than `limit` (0: none)."""
    apart = ends - start
    length = np.linalg.norm(apart, axis=1)
    if limit <= 0.0 or not (length > limit).any():
        return ends
    return start + apart * np.minimum(1.0, limit / np.maximum(length, 1e-9))[:, None]


def _traced(
    hits: Points,
    ends: Points,
    start: Points,
    T_map_level: NDArray[np.float64],
    view: Points,
    settings: LocalGridSettings,
) -> LocalGrid:
    """Return the planar grid of rays in the levelled base frame."""
    turn, place = T_map_level[:2, :2], T_map_level[:2, 3]
    cells = free_cells(turn @ start + place, hits @ turn.T + place, ends @ turn.T + place, settings.cell_size_m)
    centres = ((cells + 0.5) * settings.cell_size_m - place) @ turn
    return LocalGrid(
        ground=np.zeros((0, 2), np.float32), obstacles=hits.astype(np.float32), empty=centres.astype(np.float32),
        cell_size_m=settings.cell_size_m, view_point=view,
    )  # fmt: skip


def _of_points(
    points: Points,
    view: Points,
    T_map_base: NDArray[np.float64],
    settings: LocalGridSettings,
    *,
    all_obstacles: bool = False,
) -> LocalGrid:
    """Return the grid of points (N, 3) of the base frame; `all_obstacles`: none of them can be ground."""
    T_map_level = levelled(T_map_base)
    to_level = (se3.inverse(T_map_level) @ T_map_base)[:3, :3]
    if settings.pre_voxel_filtering:
        points = means_of_cells(points, settings.cell_size_m)
    level, seen_from = points @ to_level.T, to_level @ view
    lift = T_map_base[2, 3] if settings.map_frame_projection else 0.0
    heights = level[:, 2] + lift
    kept = ~_of_robot(level, settings.footprint_m)
    if settings.min_ground_height_m != 0.0 and not all_obstacles:
        kept &= heights >= settings.min_ground_height_m
    if settings.max_obstacle_height_m != 0.0:
        kept &= heights <= settings.max_obstacle_height_m
    level = level[kept]
    ground, obstacles = _segmented(level, seen_from, lift, settings, all_obstacles)
    if settings.spatial:
        return _spatial(ground @ to_level, obstacles @ to_level, view, T_map_base, settings)
    flat_ground, flat_obstacles = (means_of_cells(p[:, :2], settings.cell_size_m) for p in (ground, obstacles))
    if settings.ray_tracing:
        far = np.linalg.norm(flat_obstacles - seen_from[:2], axis=1) > (settings.range_max_m or np.inf)
        ends = _clipped(seen_from[:2], np.concatenate([flat_ground, flat_obstacles[far]]), settings.range_max_m)
        return _traced(flat_obstacles[~far], ends, seen_from[:2], T_map_level, view, settings)
    return LocalGrid(
        ground=flat_ground.astype(np.float32), obstacles=flat_obstacles.astype(np.float32),
        empty=np.zeros((0, 2), np.float32), cell_size_m=settings.cell_size_m, view_point=view,
    )  # fmt: skip


def _segmented(
    level: Points, view: Points, lift: float, settings: LocalGridSettings, all_obstacles: bool
) -> tuple[Points, Points]:
    """Return ground and obstacles without noise."""
    if all_obstacles or (settings.ground_is_obstacle and settings.spatial):
        ground, obstacles = level[:0], level
    else:
        raised = np.array([0.0, 0.0, lift])
        rows = segment(level + raised, view + raised, settings.ground)
        ground, obstacles = level[rows.ground], level[rows.obstacles]
    if settings.noise_radius_m > 0.0 and settings.noise_min_neighbours > 0:
        ground, obstacles = (_without_noise(points, view, settings) for points in (ground, obstacles))
    return ground, obstacles


def _without_noise(points: Points, view: Points, settings: LocalGridSettings) -> Points:
    """Return points that are not alone; those beyond the range stay, for they only clear."""
    far = np.linalg.norm(points - view, axis=1) > (settings.range_max_m or np.inf)
    kept = far.copy()
    kept[~far] = without_noise(points[~far], settings.noise_radius_m, settings.noise_min_neighbours)
    return points[kept]


def _spatial(
    ground: Points, obstacles: Points, view: Points, T_map_base: NDArray[np.float64], settings: LocalGridSettings
) -> LocalGrid:
    """Return the grid of points in the base frame."""
    empty = np.zeros((0, 3))
    if settings.ray_tracing:
        limit = settings.range_max_m or np.inf
        far = [np.linalg.norm(points - view, axis=1) > limit for points in (ground, obstacles)]
        ends = _clipped(view, np.concatenate([ground[far[0]], obstacles[far[1]]]), settings.range_max_m)
        ground, obstacles = ground[~far[0]], obstacles[~far[1]]
        start = T_map_base[:3, :3] @ view + T_map_base[:3, 3]
        hits, ends = (moved(points, T_map_base) for points in (np.concatenate([ground, obstacles]), ends))
        cells = free_voxels(start, hits, ends, settings.cell_size_m)
        empty = moved((cells + 0.5) * settings.cell_size_m, se3.inverse(T_map_base))
    return LocalGrid(
        ground=ground.astype(np.float32), obstacles=obstacles.astype(np.float32), empty=empty.astype(np.float32),
        cell_size_m=settings.cell_size_m, view_point=view,
    )  # fmt: skip


def _of_robot(level: Points, footprint: tuple[float, float, float]) -> NDArray[np.bool_]:
    """Return which points lie in the robot's own box, which stands on the base's plane; a size of 0 reaches without end."""
    length, width, height = footprint
    if length <= 0.0:
        return np.zeros(len(level), dtype=np.bool_)
    inside = (np.abs(level[:, 0]) <= length / 2) & (level[:, 2] >= 0.0)
    if width > 0.0:
        inside &= np.abs(level[:, 1]) <= width / 2
        if height > 0.0:
            inside &= level[:, 2] <= height
    return inside
