# SPDX-License-Identifier: MIT
"""The surfaces of a world as flat faces with pictures: what a camera sees of walls, things, ground and ceiling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.simulation.relief import Relief, Terrain

Array = NDArray[np.float64]

_SIDES = 20
"""Flat faces around a pillar."""
_LIGHT = np.array([0.36, 0.48, 0.80])
WALL, THING, GROUND, CEILING = 0, 1, 2, 3


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """F triangles and T pictures on them."""

    corners: Array
    """float64 (F, 3, 3), metres, map frame."""
    planes: Array
    """float64 (F, 4): unit normal n and d of n @ p = d."""
    maps: Array
    """float64 (F, 2, 4): u = maps[:, 0, :3] @ p + maps[:, 0, 3] and v likewise, metres on the picture."""
    pictures: NDArray[np.int64]
    """(F,), which picture."""
    brightness: Array
    """float64 (F,), share of light by the way a face looks."""
    sizes: Array
    """float64 (T, 2), width and height of each picture, metres."""
    kinds: NDArray[np.int64]
    """(T,), WALL, THING, GROUND or CEILING."""


class _Builder:
    """Collects triangles."""

    def __init__(self) -> None:
        self.corners: list[Array] = []
        self.maps: list[Array] = []
        self.pictures: list[int] = []
        self.sizes: list[tuple[float, float]] = []
        self.kinds: list[int] = []

    def picture(self, width_m: float, height_m: float, kind: int) -> int:
        self.sizes.append((max(width_m, 0.01), max(height_m, 0.01)))
        self.kinds.append(kind)
        return len(self.sizes) - 1

    def patch(self, origin: Array, along: Array, across: Array, picture: int, u0: float = 0.0) -> None:
        """Add a parallelogram whose picture begins `u0` metres to the right at `origin`; v runs from the far side down."""
        a, b = origin + along, origin + across
        width, height = float(np.linalg.norm(along)), float(np.linalg.norm(across))
        u, v = along / width, -across / height
        mapping = np.array([[*u, u0 - u @ origin], [*v, height - v @ origin]])
        for triangle in ((origin, a, a + across), (origin, a + across, b)):
            self.triangle(np.array(triangle), mapping, picture)

    def triangle(self, corners: Array, mapping: Array, picture: int) -> None:
        self.corners.append(corners)
        self.maps.append(mapping)
        self.pictures.append(picture)

    def done(self) -> Surfaces:
        corners = np.array(self.corners)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        kept = lengths > 1e-12
        corners, normals = corners[kept], normals[kept] / lengths[kept, None]
        planes = np.column_stack([normals, (normals * corners[:, 0]).sum(axis=1)])
        return Surfaces(
            corners, planes, np.array(self.maps)[kept], np.array(self.pictures)[kept],
            0.72 + 0.28 * np.abs(normals @ _LIGHT), np.array(self.sizes), np.array(self.kinds),
        )  # fmt: skip


def surfaces_of(relief: Relief) -> Surfaces:
    """Return everything in `relief` as triangles, in the order ground, ceiling, panels, boxes, cylinders.

    Raises
    ------
    ConfigError
        If the ground has more cells than a camera's world can hold.
    """
    build = _Builder()
    _field(build, relief.ground, GROUND)
    if relief.ceiling is not None:
        _field(build, relief.ceiling, CEILING)
    for x0, y0, x1, y1, low, high, _ in relief.panels:
        low = max(low, float(relief.ground.heights.min()))
        foot, along, up = np.array([x0, y0, low]), np.array([x1 - x0, y1 - y0, 0.0]), np.array([0.0, 0.0, high - low])
        if min(np.linalg.norm(along), high - low) > 1e-6:
            build.patch(foot, along, up, build.picture(float(np.linalg.norm(along)), high - low, WALL))
    for row in relief.boxes:
        _box(build, row, float(relief.ground.heights.min()))
    for row in relief.cylinders:
        _cylinder(build, row, float(relief.ground.heights.min()))
    return build.done()


def _field(build: _Builder, terrain: Terrain, kind: int) -> None:
    """Add ground or a ceiling: one patch where it is level, else two triangles for each cell."""
    (x0, y0), (x1, y1) = terrain.corners
    picture = build.picture(x1 - x0, y1 - y0, kind)
    z = terrain.heights
    if np.ptp(z) == 0.0:
        corner = np.array([x0, y0, float(z[0, 0])])
        build.patch(corner, np.array([x1 - x0, 0.0, 0.0]), np.array([0.0, y1 - y0, 0.0]), picture)
        return
    if z.size > 2_000_000:
        raise ConfigError(f"{z.size} heights of the ground are too many for a camera: give a larger relief.cell")
    rows, columns = np.meshgrid(np.arange(z.shape[0] - 1), np.arange(z.shape[1] - 1), indexing="ij")
    mapping = np.array([[1.0, 0.0, 0.0, -x0], [0.0, -1.0, 0.0, y1]])

    def node(dr: int, dc: int) -> Array:
        r, c = rows.ravel() + dr, columns.ravel() + dc
        return np.column_stack([x0 + c * terrain.cell_m, y0 + r * terrain.cell_m, z[r, c]])

    for triangle in ((node(0, 0), node(0, 1), node(1, 1)), (node(0, 0), node(1, 1), node(1, 0))):
        for corners in np.stack(triangle, axis=1):
            build.triangle(corners, mapping, picture)


def _box(build: _Builder, row: Array, floor_m: float) -> None:
    """Add the six sides of a box, each with a picture of its own."""
    x, y, c, s, half_length, half_width, low, high, _ = row
    low = max(low, floor_m)
    along, left, up = np.array([c, s, 0.0]) * 2 * half_length, np.array([-s, c, 0.0]) * 2 * half_width, np.zeros(3)
    up[2] = high - low
    if up[2] <= 1e-6:
        return
    foot = np.array([x, y, low]) - along / 2 - left / 2
    sides = [
        (foot, along, up), (foot + along, left, up), (foot + along + left, -along, up), (foot + left, -left, up),
        (foot + up, along, left),
    ]  # fmt: skip
    if low > floor_m + 1e-6:
        sides.append((foot, along, left))
    for origin, a, b in sides:
        build.patch(origin, a, b, build.picture(float(np.linalg.norm(a)), float(np.linalg.norm(b)), THING))


def _cylinder(build: _Builder, row: Array, floor_m: float) -> None:
    """Add a pillar: a picture around its side, another on its top (and one on its underside)."""
    x, y, radius, low, high, _ = row
    low = max(low, floor_m)
    if high - low <= 1e-6:
        return
    angles = 2 * np.pi * np.arange(_SIDES + 1) / _SIDES
    rim = np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])
    side = 2 * radius * np.sin(np.pi / _SIDES)
    around = build.picture(side * _SIDES, high - low, THING)
    up = np.array([0.0, 0.0, high - low])
    for i in range(_SIDES):
        foot = np.array([*rim[i], low])
        build.patch(foot, np.array([*(rim[i + 1] - rim[i]), 0.0]), up, around, i * side)
    for z in (high, low) if low > floor_m + 1e-6 else (high,):
        top = build.picture(2 * radius, 2 * radius, THING)
        mapping = np.array([[1.0, 0.0, 0.0, radius - x], [0.0, -1.0, 0.0, radius + y]])
        for i in range(_SIDES):
            build.triangle(np.array([[x, y, z], [*rim[i], z], [*rim[i + 1], z]]), mapping, top)
