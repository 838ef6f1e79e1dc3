# SPDX-License-Identifier: MIT
"""Ground and obstacles in one view of depth, as RTAB-Map tells them apart (Labbé and Michaud, JFR 2019, section 3.4).

Flat surfaces by the normals of small neighbourhoods (Rusu, "Semantic 3D Object Maps", 2009, section 4.3), clustered by distance;
or, faster, by height alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import _ground_kernels as kernels

_HALF = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundSettings:
    """How ground is told from obstacles."""

    by_normals: bool = True
    """Whether by the slope of the surface; else by height alone."""
    max_ground_height_m: float = 0.0
    """Above it nothing is ground; 0: no limit, which needs normals."""
    max_angle_rad: float = math.radians(45.0)
    """Between the normal of ground and z."""
    normal_k: int = 20
    """Neighbours that a normal is from."""
    cluster_radius_m: float = 0.1
    """Gap at which clusters part."""
    min_cluster_size: int = 10
    """Points; smaller clusters are noise."""
    flat_obstacles: bool = True
    """Whether flat surfaces are clustered, so that those above the ground (a table) can be obstacles."""
    ground_normals_up: float = 0.0
    """See `slamcli.grids._ground_kernels.find_flat`: for the rings of a spinning scanner."""


class Segments(NamedTuple):
    """Rows of a cloud; noise is in neither."""

    ground: NDArray[np.int64]
    obstacles: NDArray[np.int64]


def segment(points: NDArray[np.float64], view: NDArray[np.float64], settings: GroundSettings) -> Segments:
    """Return which points are ground and which are obstacles, rising.

    Parameters
    ----------
    points
        float64 (N, 3), metres, z up; finite.
    view
        float64 (3,), from where they were seen.

    Notes
    -----
    With normals and a limit of height, flat clusters are ground whose middle lies below it, or no higher than the largest one
    reaches. Without a limit all of them are, as ramps and storeys are: a table counts as an obstacle only with the limit.
    """
    if len(points) == 0:
        return Segments(np.zeros(0, np.int64), np.zeros(0, np.int64))
    if not settings.by_normals:
        high = points[:, 2] > settings.max_ground_height_m
        return Segments(np.flatnonzero(~high), np.flatnonzero(high))
    ground = _ground(points, view, settings)
    rest = np.ones(len(points), dtype=np.bool_)
    rest[ground] = False
    if settings.max_ground_height_m != 0.0:
        rest &= points[:, 2] >= settings.max_ground_height_m
    others = np.flatnonzero(rest)
    labels = clusters(points[others], settings.cluster_radius_m, settings.min_cluster_size)
    return Segments(ground, others[labels >= 0])


def _ground(points: NDArray[np.float64], view: NDArray[np.float64], settings: GroundSettings) -> NDArray[np.int64]:
    flat = flat_points(points, view, settings)
    if not settings.flat_obstacles or len(flat) == 0:
        return flat
    labels = clusters(points[flat], settings.cluster_radius_m, settings.min_cluster_size)
    if labels.max() < 0:
        return flat[:0]
    heights = points[flat, 2]
    kept = labels >= 0
    sizes = np.bincount(labels[kept])
    means = np.bincount(labels[kept], weights=heights[kept]) / sizes
    largest = heights[labels == int(np.argmax(sizes))]
    limit = settings.max_ground_height_m
    if limit == 0.0:
        return flat[kept]
    if largest.min() >= limit:
        return flat[:0]
    is_ground = (means <= limit) | (means <= largest.max())
    is_ground[int(np.argmax(sizes))] = True
    return flat[kept & is_ground[labels]]


def flat_points(points: NDArray[np.float64], view: NDArray[np.float64], settings: GroundSettings) -> NDArray[np.int64]:
    """Return the rows about which the surface lies flat; a cloud of fewer than three points has none."""
    if len(points) < 3:
        return np.zeros(0, np.int64)
    # Imported here: reading a recording needs no trees.
    from scipy.spatial import cKDTree

    points = np.ascontiguousarray(points, dtype=np.float64)
    count = min(settings.normal_k, len(points))
    neighbours = cKDTree(points, balanced_tree=False, compact_nodes=False).query(points, max(count, 3))[1]
    flat = np.empty(len(points), dtype=np.bool_)
    kernels.find_flat(
        points, np.ascontiguousarray(neighbours, dtype=np.int64), np.ascontiguousarray(view, dtype=np.float64),
        math.cos(settings.max_angle_rad), float(settings.ground_normals_up), flat,
    )  # fmt: skip
    return np.flatnonzero(flat)


def clusters(points: NDArray[np.float64], radius_m: float, least: int) -> NDArray[np.int64]:
    """Return int64 (N,): which cluster each point is in, numbered by their first points; -1 where it has fewer than `least`.

    Two points are in one cluster if steps of at most `radius_m` from point to point lead from one to the other.
    """
    if len(points) == 0:
        return np.zeros(0, np.int64)
    points = np.ascontiguousarray(points, dtype=np.float64)
    cells = np.floor((points - points.min(axis=0)) / (radius_m / 1.7321)).astype(np.int64) + 2
    cells = np.minimum(cells, _HALF)
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    order = np.argsort(keys, kind="stable")
    unique, starts = np.unique(keys[order], return_index=True)
    parents = np.empty(len(points), dtype=np.int64)
    ends = np.append(starts, len(points)).astype(np.int64)
    kernels.join_cells(points, order, unique, ends, float(radius_m), parents)
    sizes = np.bincount(parents, minlength=len(points))
    roots = np.flatnonzero(sizes >= max(least, 1))
    numbers = np.full(len(points), -1, dtype=np.int64)
    numbers[roots] = np.arange(len(roots))
    found: NDArray[np.int64] = numbers[parents]
    return found


def without_noise(points: NDArray[np.float64], radius_m: float, least: int) -> NDArray[np.bool_]:
    """Return bool (N,): which points have more than `least` points, themselves among them, within `radius_m`."""
    if len(points) == 0:
        return np.zeros(0, dtype=np.bool_)
    from scipy.spatial import cKDTree

    near: NDArray[np.int64] = cKDTree(points).query_ball_point(points, radius_m, return_length=True)
    return near > least


def warm() -> None:
    """Compile the kernels of this module."""
    points = np.zeros((3, 3))
    flat_points(points, np.zeros(3), GroundSettings())
    clusters(points, 0.1, 1)
