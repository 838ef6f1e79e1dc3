# SPDX-License-Identifier: MIT
"""Unit quaternions as float64 arrays (..., 4) in the order x, y, z, w (as ROS and TUM files write them)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Quaternions = NDArray[np.float64]


def normalise(quat_xyzw: ArrayLike) -> Quaternions:
    """Return quaternions of length one; a zero quaternion (an unset ROS field) becomes the identity."""
    quat = np.array(quat_xyzw, dtype=np.float64)
    largest = np.abs(quat).max(axis=-1, keepdims=True, initial=0.0)
    quat = np.where(largest > 1e100, quat / np.where(largest > 0, largest, 1.0), quat)  # whose square would overflow
    norm = np.linalg.norm(quat, axis=-1, keepdims=True)
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    return np.where(norm > 1e-12, quat / np.where(norm > 1e-12, norm, 1.0), identity)


def from_yaw(yaw: ArrayLike) -> Quaternions:
    """Return the rotations by `yaw` radians about z, (..., 4)."""
    half = np.asarray(yaw, dtype=np.float64) / 2
    zero = np.zeros_like(half)
    return np.stack([zero, zero, np.sin(half), np.cos(half)], axis=-1)


def yaw(quat_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Return the yaw (rotation about z, roll-pitch-yaw order) in radians, (...,)."""
    x, y, z, w = np.moveaxis(np.asarray(quat_xyzw, dtype=np.float64), -1, 0)
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def from_roll_pitch_yaw(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Quaternions:
    """Return the rotations ``Rz(yaw) Ry(pitch) Rx(roll)`` (fixed axes, as URDF and ROS use), (..., 4)."""
    cr, sr = np.cos(np.asarray(roll) / 2), np.sin(np.asarray(roll) / 2)
    cp, sp = np.cos(np.asarray(pitch) / 2), np.sin(np.asarray(pitch) / 2)
    cy, sy = np.cos(np.asarray(yaw) / 2), np.sin(np.asarray(yaw) / 2)
    return np.stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ],
        axis=-1,
    )


def to_roll_pitch_yaw(quat_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Return roll, pitch and yaw in radians, (..., 3), inverse of :func:`from_roll_pitch_yaw`."""
    x, y, z, w = np.moveaxis(np.asarray(quat_xyzw, dtype=np.float64), -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch, np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))], axis=-1)


def multiply(a_xyzw: ArrayLike, b_xyzw: ArrayLike) -> Quaternions:
    """Return the Hamilton products ``a * b`` (first b, then a), (..., 4)."""
    ax, ay, az, aw = np.moveaxis(np.asarray(a_xyzw, dtype=np.float64), -1, 0)
    bx, by, bz, bw = np.moveaxis(np.asarray(b_xyzw, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def conjugate(quat_xyzw: ArrayLike) -> Quaternions:
    """Return the inverse rotations, (..., 4)."""
    return np.asarray(quat_xyzw, dtype=np.float64) * np.array([-1.0, -1.0, -1.0, 1.0])


def rotate(quat_xyzw: ArrayLike, vectors: ArrayLike) -> NDArray[np.float64]:
    """Return vectors (..., 3) rotated by quaternions (..., 4)."""
    quat, v = np.asarray(quat_xyzw, dtype=np.float64), np.asarray(vectors, dtype=np.float64)
    u, w = quat[..., :3], quat[..., 3:]
    t = 2 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def to_matrix(quat_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Return rotation matrices (..., 3, 3)."""
    x, y, z, w = np.moveaxis(np.asarray(quat_xyzw, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(rotation: ArrayLike) -> Quaternions:
    """Return quaternions (..., 4) with w >= 0 of rotation matrices (..., 3, 3), stable for every angle (Shepperd 1978)."""
    m = np.asarray(rotation, dtype=np.float64)
    d = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = np.stack(
        [1 + d[0] - d[1] - d[2], 1 - d[0] + d[1] - d[2], 1 - d[0] - d[1] + d[2], 1 + d[0] + d[1] + d[2]], axis=-1
    )
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    e, f, g = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    rows = np.stack(
        [
            np.stack([squares[..., 0], e, f, a], axis=-1),
            np.stack([e, squares[..., 1], g, b], axis=-1),
            np.stack([f, g, squares[..., 2], c], axis=-1),
            np.stack([a, b, c, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)
    quat = normalise(np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :])
    return quat * np.where(quat[..., 3:] < 0, -1.0, 1.0)


def to_rotation_vector(quat_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Return rotation vectors (..., 3), radians, at most pi long, of unit quaternions (..., 4).

    Examples
    --------
    >>> to_rotation_vector(from_yaw(0.5)).round(9).tolist()
    [0.0, 0.0, 0.5]
    """
    q = np.asarray(quat_xyzw, dtype=np.float64)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    factor = np.where(sine > 1e-12, 2.0 * np.arctan2(sine, q[..., 3:]) / np.maximum(sine, 1e-12), 2.0)
    vectors: NDArray[np.float64] = factor * q[..., :3]
    return vectors


def slerp(a_xyzw: ArrayLike, b_xyzw: ArrayLike, fraction: ArrayLike) -> Quaternions:
    """Return rotations a fraction of the shorter way from a to b (Shoemake 1985), (..., 4)."""
    a, b = np.asarray(a_xyzw, dtype=np.float64), np.asarray(b_xyzw, dtype=np.float64)
    t = np.asarray(fraction, dtype=np.float64)[..., None]
    dot = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(dot < 0, -b, b)
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0))
    small = angle < 1e-6
    sine = np.where(small, 1.0, np.sin(angle))
    weight_a = np.where(small, 1 - t, np.sin((1 - t) * angle) / sine)
    weight_b = np.where(small, t, np.sin(t * angle) / sine)
    return normalise(weight_a * a + weight_b * b)
