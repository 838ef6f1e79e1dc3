# SPDX-License-Identifier: MIT
"""Rigid transforms as float64 matrices (..., 4, 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.geometry import quaternion

Transforms = NDArray[np.float64]


def from_position_quaternion(position: ArrayLike, quat_xyzw: ArrayLike) -> Transforms:
    """Return transforms (..., 4, 4) from positions (..., 3), metres, and unit quaternions (..., 4)."""
    position = np.asarray(position, dtype=np.float64)
    T = np.zeros((*position.shape[:-1], 4, 4))
    T[..., :3, :3] = quaternion.to_matrix(quat_xyzw)
    T[..., :3, 3] = position
    T[..., 3, 3] = 1.0
    return T


def from_rotation_translation(rotation: ArrayLike, translation: ArrayLike) -> Transforms:
    """Return transforms (..., 4, 4) from rotation matrices (..., 3, 3) and translations (..., 3)."""
    rotation = np.asarray(rotation, dtype=np.float64)
    T = np.zeros((*rotation.shape[:-2], 4, 4))
    T[..., :3, :3] = rotation
    T[..., :3, 3] = translation
    T[..., 3, 3] = 1.0
    return T


def inverse(T_a_b: ArrayLike) -> Transforms:
    """Return ``T_b_a`` (..., 4, 4)."""
    T = np.asarray(T_a_b, dtype=np.float64)
    rotation = np.swapaxes(T[..., :3, :3], -1, -2)
    return from_rotation_translation(rotation, -(rotation @ T[..., :3, 3:])[..., 0])


def to_position_quaternion(T_a_b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions (..., 3), metres, and quaternions xyzw (..., 4)."""
    T = np.asarray(T_a_b, dtype=np.float64)
    return T[..., :3, 3].copy(), quaternion.from_matrix(T[..., :3, :3])


def from_se2(pose: ArrayLike) -> Transforms:
    """Return transforms (..., 4, 4) of planar poses (..., 3) x, y, yaw."""
    pose = np.asarray(pose, dtype=np.float64)
    position = np.concatenate([pose[..., :2], np.zeros_like(pose[..., :1])], axis=-1)
    return from_position_quaternion(position, quaternion.from_yaw(pose[..., 2]))


def to_se2(T_a_b: ArrayLike) -> NDArray[np.float64]:
    """Return planar poses (..., 3) x, y, yaw: height, roll and pitch are left out."""
    T = np.asarray(T_a_b, dtype=np.float64)
    return np.stack([T[..., 0, 3], T[..., 1, 3], np.arctan2(T[..., 1, 0], T[..., 0, 0])], axis=-1)
