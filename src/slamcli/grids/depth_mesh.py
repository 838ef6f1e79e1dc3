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


class Mesh(NamedTuple):
    """Triangles in the map frame."""

    vertices: NDArray[np.float32]
    """float32 (V, 3), metres."""
    colours: NDArray[np.uint8]
    """uint8 (V, 3), red, green, blue."""
    triangles: NDArray[np.int32]
    """int32 (F, 3), rows of `vertices`."""


class DepthFusion:
    """Takes depth images one after another; memory grows with the surface, not with their number.

    Parameters
    ----------
    voxel_m
        Edge of a voxel.
    range_m
        Depths beyond are left out.
    intrinsics
        fx, fy, cx, cy of the ideal camera, pixels.
    """

    def __init__(self, voxel_m: float, range_m: float, intrinsics: tuple[float, float, float, float]) -> None:
        import open3d

        self._open3d: Any = open3d
        self._range, self._intrinsics = range_m, intrinsics
        self._volume: Any = open3d.pipelines.integration.ScalableTSDFVolume(
            voxel_length=voxel_m,
            sdf_trunc=_TRUNCATION * voxel_m,
            color_type=open3d.pipelines.integration.TSDFVolumeColorType.RGB8,
        )

    def add(self, depth_m: NDArray[np.float32], colour: NDArray[np.uint8], T_camera_map: NDArray[np.float64]) -> None:
        """Take a depth image (H, W), 0 where unknown, with its colours (H, W, 3) from where the camera was."""
        o3d = self._open3d
        height, width = depth_m.shape
        pair = o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(np.ascontiguousarray(colour)), o3d.geometry.Image(np.ascontiguousarray(depth_m)),
            depth_scale=1.0, depth_trunc=self._range, convert_rgb_to_intensity=False,
        )  # fmt: skip
        self._volume.integrate(pair, o3d.camera.PinholeCameraIntrinsic(width, height, *self._intrinsics), T_camera_map)

    def mesh(self) -> Mesh:
        """Return the surface as it is now; empty where nothing was seen."""
        found = self._volume.extract_triangle_mesh()
        return Mesh(
            vertices=np.asarray(found.vertices, dtype=np.float32).reshape(-1, 3),
            colours=np.rint(255 * np.clip(np.asarray(found.vertex_colors), 0, 1)).astype(np.uint8).reshape(-1, 3),
            triangles=np.asarray(found.triangles, dtype=np.int32).reshape(-1, 3),
        )
