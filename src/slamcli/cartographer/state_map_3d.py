# SPDX-License-Identifier: MIT
"""The 2D map and the cloud that are in a state in space: drawn from the voxels of its submaps, since scans are not kept."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slamcli.cartographer.parameters import Extensions3d
from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se3
from slamcli.grids import OccupancyGrid
from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid, value_of
from slamcli.grids.submap_drawing import draw_submaps
from slamcli.measurements import PointCloud
from slamcli.posegraph import Id, MapState, Submap

_OCCUPIED = 16384
"""Values of voxels from here on mean a probability of over one half."""
_AROUND_M = 0.5
"""The ground under a column is the lowest voxel of a square of this edge around it."""
_LAYERS = 2
"""Voxels so many layers over the ground are no ground: it may lie between two layers."""
_RISE_M, _RISE = 0.5, 0.3
"""How far, and per metre from the path, the ground may rise over the path: what is higher is a ceiling."""
_MOST_CELLS = 1 << 26
_DIRECTIONS = 720
_SPACING_M = 1.0
"""How far the nodes are apart from which free space is looked at."""
_WALL, _FLOOR = (value_of(np.array([p]))[0] for p in (0.9, 0.2))


def draw_state_3d(settings: Extensions3d, state: MapState, frame_id: str) -> OccupancyGrid:
    """Return what stands in the height band above the ground, trinary.

    The ground is found column by column, so slopes are no walls. It is free where it was seen and nothing stands on it,
    and on the way there from the nodes of the submap.

    Raises
    ------
    EstimationError
        If nothing was seen.
    DataError
        If a submap is too large to be one.
    """
    grids = planar_grids(settings, state)
    if not grids:
        raise EstimationError("no map can be drawn: no submap of the state has a path and an occupied voxel")
    poses = se3.to_se2(np.array([submap.T_map_submap for submap in state.submaps if submap.id in grids]))
    drawn = [grids[submap.id] for submap in state.submaps if submap.id in grids]
    return draw_submaps(drawn, poses, settings.projection_resolution, frame_id)


def planar_grids(settings: Extensions3d, state: MapState) -> dict[Id, ProbabilityGrid]:
    """Return the planar grids of the submaps, each in its submap's frame; of those that have a path and voxels."""
    positions: dict[Id, list[NDArray[np.float64]]] = defaultdict(list)
    nodes = {node.id: node for node in state.nodes}
    for constraint in state.constraints:
        if constraint.kind == "intra":
            positions[constraint.submap].append(nodes[constraint.node].T_local_node[:3, 3])
    grids = {}
    for submap in state.submaps:
        path, T = np.array(positions[submap.id]).reshape(-1, 3), se3.inverse(submap.T_local_submap)
        grid = _planar(submap, path @ T[:3, :3].T + T[:3, 3], settings)
        if grid is not None:
            grids[submap.id] = grid
    return grids


def state_cloud(state: MapState, frame_id: str) -> PointCloud | None:
    """Return the centres of occupied voxels of all submaps, in the map; None if there is none."""
    parts = []
    for submap in sorted(state.submaps, key=lambda submap: submap.id):
        if submap.high_resolution is not None:
            T = submap.T_map_submap
            voxels = _occupied(submap) * submap.high_resolution.resolution_m
            parts.append(voxels @ T[:3, :3].T + T[:3, 3])
    if not sum(map(len, parts)):
        return None
    stamp_ns = max((node.stamp_ns for node in state.nodes), default=0)
    return PointCloud(stamp_ns=stamp_ns, frame_id=frame_id, points_m=np.concatenate(parts).astype(np.float32))


def _occupied(submap: Submap) -> NDArray[np.int64]:
    """Return the indices (N, 3) of voxels that are rather occupied than free."""
    grid = submap.high_resolution
    if grid is None:
        return np.zeros((0, 3), np.int64)
    return grid.indices[grid.values >= _OCCUPIED].astype(np.int64)


def _planar(submap: Submap, path_m: NDArray[np.float64], settings: Extensions3d) -> ProbabilityGrid | None:
    """Return the grid of one submap in its own frame; `path_m` (K, 3) are its nodes there."""
    voxels = _occupied(submap)
    if submap.high_resolution is None or not len(voxels) or not len(path_m):
        return None
    step = submap.high_resolution.resolution_m
    corner = voxels[:, :2].min(axis=0)
    columns = voxels[:, :2] - corner
    shape = (int(columns[:, 1].max()) + 1, int(columns[:, 0].max()) + 1)
    if shape[0] * shape[1] > _MOST_CELLS:
        raise DataError(
            f"submap {submap.id.number} of trajectory {submap.id.trajectory} is {shape[1] * step:.0f} x {shape[0] * step:.0f} m: "
            "its voxels are broken"
        )
    where = columns[:, 1], columns[:, 0]
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, where, voxels[:, 2] * step)
    ground = ndimage.minimum_filter(lowest, size=2 * round(_AROUND_M / 2 / step) + 1, mode="nearest")
    ground[ground > _highest_ground(shape, corner, step, path_m)] = np.inf
    with np.errstate(invalid="ignore"):
        heights = voxels[:, 2] * step - ground[where]
        stands = (heights > max(settings.projection_min_z, (_LAYERS - 0.5) * step)) & (
            heights <= settings.projection_max_z
        )
        wall, floor = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
        wall[columns[stands, 1], columns[stands, 0]] = True
        low = np.isfinite(heights) & (heights < (_LAYERS - 0.5) * step)
    floor[columns[low, 1], columns[low, 0]] = True
    origin = (float((corner[0] - 0.5) * step), float((corner[1] - 0.5) * step))
    grid = _seen_free(ProbabilityGrid(np.zeros(shape, np.uint16), step, origin), wall, floor & ~wall, path_m)
    rows, left = round((origin[1] - grid.origin[1]) / step), round((origin[0] - grid.origin[0]) / step)
    part = grid.cells[rows : rows + shape[0], left : left + shape[1]]
    part[floor] = _FLOOR
    part[wall] = _WALL
    return grid


def _highest_ground(
    shape: tuple[int, int], corner: NDArray[np.int64], step: float, path_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how high the ground may be in each column, by the nearest place of the path."""
    cells = np.rint(path_m[:, :2] / step).astype(np.int64) - corner
    inside = ((cells >= 0) & (cells < [shape[1], shape[0]])).all(axis=1)
    away, height = np.ones(shape, np.bool_), np.full(shape, path_m[:, 2].max())
    away[cells[inside, 1], cells[inside, 0]] = False
    height[cells[inside, 1], cells[inside, 0]] = path_m[inside, 2]
    if away.all():
        return height + _RISE_M
    distance, (row, column) = ndimage.distance_transform_edt(away, return_indices=True)
    return height[row, column] + _RISE_M + _RISE * step * distance


def _seen_free(
    grid: ProbabilityGrid, wall: NDArray[np.bool_], floor: NDArray[np.bool_], path_m: NDArray[np.float64]
) -> ProbabilityGrid:
    """Clear the way from places of the path to the farthest floor in each direction that no wall hides."""
    inserter, nothing = OddsInserter(miss_probability=0.45), np.zeros((0, 2))
    walls, floors = (
        (np.argwhere(mask)[:, ::-1] + 0.5) * grid.resolution_m + np.array(grid.origin) for mask in (wall, floor)
    )
    angles = (np.arange(_DIRECTIONS) + 0.5) * (2.0 * math.pi / _DIRECTIONS) - math.pi
    last = None
    for place in path_m[:, :2]:
        if last is not None and np.linalg.norm(place - last) < _SPACING_M:
            continue
        last = place
        nearest = _by_direction(walls - place, grid.resolution_m, np.minimum, np.inf)
        farthest = _by_direction(floors - place, 0.0, np.maximum, 0.0)
        reach = np.minimum(farthest, nearest - grid.resolution_m)
        seen = reach > grid.resolution_m
        ends = place + reach[seen, None] * np.column_stack([np.cos(angles[seen]), np.sin(angles[seen])])
        grid = inserter.insert(grid, np.zeros(3), place, nothing, ends)
    return grid


def _by_direction(away_m: NDArray[np.float64], width_m: float, collect: np.ufunc, start: float) -> NDArray[np.float64]:
    """Return by direction the least or greatest distance of points (N, 2); they hide `width_m` across the line of sight."""
    found = np.full(_DIRECTIONS, start)
    distances = np.hypot(away_m[:, 0], away_m[:, 1])
    turn = np.arctan2(away_m[:, 1], away_m[:, 0]) / (2.0 * math.pi) + 0.5
    middle = (turn * _DIRECTIONS).astype(np.int64)
    half = np.minimum(0.5 * width_m / np.maximum(distances, width_m + 1e-9), 1.0) * _DIRECTIONS / (2.0 * math.pi)
    reach = np.ceil(half).astype(np.int64)
    for offset in range(-int(reach.max(initial=0)), int(reach.max(initial=0)) + 1):
        wide = reach >= abs(offset)
        collect.at(found, (middle[wide] + offset) % _DIRECTIONS, distances[wide])
    return found
