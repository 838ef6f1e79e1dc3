# SPDX-License-Identifier: MIT
"""The 2D map of a run in space: what stands in a band of heights above the ground, drawn submap by submap."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer import _projection_kernels as kernels
from slamcli.cartographer.parameters import Extensions3d
from slamcli.errors import EstimationError
from slamcli.geometry import quaternion, se3
from slamcli.grids import OccupancyGrid
from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid
from slamcli.grids.submap_drawing import draw_submaps
from slamcli.posegraph import Id
from slamcli.registration.voxel_filter import voxel_filter

DIRECTIONS = 720
GROUND_REACH_M = 12.0
LOWEST_M, HIGHEST_M, LAYER_M = -6.0, 2.0, 0.05
FORGET = 0.98
"""By which older scans' heights count less with each scan, so that the ground is that around the robot."""


class Projection:
    """Draws each node into a planar grid of its submap, in the submap's frame."""

    def __init__(self, settings: Extensions3d, loaded: Mapping[Id, ProbabilityGrid] | None = None) -> None:
        """Begin with the grids of submaps that were loaded."""
        self._settings = settings
        self._grids: dict[Id, ProbabilityGrid] = dict(loaded or {})
        self._heights = np.zeros(round((HIGHEST_M - LOWEST_M) / LAYER_M))

    def add(
        self,
        submap: Id,
        T_submap_node: NDArray[np.float64],
        gravity_alignment_xyzw: NDArray[np.float64],
        points_m: NDArray[np.float64],
        origin_m: NDArray[np.float64],
    ) -> None:
        """Draw a node: points (N, 3) and the sensor (3,) in the base frame, metres."""
        p, upright = self._settings, quaternion.to_matrix(gravity_alignment_xyzw)
        points, origin = points_m @ upright.T, upright @ origin_m
        low, high = (self._ground(points, float(origin[2])) + z for z in (p.projection_min_z, p.projection_max_z))
        nearest, clear = np.full(DIRECTIONS, np.inf), np.zeros(DIRECTIONS)
        inside = np.zeros(len(points), dtype=np.bool_)
        kernels.look_around(points, origin, low, high, p.projection_max_range, nearest, clear, inside)
        hits = points[inside][:, :2]
        hits = hits[voxel_filter(hits, p.projection_resolution)]
        angle = (np.arange(DIRECTIONS) + 0.5) * (2.0 * math.pi / DIRECTIONS) - math.pi
        # Free up to a cell before the nearest obstacle of a direction: what is behind it was seen over it.
        free = np.minimum(clear, nearest - p.projection_resolution)
        seen = free > p.projection_resolution
        ends = origin[:2] + free[seen, None] * np.column_stack([np.cos(angle[seen]), np.sin(angle[seen])])
        T = T_submap_node @ se3.from_position_quaternion(np.zeros(3), quaternion.conjugate(gravity_alignment_xyzw))
        self._draw(submap, se3.to_se2(T), origin[:2].copy(), hits, ends)

    def _draw(
        self,
        submap: Id,
        pose: NDArray[np.float64],
        start: NDArray[np.float64],
        hits: NDArray[np.float64],
        ends: NDArray[np.float64],
    ) -> None:
        resolution = self._settings.projection_resolution
        grid = self._grids.get(submap) or ProbabilityGrid.empty(resolution, (float(pose[0]), float(pose[1])))
        nothing = np.zeros((0, 2))
        # Obstacles first and without their rays, then the free directions: one would clear what the other has marked.
        grid = OddsInserter(hit_probability=0.6, insert_free_space=False).insert(grid, pose, start, hits, nothing)
        grid = OddsInserter(miss_probability=0.45).insert(grid, pose, start, nothing, ends)
        self._grids[submap] = grid

    def _ground(self, points: NDArray[np.float64], sensor_z: float) -> float:
        """Return the height of the ground in the upright base frame: the lowest layer that many points lie in.

        0, the base, if fewer than one in fifty points lie in any layer below the sensor.
        """
        kernels.count_heights(points, GROUND_REACH_M, LOWEST_M, LAYER_M, self._heights)
        below = self._heights[: max(1, math.floor((sensor_z - 0.2 - LOWEST_M) / LAYER_M))]
        layers = below[:-1] + below[1:] if len(below) > 1 else below  # a floor may lie between two layers
        total, self._heights = float(self._heights.sum()), self._heights * FORGET
        if not total or layers.max() < 0.02 * total:
            return 0.0
        return LOWEST_M + LAYER_M * (1 + int(np.flatnonzero(layers >= 0.3 * layers.max())[0]))

    def finish(self, T_map_submap: Mapping[Id, NDArray[np.float64]], frame_id: str) -> OccupancyGrid | None:
        """Return the grids of all submaps at their poses as one; None if nothing stands in the band anywhere."""
        ids = [submap for submap in sorted(self._grids) if submap in T_map_submap]
        if not ids:
            return None
        poses = se3.to_se2(np.array([T_map_submap[submap] for submap in ids]))
        try:
            return draw_submaps(
                [self._grids[submap] for submap in ids], poses, self._settings.projection_resolution, frame_id
            )
        except EstimationError:
            return None


def warm() -> None:
    """Compile the kernels of this module."""
    projection = Projection(Extensions3d())
    points = np.array([[1.0, 0.0, 0.5], [1.0, 1.0, 0.0]])
    projection.add(Id(0, 0), np.eye(4), np.array([0.0, 0, 0, 1]), points, np.array([0.0, 0.0, 1.0]))
