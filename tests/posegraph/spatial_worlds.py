# SPDX-License-Identifier: MIT
"""Exact graphs in space, with scipy's rotations for a second opinion, and what an IMU says along them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.posegraph.spatial import SpatialEdges


def pose(position, rotation_vector):
    return np.concatenate([position, Rotation.from_rotvec(rotation_vector).as_quat()])


def seen_from(observer, seen):
    """Poses (N, 7) of the seen in the frame of the observer."""
    inverse = Rotation.from_quat(observer[:, 3:]).inv()
    turn = inverse * Rotation.from_quat(seen[:, 3:])
    return np.concatenate([inverse.apply(seen[:, :3] - observer[:, :3]), turn.as_quat()], axis=1)


def disturbed(poses, rng, translation, rotation):
    """Poses moved by random translations, and turned about their own axes."""
    turn = Rotation.from_quat(poses[:, 3:]) * Rotation.from_rotvec(rng.normal(size=(len(poses), 3)) * rotation)
    return np.concatenate([poses[:, :3] + rng.normal(size=(len(poses), 3)) * translation, turn.as_quat()], axis=1)


def random_poses(rng, count, spread=2.0):
    rotations = Rotation.from_rotvec(rng.normal(size=(count, 3)))
    return np.concatenate([rng.normal(size=(count, 3)) * spread, rotations.as_quat()], axis=1)


def edges(first, second, measured, translation=10.0, rotation=20.0, robust=False, **more):
    first, second = np.asarray(first, np.int64), np.asarray(second, np.int64)
    full = {"translation_weight": translation, "rotation_weight": rotation}
    weights = {name: np.broadcast_to(np.float64(value), (len(first),)).copy() for name, value in full.items()}
    robust = np.broadcast_to(np.asarray(robust), (len(first),)).copy()
    return SpatialEdges(first=first, second=second, measured=np.array(measured), robust=robust, **weights, **more)


def helix(nodes=50, seed=0, translation_sigma=0.02, rotation_sigma=0.01, loops=20):
    """Truth (P, 7), a disturbed start, and noisy edges of a chain up a helix with loops."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 4 * np.pi, nodes)
    turn = Rotation.from_euler("ZYX", np.stack([angle, 0.2 * np.sin(angle), 0.1 * np.cos(angle)], axis=1))
    position = np.stack([5 * np.cos(angle), 5 * np.sin(angle), 0.2 * angle], axis=1)
    truth = np.concatenate([position, turn.as_quat()], axis=1)
    first = np.concatenate([np.arange(nodes - 1), rng.integers(0, nodes // 2, loops)])
    second = np.concatenate([np.arange(1, nodes), rng.integers(nodes // 2, nodes, loops)])
    measured = disturbed(seen_from(truth[first], truth[second]), rng, translation_sigma, rotation_sigma)
    start = disturbed(truth, rng, 0.2, 0.1)
    start[0] = truth[0]
    return truth, start, first, second, measured


def rotation_errors(poses, truth):
    return (Rotation.from_quat(poses[:, 3:]).inv() * Rotation.from_quat(truth[:, 3:])).magnitude()


class Ride:
    """A smooth ride with known poses, and what an IMU mounted with `mount` feels."""

    def __init__(self, mount=(0.0, 0.0, 0.0), gravity=9.80665):
        self.mount, self.gravity = Rotation.from_rotvec(mount), gravity

    def position(self, t):
        return np.stack([2 * np.sin(0.7 * t), 1.5 * np.cos(0.9 * t), 0.3 * np.sin(1.3 * t)], axis=-1)

    def acceleration(self, t):
        return np.stack([-0.98 * np.sin(0.7 * t), -1.215 * np.cos(0.9 * t), -0.507 * np.sin(1.3 * t)], axis=-1)

    def rotation(self, t):
        return Rotation.from_euler("ZYX", np.stack([0.5 * t, 0.2 * np.sin(t), 0.15 * np.cos(1.1 * t)], axis=-1))

    def poses(self, t):
        return np.concatenate([self.position(t), self.rotation(t).as_quat()], axis=-1)

    def imu(self, t):
        """Angular rates and specific forces (N, 3) in the sensor's axes."""
        step = 1e-5
        rates = (self.rotation(t - step).inv() * self.rotation(t + step)).as_rotvec() / (2 * step)
        forces = self.rotation(t).inv().apply(self.acceleration(t) + np.array([0, 0, self.gravity]))
        return self.mount.inv().apply(rates), self.mount.inv().apply(forces)
