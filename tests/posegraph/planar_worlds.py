# SPDX-License-Identifier: MIT
"""Exact graphs in the plane, and how they are disturbed."""

from __future__ import annotations

import numpy as np

from slamcli.posegraph.planar import PlanarEdges


def wrap(angle):
    return np.remainder(np.asarray(angle) + np.pi, 2 * np.pi) - np.pi


def seen_from(observer, seen):
    """Poses (N, 3) of the seen in the frame of the observer."""
    c, s = np.cos(observer[:, 2]), np.sin(observer[:, 2])
    d = seen[:, :2] - observer[:, :2]
    yaw = wrap(seen[:, 2] - observer[:, 2])
    return np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], yaw], axis=1)


def edges(first, second, measured, translation=10.0, rotation=20.0, robust=False, **more):
    first, second = np.asarray(first, np.int64), np.asarray(second, np.int64)
    full = {"translation_weight": translation, "rotation_weight": rotation}
    weights = {name: np.broadcast_to(np.float64(value), (len(first),)).copy() for name, value in full.items()}
    robust = np.broadcast_to(np.asarray(robust), (len(first),)).copy()
    return PlanarEdges(first=first, second=second, measured=np.asarray(measured), robust=robust, **weights, **more)


def ring(nodes=60, seed=0, translation_sigma=0.02, rotation_sigma=0.01, loops=20):
    """Truth (P, 3), a start by dead reckoning, and noisy edges of a chain around a circle with loops; pose 0 is at 0."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 4 * np.pi, nodes)
    truth = np.stack([5 * np.sin(angle), 5 - 5 * np.cos(angle), wrap(angle)], axis=1)
    first = np.concatenate([np.arange(nodes - 1), rng.integers(0, nodes // 2, loops)])
    second = np.concatenate([np.arange(1, nodes), rng.integers(nodes // 2, nodes, loops)])
    measured = seen_from(truth[first], truth[second])
    measured += rng.normal(size=measured.shape) * [translation_sigma, translation_sigma, rotation_sigma]
    start = truth.copy()
    for i in range(1, nodes):
        c, s = np.cos(start[i - 1, 2]), np.sin(start[i - 1, 2])
        x, y, yaw = measured[i - 1]
        start[i] = start[i - 1] + [c * x - s * y, s * x + c * y, yaw]
    return truth, start, first, second, measured
