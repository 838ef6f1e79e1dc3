# SPDX-License-Identifier: MIT
"""Ranges along rays through a world, exact to rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation import _raycast_kernels
from slamcli.simulation.world import World

Array = NDArray[np.float64]


def cast(world: World, origins: Array, directions: Array, max_range_m: float) -> Array:
    """Return the distance (N,), metres, to the first wall along each ray; inf where there is none within `max_range_m`.

    Parameters
    ----------
    world
        Segments and circles are met exactly; an occupied cell of a grid is met where the ray enters it.
    origins, directions
        float64 (N, 2), map frame: metres, and unit vectors.
    max_range_m
        How far rays go.
    """
    origins, directions = np.ascontiguousarray(origins), np.ascontiguousarray(directions)
    ranges = np.full(len(origins), float(max_range_m))
    _raycast_kernels.cast_shapes(origins, directions, world.segments, world.circles, ranges)
    if world.grid is not None:
        x, y, yaw = world.grid.origin
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])  # right-multiplied: turns by -yaw
        resolution = world.grid.resolution_m
        cells = np.ascontiguousarray((origins - np.array([x, y])) @ turn / resolution)
        ranges /= resolution
        _raycast_kernels.cast_grid(cells, np.ascontiguousarray(directions @ turn), world.occupied_cells, ranges)
        ranges *= resolution
    ranges[ranges >= max_range_m * (1 - 1e-12)] = np.inf
    return ranges


def cast_moving(origins: Array, directions: Array, times_s: Array, discs: Array, ranges_m: Array) -> Array:
    """Return `ranges_m` (N,) shortened by discs (D, 5) x, y, radius, vx, vy; ray i is cast at `times_s[i]`."""
    shortened: Array = ranges_m.copy()
    _raycast_kernels.cast_discs(
        np.ascontiguousarray(origins), np.ascontiguousarray(directions), times_s, np.ascontiguousarray(discs), shortened
    )
    return shortened


def clearance(world: World, points: Array) -> Array:
    """Return the distance (N,), metres, of points (N, 2), map frame, to the nearest segment or circle (not to a grid)."""
    distances = np.full(len(points), np.inf)
    _raycast_kernels.distances_to_shapes(np.ascontiguousarray(points), world.segments, world.circles, distances)
    return distances


def warm() -> None:
    """Compile the kernels of this module."""
    rays, shapes, ranges = np.array([[0.5, 0.5]]), np.zeros((1, 4)), np.ones(1)
    directions = np.array([[1.0, 0.0]])
    _raycast_kernels.cast_shapes(rays, directions, shapes, np.zeros((1, 3)), ranges)
    _raycast_kernels.cast_discs(rays, directions, np.zeros(1), np.zeros((1, 5)), ranges)
    _raycast_kernels.cast_grid(rays, directions, np.zeros((2, 2), np.uint8), ranges)
    _raycast_kernels.distances_to_shapes(rays, shapes, np.zeros((1, 3)), ranges)
