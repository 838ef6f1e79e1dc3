# SPDX-License-Identifier: MIT
"""A box of points with descriptors of their own, and the features that a camera with depth sees of them."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se3
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=300.0, fy=300.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.08, depth_weight=3.0)
T_BASE_CAMERA = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0.02], [0, -1, 0, 0.4], [0, 0, 0, 1]])
STEP_NS = 100_000_000


class World:
    """Points on the walls of a room of 8 m."""

    def __init__(self, count: int = 12000, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        points = rng.uniform(-4.0, 4.0, (count, 3))
        wall = rng.integers(0, 3, count)
        points[np.arange(count), wall] = np.where(rng.random(count) < 0.5, -4.0, 4.0)
        self.points = points
        self.descriptors = rng.integers(0, 256, (count, 32), dtype=np.uint8)

    def features(self, T_odom_base: np.ndarray, *, noise_px: float = 0.3, seed: int = 0, most: int = 500) -> Features:
        """Return what the camera on a base at a pose sees."""
        rng = np.random.default_rng(seed)
        T_camera_odom = se3.inverse(T_odom_base @ T_BASE_CAMERA)
        at_camera = self.points @ T_camera_odom[:3, :3].T + T_camera_odom[:3, 3]
        ahead = np.flatnonzero(at_camera[:, 2] > 0.3)
        pixels = CAMERA.project(at_camera[ahead])
        inside = (pixels > 0).all(axis=1) & (pixels < (320, 240)).all(axis=1)
        rows = ahead[inside][:most]
        depth = at_camera[rows, 2] * (1.0 + rng.normal(0.0, 0.003, len(rows)))
        pixels = CAMERA.project(at_camera[rows]) + rng.normal(0.0, noise_px, (len(rows), 2))
        count = len(rows)
        flips = rng.integers(0, 256, (count, 3))
        descriptors = self.descriptors[rows].copy()
        for k in range(3):
            descriptors[np.arange(count), flips[:, k] // 8] ^= (1 << (flips[:, k] % 8)).astype(np.uint8)
        return Features(
            pixels=pixels, octaves=np.zeros(count, dtype=np.int64), angles=np.zeros(count), responses=np.arange(count, 0, -1.0),
            descriptors=descriptors, sigmas=np.ones(count), right=pixels[:, 0] - CAMERA.bf / depth, depth=depth,
            raw_pixels=pixels.copy(),
        )  # fmt: skip


def nothing() -> Features:
    """Return the features of a dark image."""
    none = np.zeros(0)
    return Features(
        pixels=np.zeros((0, 2)), octaves=np.zeros(0, dtype=np.int64), angles=none, responses=none,
        descriptors=np.zeros((0, 32), dtype=np.uint8), sigmas=none, right=none, depth=none, raw_pixels=np.zeros((0, 2)),
    )  # fmt: skip


def pose(x: float, y: float, yaw: float) -> np.ndarray:
    """Return a pose (4, 4) on the floor."""
    return np.asarray(se3.from_se2(np.array([x, y, yaw])))


def circle(count: int, step_rad: float = 0.06) -> list[np.ndarray]:
    """Return poses along a circle of 1 m, from the origin on, looking ahead."""
    return [pose(np.sin(a), 1.0 - np.cos(a), a) for a in step_rad * np.arange(count)]
