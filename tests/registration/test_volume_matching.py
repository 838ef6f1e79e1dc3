# SPDX-License-Identifier: MIT
"""Matching with 3D probability grids: a naive twin, known motions, and what the weights mean."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from slamcli.geometry import quaternion, se3
from slamcli.grids.hybrid_blocks import HybridBlocks
from slamcli.registration.volume_matching import VolumeMatch, align_with_volumes, mean_probability, search_window

pytestmark = pytest.mark.kernels


def walls(n=1500, seed=0):
    rng = np.random.default_rng(seed)
    a, b, c = rng.uniform(-4, 4, n), rng.uniform(-4, 4, n), rng.uniform(-1, 2, n)
    return np.concatenate(
        [
            np.column_stack([a, b, np.full(n, -1.0)]),
            np.column_stack([a, np.full(n, 4.0), c]),
            np.column_stack([np.full(n, 4.0), b, c]),
        ]
    )


@pytest.fixture(scope="module")
def grids():
    high, low = HybridBlocks(0.1), HybridBlocks(0.45)
    for seed in range(6):
        for grid in (high, low):
            grid.insert(np.zeros(3), walls(seed=seed), 0.7, 0.49, 2)
    return high, low


def settings(**more):
    values = {
        "occupied_space_weight_0": 1.0,
        "occupied_space_weight_1": 6.0,
        "translation_weight": 5.0,
        "rotation_weight": 10.0,
    }
    return VolumeMatch(**{**values, "max_num_iterations": 30, **more})


def test_the_minimum_is_that_of_scipy(grids):
    high, low = grids
    points, coarse = walls(60, seed=9), walls(40, seed=10)
    target = se3.from_position_quaternion([0.06, -0.04, 0.03], quaternion.from_roll_pitch_yaw(0.01, -0.01, 0.02))
    s = settings()

    def naive_residuals(x):
        R, t = target[:3, :3] @ Rotation.from_rotvec(x[3:]).as_matrix(), target[:3, 3] + x[:3]
        turn = Rotation.from_rotvec(x[3:]).as_quat()[:3]
        return np.concatenate(
            [
                s.occupied_space_weight_0 / math.sqrt(len(points)) * (1 - high.interpolate(points @ R.T + t)[0]),
                s.occupied_space_weight_1 / math.sqrt(len(coarse)) * (1 - low.interpolate(coarse @ R.T + t)[0]),
                s.translation_weight * x[:3],
                s.rotation_weight * turn,
            ]
        )

    best = least_squares(naive_residuals, np.zeros(6), xtol=1e-12, ftol=1e-12)
    T, cost = align_with_volumes(points, coarse, high, low, target, target, s)
    assert cost <= best.cost * (1 + 1e-3)
    np.testing.assert_allclose(T[:3, 3], target[:3, 3] + best.x[:3], atol=5e-3)


def test_only_yaw_keeps_roll_and_pitch(grids):
    start = se3.from_position_quaternion([0.05, 0.0, 0.0], quaternion.from_roll_pitch_yaw(0.03, -0.02, 0.05))
    T, _ = align_with_volumes(
        walls(100, 3), walls(60, 4), *grids, start, start, settings(only_optimize_yaw=True, rotation_weight=0.1)
    )
    turn = T[:3, :3] @ start[:3, :3].T
    np.testing.assert_allclose(turn[:, 2], [0.0, 0.0, 1.0], atol=1e-9)
    assert abs(math.atan2(turn[1, 0], turn[0, 0])) > 1e-3


def test_exhaustive_search_finds_a_shift_of_cells_and_a_turn(grids):
    high, _ = grids
    points = walls(70, 5)
    true = se3.from_position_quaternion([0.1, -0.1, 0.1], quaternion.from_roll_pitch_yaw(0.0, 0.0, 0.03))
    seen = (points - true[:3, 3]) @ true[:3, :3]
    found, score = search_window(seen, high, np.eye(4), 0.15, 0.04, (0.1, 0.1))
    assert np.linalg.norm(found[:3, 3] - true[:3, 3]) < 0.06
    assert abs(math.atan2(found[1, 0], found[0, 0]) - 0.03) < 0.02
    assert score > 0.9 * mean_probability(seen, true, high)


def test_mean_probability_is_that_of_the_cells(grids):
    high, _ = grids
    points = np.random.default_rng(0).uniform(-4, 4, (200, 3))
    expected = high.probabilities(np.floor(points / 0.1 + 0.5).astype(np.int64)).mean()
    assert mean_probability(points, np.eye(4), high) == pytest.approx(float(expected), abs=1e-6)
