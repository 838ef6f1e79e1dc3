# SPDX-License-Identifier: MIT
"""Small worlds of points seen by pinhole cameras on a path, exact or with noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=520.0, fy=515.0, cx=318.0, cy=243.0, width=640, height=480, baseline_m=0.08)


def pose(rotvec, translation):
    """T (4, 4) from a rotation vector and a translation."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotvec).as_matrix()
    T[:3, 3] = translation
    return T


def moved(T, points):
    """Points (..., 3) under T (4, 4)."""
    return points @ T[:3, :3].T + T[:3, 3]


def seen(T_camera_map, points, camera=CAMERA):
    """Pixels (N, 2) and right columns (N,) of points in the map frame."""
    local = moved(T_camera_map, points)
    pixels = camera.project(local)
    return pixels, pixels[:, 0] - camera.bf / local[:, 2]


def far_pose(seed=0):
    """A camera that is neither at the origin nor along an axis."""
    rng = np.random.default_rng(seed)
    return pose(rng.normal(size=3), rng.normal(size=3) * 3)


def visible_points(T_camera_map, count, rng, camera=CAMERA, near=1.0, far=6.0):
    """Points (N, 3) of the map frame that this camera sees."""
    pixels = rng.uniform((0, 0), (camera.width, camera.height), (count, 2))
    local = camera.back_project(pixels, rng.uniform(near, far, count))
    return moved(np.linalg.inv(T_camera_map), local)


@dataclass
class Scene:
    """Cameras on an arc that look at a box of points, and who sees what."""

    poses: np.ndarray
    points: np.ndarray
    camera_index: np.ndarray
    point_index: np.ndarray
    pixels: np.ndarray
    right: np.ndarray
    sigmas: np.ndarray


def scene(cameras=8, points=120, *, seed=0, noise=0.0, stereo=True, seen_by=None, camera=CAMERA):
    """Cameras on an arc of 3 m around a box of points 2 m wide; each point is seen by `seen_by` cameras (all: None)."""
    rng = np.random.default_rng(seed)
    angles = np.linspace(-0.5, 0.5, cameras)
    poses = np.array([pose([0.02 * i, a, 0.03], [0.1 * np.sin(i), 0.05 * i, 3.0]) for i, a in enumerate(angles)])
    xyz = rng.uniform(-1, 1, (points, 3))
    chosen = (
        [(k, j) for k in range(cameras) for j in range(points)]
        if seen_by is None
        else [(k, j) for j in range(points) for k in np.sort(rng.choice(cameras, seen_by, replace=False))]
    )
    k, j = np.array(chosen, np.int64).T
    local = np.einsum("nij,nj->ni", poses[k, :3, :3], xyz[j]) + poses[k, :3, 3]
    sigmas = 1.2 ** rng.integers(0, 4, len(k)).astype(float)
    pixels = camera.project(local)
    right = pixels[:, 0] - camera.bf / local[:, 2]
    pixels = pixels + noise * sigmas[:, None] * rng.normal(size=pixels.shape)
    right = right + noise * sigmas * rng.normal(size=len(k))
    if not stereo:
        right = np.full(len(k), np.nan)
    return Scene(poses, xyz, k, j, pixels, right, sigmas)
