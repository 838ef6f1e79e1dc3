# SPDX-License-Identifier: MIT
"""A surface from depth images: a truncated signed distance field in hashed blocks, and its triangles (open3d).

B. Curless, M. Levoy, "A Volumetric Method for Building Complex Models from Range Images", SIGGRAPH 1996, doi:10.1145/237170.237269.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_TRUNCATION = 4.0
"""Voxels in front of and behind a surface in which its distance is kept."""
_BLOCK, _FIRST_BLOCKS = 8, 4000
"""Voxels along the edge of a block (10 kB each), and blocks that there is room for at first; it grows."""
_LEAST_WEIGHT = 0.5
"""Views in which a voxel must have been seen: more than this."""


class Mesh(NamedTuple):
    """Triangles in the map frame."""

    vertices: NDArray[np.float32]
    """float32 (V, 3), metres."""
    colours: NDArray[np.uint8]
    """uint8 (V, 3), red, green, blue."""
    triangles: NDArray[np.int32]
    """int32 (F, 3), rows of `vertices`."""


EMPTY = Mesh(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8), np.empty((0, 3), np.int32))


class DepthFusion:
    """Takes depth images one after another; memory grows with the surface, not with their number.

    Parameters
    ----------
    voxel_m
        Edge of a voxel.
    range_m
        Depths beyond are left out.
    """

    def __init__(self, voxel_m: float, range_m: float) -> None:
        import open3d

        o3d: Any = open3d
        self._open3d = o3d
        self._range, self._is_empty = range_m, True
        real = o3d.core.float32
        self._blocks: Any = o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight", "color"), (real, real, real), ((1), (1), (3)), voxel_m, _BLOCK, _FIRST_BLOCKS, o3d.core.Device("CPU:0"),
        )  # fmt: skip

    def add(
        self,
        depth_m: NDArray[np.float32],
        colour: NDArray[np.uint8],
        intrinsics: tuple[float, float, float, float],
        T_camera_map: NDArray[np.float64],
    ) -> None:
        """Take a depth image (H, W), 0 where unknown, with its colours (H, W, 3) from where the camera was.

        `intrinsics` are fx, fy, cx, cy of the ideal camera, pixels.
        """
        o3d = self._open3d
        fx, fy, cx, cy = intrinsics
        matrix = o3d.core.Tensor(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]))
        depth = o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(depth_m, dtype=np.float32)))
        seen = o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(colour, dtype=np.float32) / np.float32(255)))
        if not ((depth_m > 0) & (depth_m <= self._range)).any():
            return
        pose = o3d.core.Tensor(np.ascontiguousarray(T_camera_map, dtype=np.float64))
        near = self._blocks.compute_unique_block_coordinates(depth, matrix, pose, 1.0, self._range, _TRUNCATION)
        self._blocks.integrate(near, depth, seen, matrix, pose, 1.0, self._range, _TRUNCATION)
        self._is_empty = False

    def mesh(self) -> Mesh:
        """Return the surface as it is now; empty where nothing was seen. Its order does not depend on threads."""
        if self._is_empty:
            return EMPTY
        found = self._blocks.extract_triangle_mesh(weight_threshold=_LEAST_WEIGHT)
        vertices = found.vertex.positions.numpy().reshape(-1, 3)
        triangles = found.triangle.indices.numpy().reshape(-1, 3) if len(vertices) else np.empty((0, 3), np.int64)
        colours = found.vertex.colors.numpy().reshape(-1, 3) if len(vertices) else np.empty((0, 3))
        order = np.lexsort(vertices.T[::-1])
        place = np.empty(len(order), dtype=np.int32)
        place[order] = np.arange(len(order), dtype=np.int32)
        return Mesh(
            vertices=vertices[order].astype(np.float32),
            colours=np.rint(np.clip(255 * colours[order], 0, 255)).astype(np.uint8),
            triangles=_in_order(place[triangles]),
        )


def _in_order(triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return triangles (F, 3) sorted, each turned so that its smallest corner stands first."""
    turned = triangles[np.arange(len(triangles))[:, None], (triangles.argmin(axis=1)[:, None] + np.arange(3)) % 3]
    return turned[np.lexsort(turned.T[::-1])]
