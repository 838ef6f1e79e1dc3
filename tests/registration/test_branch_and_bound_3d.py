# SPDX-License-Identifier: MIT
"""Branch and bound in space finds what an exhaustive search finds; histograms tell rotations apart."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from slamcli.geometry import quaternion, se3
from slamcli.grids.hybrid_blocks import HybridBlocks
from slamcli.registration.branch_and_bound_3d import CloudForSearch, Found3D, Search3D, SubmapSearch3D
from slamcli.registration.rotational_histogram import rotate_histogram, rotation_scores, rotational_histogram

pytestmark = pytest.mark.kernels
UP = np.array([0.0, 0.0, 0.0, 1.0])


def l_room(n=2500, seed=0):
    """Points on floor and walls of a room with one oblique wall, so that no turn maps it onto itself."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.uniform(-3, 3, n), rng.uniform(-2, 2, n), rng.uniform(0, 2, n)
    t = rng.uniform(0, 1, n)
    return np.concatenate(
        [
            np.column_stack([a, b, np.zeros(n)]),
            np.column_stack([a, np.full(n, -2.0), c]),
            np.column_stack([np.full(n, -3.0), b, c]),
            np.column_stack([1 + 2 * t, 2 - 1.2 * t, c]),
        ]
    )


def cloud_of(points, histogram_size=60):
    return CloudForSearch(
        high_points_m=points,
        low_points_m=points[::2],
        rotational_histogram=rotational_histogram(points, histogram_size),
        gravity_alignment_xyzw=UP,
    )


@pytest.fixture(scope="module")
def grids():
    high, low = HybridBlocks(0.1), HybridBlocks(0.45)
    for seed in range(8):
        for grid in (high, low):
            grid.insert(np.array([0.0, 0.0, 1.0]), l_room(seed=seed), 0.6, 0.49, 2)
    return high, low


def searcher(grids, **more):
    options = {
        "branch_and_bound_depth": 4, "full_resolution_depth": 2, "linear_xy_search_window": 0.6, "linear_z_search_window": 0.2,
        "angular_search_window": 0.1, "min_rotational_score": 0.0, "min_low_resolution_score": 0.0,
    }  # fmt: skip
    high, low = (grid.record() for grid in grids)
    return SubmapSearch3D(high, low, rotational_histogram(l_room(), 60), Search3D(**{**options, **more}))


def seen_from(T, points):
    return (points - T[:3, 3]) @ T[:3, :3]


def naive_best(high, points, T_initial, angles, xy, z):
    """The best mean probability of all turns and whole-cell shifts, cells rounded as the search rounds them."""
    best = -1.0
    for angle in angles:
        R = quaternion.to_matrix(quaternion.from_yaw(angle)) @ T_initial[:3, :3]
        cells = np.floor((points @ R.T + T_initial[:3, 3]) / 0.1 + 0.5).astype(np.int64)
        for shift in itertools.product(range(-xy, xy + 1), range(-xy, xy + 1), range(-z, z + 1)):
            best = max(best, float(high.probabilities(cells + np.array(shift)).mean()))
    return best


@pytest.mark.parametrize("depth", [1, 3, 5])
def test_the_best_score_is_that_of_the_exhaustive_search(grids, depth):
    search = searcher(grids, branch_and_bound_depth=depth, full_resolution_depth=min(2, depth))
    true = se3.from_position_quaternion([0.3, -0.2, 0.1], quaternion.from_yaw(0.05))
    points = seen_from(true, l_room(20, seed=11))
    found = search.match(cloud_of(points), np.eye(4), 0.2)
    assert isinstance(found, Found3D)
    expected = naive_best(grids[0], points, np.eye(4), search._angles(points, 0.1), 6, 2)
    # Probabilities are rounded to 1/255 of their range.
    assert found.score == pytest.approx(expected, abs=0.8 / 255)
    assert np.linalg.norm(found.T_submap_node[:3, 3] - true[:3, 3]) < 0.15


def test_a_pose_is_found_anywhere_in_the_submap(grids):
    search = searcher(grids, branch_and_bound_depth=6, min_rotational_score=0.6, linear_z_search_window=0.3)
    true = se3.from_position_quaternion([1.2, 0.7, 0.0], quaternion.from_yaw(2.2))
    points = seen_from(true, l_room(60, seed=12))
    found = search.match_anywhere(cloud_of(points), np.eye(4), 0.4)
    assert isinstance(found, Found3D)
    assert np.linalg.norm(found.T_submap_node[:3, 3] - true[:3, 3]) < 0.15
    turn = found.T_submap_node[:3, :3] @ true[:3, :3].T
    assert abs(math.atan2(turn[1, 0], turn[0, 0])) < 0.06


def test_each_bound_gives_its_reason(grids):
    points = seen_from(np.eye(4), l_room(40, seed=13))
    assert (
        searcher(grids, min_rotational_score=1.0).match(cloud_of(points), np.eye(4), 0.3).startswith("rotational score")
    )
    assert (
        searcher(grids, min_low_resolution_score=0.95).match(cloud_of(points), np.eye(4), 0.3) == "low-resolution score"
    )
    assert searcher(grids).match(cloud_of(points + 100.0), np.eye(4), 0.3) == "score"
    assert searcher(grids).match(cloud_of(np.zeros((0, 3))), np.eye(4), 0.3) == "no points"


def naive_histogram(points, size):
    out = np.zeros(size)
    for layer in np.unique(np.floor(points[:, 2] / 0.2 + 0.5)):
        rows = points[np.floor(points[:, 2] / 0.2 + 0.5) == layer, :2]
        around = rows - rows.mean(axis=0)
        last = None
        for i in np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable"):
            if np.linalg.norm(around[i]) < 0.2:
                continue
            if last is None:
                last = rows[i]
                continue
            step = rows[i] - last
            length = np.linalg.norm(step)
            if length > 0.9:
                last = rows[i]
            elif length >= 0.2:
                weight = 1 - abs(step @ around[i]) / (length * np.linalg.norm(around[i]))
                out[min(int(size * (math.atan2(step[1], step[0]) % math.pi) / math.pi), size - 1)] += max(0.0, weight)
    return out


def test_histograms_equal_the_naive_twin():
    points = l_room(150, seed=3)
    np.testing.assert_allclose(rotational_histogram(points, 36), naive_histogram(points, 36), rtol=1e-5, atol=1e-6)
    assert rotational_histogram(np.zeros((0, 3)), 5).tolist() == [0.0] * 5


def test_the_turn_of_a_cloud_is_that_with_the_best_score():
    size = 90
    points = l_room(800, seed=4)
    R = quaternion.to_matrix(quaternion.from_yaw(-0.5))
    angles = np.linspace(-1.2, 1.2, 121)
    scores = rotation_scores(rotational_histogram(points, size), rotational_histogram(points @ R.T, size), angles)
    assert angles[int(np.argmax(scores))] == pytest.approx(0.5, abs=0.05)
    spike = np.zeros(size, dtype=np.float32)
    spike[10] = 1.0
    turned = rotate_histogram(spike, math.pi / size * 7)
    assert int(np.argmax(turned)) == 17
    assert turned.sum() == pytest.approx(1.0)
