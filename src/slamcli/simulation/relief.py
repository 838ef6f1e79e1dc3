# SPDX-License-Identifier: MIT
"""What a world has above its plan: ground that rises and falls, walls, boxes and pillars with heights, a ceiling."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]

WALL_HEIGHT_M = 2.5
WALL, THING, GROUND, CEILING = 0.6, 0.4, 0.3, 0.8
"""Reflectivity where a world file gives none."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights above the map's plane on a regular grid of nodes."""

    heights: Array
    """float64 (H, W), metres; node (r, c) lies at x0 + c * cell_m, y0 + r * cell_m in the map; at least 2 x 2."""
    cell_m: float
    x0: float
    y0: float

    def at(self, points: Array) -> Array:
        """Return heights (N,) at points (N, 2), a smooth (cubic spline) surface through the nodes, level beyond them."""
        rows_columns = (np.asarray(points)[:, ::-1] - np.array([self.y0, self.x0])) / self.cell_m
        return ndimage.map_coordinates(self._coefficients, rows_columns.T, order=3, mode="nearest", prefilter=False)

    def highest(self, points: Array) -> float:
        """Return the greatest height of the nodes within a cell of points (N, 2)."""
        columns, rows = np.rint((points - np.array([self.x0, self.y0])) / self.cell_m).astype(np.int64).T
        height, width = self.heights.shape
        return float(self._maxima[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)].max())

    @property
    def corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """X, y (metres, map frame) of the first and the last node."""
        height, width = self.heights.shape
        last = self.x0 + (width - 1) * self.cell_m, self.y0 + (height - 1) * self.cell_m
        return (self.x0, self.y0), last

    @cached_property
    def _coefficients(self) -> Array:
        return ndimage.spline_filter(self.heights, order=3, mode="nearest")

    @cached_property
    def _maxima(self) -> Array:
        return ndimage.maximum_filter(self.heights, size=3, mode="nearest")


@dataclass(frozen=True, eq=False)
class Relief:
    """Things with heights, metres in the map's frame, on their ground. Reflectivities are 0 to 1."""

    ground: Terrain
    ceiling: Terrain | None = None
    """On the same grid as `ground`."""
    panels: Array = field(default_factory=lambda: np.zeros((0, 7)))
    """float64 (S, 7), upright: x0, y0, x1, y1, low, high, reflectivity."""
    boxes: Array = field(default_factory=lambda: np.zeros((0, 9)))
    """float64 (B, 9): x, y of the centre, cosine and sine of the yaw, half length, half width, low, high, reflectivity."""
    cylinders: Array = field(default_factory=lambda: np.zeros((0, 6)))
    """float64 (C, 6), upright: x, y, radius, low, high, reflectivity."""


def flat_relief(segments: Array, circles: Array, bounds: tuple[float, float, float, float]) -> Relief:
    """Return level ground (to 2 m around `bounds`) with walls of 2.5 m over segments (S, 4) and circles (C, 3)."""
    ground = level(bounds, 2.0, 1.0)

    def upright(plan: Array, reflectivity: float) -> Array:
        return np.column_stack([plan, np.tile([0.0, WALL_HEIGHT_M, reflectivity], (len(plan), 1))])

    return Relief(ground, panels=upright(segments, WALL), cylinders=upright(circles, THING))


def level(bounds: tuple[float, float, float, float], margin_m: float, cell_m: float) -> Terrain:
    """Return ground at height 0 over `bounds` (x0, y0, x1, y1) and `margin_m` around them."""
    x0, y0 = bounds[0] - margin_m, bounds[1] - margin_m
    width, height = (
        int(np.ceil((high - low + margin_m) / cell_m - 1e-9)) for high, low in ((bounds[2], x0), (bounds[3], y0))
    )
    return Terrain(np.zeros((height + 1, width + 1)), cell_m, x0, y0)


def raise_ramp(terrain: Terrain, begin: Array, end: Array, rise_m: float, within: Array | None) -> Terrain:
    """Return `terrain` that rises smoothly from `begin` to `end` (x, y) and stays `rise_m` higher beyond.

    `within` (x0, y0, x1, y1) bounds where this holds; None: everywhere.
    """
    x, y = _nodes(terrain)
    way = end - begin
    t = np.clip(((x - begin[0]) * way[0] + (y - begin[1]) * way[1]) / float(way @ way), 0.0, 1.0)
    rise = rise_m * t * t * (3.0 - 2.0 * t)
    if within is not None:
        rise = np.where((x >= within[0]) & (y >= within[1]) & (x <= within[2]) & (y <= within[3]), rise, 0.0)
    return _raised(terrain, rise)


def raise_bump(terrain: Terrain, at: Array, radius_m: float, height_m: float) -> Terrain:
    """Return `terrain` with a round bump (or hollow) of `height_m` about `at`, level at its rim."""
    x, y = _nodes(terrain)
    share = np.minimum(np.hypot(x - at[0], y - at[1]) / radius_m, 1.0)
    return _raised(terrain, height_m * np.cos(0.5 * np.pi * share) ** 2)


def raise_hills(terrain: Terrain, height_m: float, wavelength_m: float, seed: int) -> Terrain:
    """Return `terrain` with random waves of one to three times `wavelength_m`, `height_m` between its extremes."""
    rng = np.random.default_rng(seed)
    x, y = _nodes(terrain)
    waves = np.zeros_like(x)
    for _ in range(16):
        length = wavelength_m * rng.uniform(1.0, 3.0)
        heading, phase = rng.uniform(0.0, 2 * np.pi, 2)
        k = 2 * np.pi / length
        waves += length * np.sin(k * (x * np.cos(heading) + y * np.sin(heading)) + phase)
    spread = float(waves.max() - waves.min())
    return _raised(terrain, height_m * (waves - waves.min()) / max(spread, 1e-12))


def _nodes(terrain: Terrain) -> tuple[Array, Array]:
    height, width = terrain.heights.shape
    x, y = np.meshgrid(terrain.x0 + np.arange(width) * terrain.cell_m, terrain.y0 + np.arange(height) * terrain.cell_m)
    return x, y


def _raised(terrain: Terrain, by: Array) -> Terrain:
    return Terrain(terrain.heights + by, terrain.cell_m, terrain.x0, terrain.y0)
