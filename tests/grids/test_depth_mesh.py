# SPDX-License-Identifier: MIT
"""Meshes from depth images: the surface lies where it is, in its colours, with the same bytes every time."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import se3
from slamcli.grids.depth_mesh import DepthFusion

pytest.importorskip("open3d")
CAMERA = (150.0, 150.0, 79.5, 59.5)


def fused(views=3, shift=0.05):
    """A wall at x = 2 m of a camera that looks along x, from places that move along the wall."""
    fusion = DepthFusion(0.03, 4.0)
    colour = np.full((120, 160, 3), (200, 100, 50), np.uint8)
    depth = np.full((120, 160), 2.0, np.float32)
    depth[:, :10] = 0.0
    depth[:10] = 9.0  # beyond the range
    R_map_camera = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    for i in range(views):
        T_map_camera = se3.from_rotation_translation(R_map_camera, np.array([0.007, shift * i, 0.3]))
        fusion.add(depth, colour, CAMERA, se3.inverse(T_map_camera))
    return fusion.mesh()


def test_a_wall_lies_where_it_is():
    mesh = fused()
    assert len(mesh.triangles) > 2000
    np.testing.assert_allclose(mesh.vertices[:, 0], 2.007, atol=2e-3)
    assert np.ptp(mesh.vertices[:, 1]) == pytest.approx(2.0 + 0.1, abs=0.15)
    assert mesh.vertices[:, 2].max() < 0.3 + 2.0 * 50 / 150 + 0.05  # rows beyond the range are left out
    np.testing.assert_allclose(np.median(mesh.colours, axis=0), [200, 100, 50], atol=1)
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.median(np.sign(normals[:, 0])) == -1  # towards the camera


def test_the_same_bytes_every_time():
    first, second = fused(), fused()
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first, second, strict=True))


def test_nothing_seen_is_an_empty_mesh():
    fusion = DepthFusion(0.03, 4.0)
    fusion.add(np.zeros((120, 160), np.float32), np.zeros((120, 160, 3), np.uint8), CAMERA, np.eye(4))
    assert [len(part) for part in fusion.mesh()] == [0, 0, 0]
