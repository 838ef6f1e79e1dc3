# SPDX-License-Identifier: MIT
"""Places with textured points, as signatures with noise of known size."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.rtabmap.signature import Signature
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=520.0, fy=515.0, cx=318.0, cy=243.0, width=640, height=480, baseline_m=0.08)
T_BASE_CAMERA = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0.02], [0, -1, 0, 0.4], [0, 0, 0, 1]])


def motion(x=0.0, y=0.0, z=0.0, rotvec=(0.0, 0.0, 0.0)):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotvec).as_matrix()
    T[:3, 3] = x, y, z
    return T


def world(seed=0, count=600):
    """Points (N, 3) ahead of the robot in the map, and descriptors (N, 32)."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(2, 6, count), rng.uniform(-4, 4, count), rng.uniform(-1.5, 2.5, count)])
    return points, rng.integers(0, 256, (count, 32), dtype=np.uint8)


def signature(number, T_map_base, points, descriptors, *, rng, noise_px=0.0, flips=0.0, unknown=0.0):
    """What a camera on the robot sees of the world: `flips` of the bits of its descriptors turned, `unknown` of the depths."""
    local = (points - T_map_base[:3, 3]) @ T_map_base[:3, :3]
    camera = (local - T_BASE_CAMERA[:3, 3]) @ T_BASE_CAMERA[:3, :3]
    ahead = np.flatnonzero(camera[:, 2] > 0.3)
    pixels = CAMERA.project(camera[ahead])
    rows = ahead[((pixels >= 0) & (pixels < (640, 480))).all(axis=1)]
    rows = rng.permutation(rows)
    camera, count = camera[rows], len(rows)
    pixels = CAMERA.project(camera)
    right = pixels[:, 0] - CAMERA.bf / camera[:, 2] + noise_px * rng.normal(size=count)
    pixels = pixels + noise_px * rng.normal(size=(count, 2))
    right[rng.uniform(size=count) < unknown] = np.nan
    depth = CAMERA.bf / (pixels[:, 0] - right)
    seen = CAMERA.back_project(pixels, depth) @ T_BASE_CAMERA[:3, :3].T + T_BASE_CAMERA[:3, 3]
    mask = np.packbits(rng.uniform(size=(count, 256)) < flips, axis=1)
    features = Features(
        pixels=pixels, octaves=np.zeros(count, np.int64), angles=np.zeros(count), responses=np.ones(count),
        descriptors=descriptors[rows] ^ mask, sigmas=np.ones(count), right=right, depth=depth, raw_pixels=pixels,
    )  # fmt: skip
    return Signature(
        id=number, map_id=0, stamp_ns=number * 10**9, T_odom_base=T_map_base, features=features, points=seen,
        word_ids=np.zeros(count, np.int64),
    )  # fmt: skip


def error(T, truth):
    """Vector (6,) of the error as `Registration.covariance` means it."""
    return np.concatenate([T[:3, 3] - truth[:3, 3], Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).as_rotvec()])
