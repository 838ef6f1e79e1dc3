# SPDX-License-Identifier: MIT
"""What a camera sees of a world: rays to the faces that they meet (Embree through Open3D), light from their pictures.

Open3D says which face a ray meets; where it meets it is computed from the face's plane in double precision, so that depth
is exact and a point of a picture is seen at the same place of it from everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation import _render_kernels, surfaces, texture
from slamcli.simulation.relief import Relief
from slamcli.simulation.surfaces import CEILING, GROUND, THING, WALL, Surfaces

Array = NDArray[np.float64]

_MOST_TEXELS = 40_000_000
_BUSY = {WALL: 0.7, THING: 1.3, GROUND: 0.6, CEILING: 0.5}
_SAMPLES = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optics:
    """Where the pixels of a camera look: directions (H, W, 3) in its optical frame, and their steps to the next pixel."""

    directions: Array
    right: Array
    down: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """One perfect image."""

    light: NDArray[np.float32]
    """(H, W, C), grey levels, not rounded."""
    depth_m: Array
    """float64 (H, W), along the optical axis; inf where nothing is."""
    slants: Array
    """float64 (H, W), cosine between ray and normal."""
    surfaces: NDArray[np.int64]
    """(H, W), which picture is seen, -1 the sky."""


class Scene:
    """A world with pictures on its surfaces, ready for rays."""

    def __init__(self, relief: Relief, *, seed: int, texel_m: float, plain_share: float, grey: bool) -> None:
        """Paint every surface.

        Parameters
        ----------
        relief
            What stands where.
        seed
            Of the pictures.
        texel_m
            Size of their finest details; greater where the pictures would not fit into memory (40 million texels).
        plain_share
            Share of walls and ceilings without texture.
        grey
            Without colours, which takes a third of memory and less time.
        """
        import open3d

        self._surfaces: Surfaces = surfaces.surfaces_of(relief)
        area = float(self._surfaces.sizes.prod(axis=1).sum()) * 4 / 3
        self.texel_m = max(texel_m, float(np.sqrt(area / _MOST_TEXELS)))
        kinds = self._surfaces.kinds
        drawn = np.random.default_rng([seed, len(kinds)]).random(len(kinds))
        plain = (drawn < plain_share) & ((kinds == WALL) | (kinds == CEILING))
        sizes = np.maximum(np.ceil(self._surfaces.sizes / self.texel_m), 1).astype(np.int64)
        busy = np.array([_BUSY[k] for k in kinds.tolist()])
        album = texture.make_album(sizes, plain, busy, seed)
        self._album = album.grey() if grey else album
        corners = self._surfaces.corners.astype(np.float32).reshape(-1, 3)
        triangles = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
        self._casting: Any = open3d.t.geometry.RaycastingScene()
        self._casting.add_triangles(_tensor(corners), _tensor(triangles))

    def view(self, optics: Optics, rotations: Array, positions: Array) -> View:
        """Return what a camera sees whose optical frame is at `rotations` (H, 3, 3), `positions` (H, 3) at each image row.

        Pixels at the border of a surface are means of four samples.
        """
        height, width = optics.directions.shape[:2]
        rows = np.repeat(np.arange(height), width)
        ahead, right, down = (a.reshape(-1, 3) for a in (optics.directions, optics.right, optics.down))
        faces, light, distances, slants = self._look(ahead, right, down, rows, rotations, positions)
        seen = np.where(faces >= 0, self._surfaces.pictures[faces], -1).reshape(height, width)
        edges = np.zeros((height, width), np.bool_)
        _render_kernels.find_edges(seen, edges)
        at = np.flatnonzero(edges)
        if len(at):
            wide, tall = right[at], down[at]
            beside = np.concatenate([ahead[at] + x * wide + y * tall for x, y in _SAMPLES])
            wide, tall = (np.tile(step / 2, (len(_SAMPLES), 1)) for step in (wide, tall))
            samples = self._look(beside, wide, tall, np.tile(rows[at], len(_SAMPLES)), rotations, positions)[1]
            light[at] = samples.reshape(len(_SAMPLES), len(at), -1).mean(axis=0)
        return View(
            light=light.astype(np.float32).reshape(height, width, -1),
            depth_m=(distances * ahead[:, 2]).reshape(height, width),
            slants=slants.reshape(height, width),
            surfaces=seen,
        )

    def _look(
        self, directions: Array, right: Array, down: Array, rows: NDArray[np.int64], rotations: Array, positions: Array
    ) -> tuple[NDArray[np.int64], Array, Array, Array]:
        """Return faces (N,), light (N, C), distances (N,) and slants (N,) of rays by directions (N, 3)."""
        count = len(directions)
        rays = np.empty((count, 6), np.float32)
        _render_kernels.make_rays(directions, rows, rotations, positions, rays)
        hits = self._casting.cast_rays(_tensor(rays))["primitive_ids"].numpy()
        faces = np.where(hits == np.uint32(0xFFFFFFFF), np.int64(-1), hits.astype(np.int64))
        light = np.empty((count, self._album.texels.shape[1]))
        distances, slants = np.empty(count), np.empty(count)
        s = self._surfaces
        _render_kernels.shade(
            faces, directions, right, down, rows, rotations, positions, s.planes, s.maps, s.pictures, s.brightness,
            self._album.texels, self._album.levels, self.texel_m, light, distances, slants,
        )  # fmt: skip
        return faces, light, distances, slants


def _tensor(array: Any) -> Any:
    import open3d

    return open3d.core.Tensor.from_numpy(array)


def warm() -> None:
    """Compile the kernels of this module."""
    album = texture.make_album(np.array([[1, 1]]), np.ones(1, np.bool_), np.ones(1), 0)
    faces, rows, ahead = np.zeros(1, np.int64), np.zeros(1, np.int64), np.array([[0.0, 0.0, 1.0]])
    pose = np.eye(3)[None], np.zeros((1, 3))
    _render_kernels.make_rays(ahead, rows, *pose, np.empty((1, 6), np.float32))
    _render_kernels.shade(
        faces, ahead, ahead, ahead, rows, *pose, np.array([[0.0, 0.0, 1.0, 2.0]]), np.zeros((1, 2, 4)), faces, np.ones(1),
        album.texels, album.levels, 1.0, np.empty((1, 3)), np.empty(1), np.empty(1),
    )  # fmt: skip
    _render_kernels.find_edges(np.zeros((2, 2), np.int64), np.zeros((2, 2), np.bool_))
