# SPDX-License-Identifier: MIT
"""Maps of cameras that were held askew are turned upright."""

import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.geometry import se3
from slamcli.rtabmap.signature import NodeImages, NodeScan
from slamcli.rtabmap.turning_upright import find_upright
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=100.0, fy=100.0, cx=79.5, cy=59.5, width=160, height=120)


def _camera_pose(pitch_rad: float, x: float) -> np.ndarray:
    """Pose in a frame with z up of a camera 1 m above the floor that looks along x, down by `pitch_rad`."""
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    tilt = Rotation.from_rotvec([-pitch_rad, 0.0, 0.0]).as_matrix()
    return se3.from_rotation_translation(level @ tilt, np.array([x, 0.0, 1.0]))


def _floor_depth(T_up_camera: np.ndarray) -> np.ndarray:
    """Depth image of the floor z = 0; 0 above the horizon and beyond 5 m."""
    v, u = np.mgrid[0:120, 0:160]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u, dtype=float)], axis=-1)
    down = rays @ T_up_camera[:3, :3].T[:, 2]
    depth = np.where(down < -1e-3, -T_up_camera[2, 3] / np.minimum(down, -1e-3), 0.0)
    return np.where(depth < 5.0, depth, 0.0).astype(np.float32)


def test_the_floor_tells_where_up_is() -> None:
    truth = [_camera_pose(0.4, x) for x in (0.0, 0.2, 0.4)]
    depths = [_floor_depth(T) for T in truth]
    T_base = np.array([se3.inverse(truth[0]) @ T for T in truth])  # the map begins as the first camera lies

    def sensors(node_id: int) -> tuple[NodeImages | None, NodeScan | None]:
        depth = depths[node_id - 1]
        colour = np.zeros(depth.shape, dtype=np.uint8)
        return NodeImages(colour=colour, camera=CAMERA, T_base_camera=np.eye(4), depth=depth), None

    T_up_map, found = find_upright([1, 2, 3], T_base, np.eye(4), sensors, seed=0)
    assert found.source == "floor"
    poses = T_up_map @ T_base
    up_in_camera = np.array([T[2, :3] for T in truth])
    np.testing.assert_allclose(poses[:, 2, :3], up_in_camera, atol=2e-3)
    np.testing.assert_allclose(poses[:, :2, 3], [[0.0, 0.0], [0.2, 0.0], [0.4, 0.0]], atol=5e-3)


def test_without_depth_the_way_cameras_are_held_tells() -> None:
    T_base = np.array([np.eye(4), np.eye(4)])
    T_up_map, found = find_upright([1, 2], T_base, np.eye(4), lambda _: (None, None), seed=0)
    assert found.source == "cameras"
    np.testing.assert_allclose(T_up_map[:3, :3] @ [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-12)
