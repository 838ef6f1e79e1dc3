# SPDX-License-Identifier: MIT
"""Where the adjustment begins: long loops with large drift close, by few iterations."""

from __future__ import annotations

import numpy as np
import planar_worlds as worlds
import pytest

from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import optimise_planar
from slamcli.posegraph.planar_start import start_planar

pytestmark = pytest.mark.kernels


def drifting_loop(drift, nodes=300, loops=10):
    """A loop of 1 km whose dead reckoning turns `drift` radians too far, closed by edges of high weight."""
    angle = np.linspace(0, 2 * np.pi, nodes)
    truth = np.stack([160 * np.sin(angle), 160 * (1 - np.cos(angle)), angle], axis=1)
    first = np.concatenate([np.arange(nodes - 1), np.zeros(loops, int)])
    second = np.concatenate([np.arange(1, nodes), nodes - 1 - np.arange(loops)])
    measured = worlds.seen_from(truth[first], truth[second])
    measured[: nodes - 1, 2] += drift / nodes
    start = truth.copy()
    for i in range(1, nodes):
        c, s = np.cos(start[i - 1, 2]), np.sin(start[i - 1, 2])
        x, y, yaw = measured[i - 1]
        start[i] = start[i - 1] + [c * x - s * y, s * x + c * y, yaw]
    weights = np.where(np.arange(len(first)) < nodes - 1, 100.0, 1e4)
    return truth, start, worlds.edges(first, second, measured, weights, weights)


@pytest.mark.parametrize("drift", [0.3, 1.5, 2.9, -2.9])
def test_a_long_loop_closes_whatever_its_drift(drift):
    truth, poses, edges = drifting_loop(drift)
    fixed = np.arange(len(truth)) == 0
    assert np.hypot(*(poses - truth)[-1, :2]) > 40
    start = start_planar(poses, fixed, edges, loss=Loss())
    np.testing.assert_array_equal(start[0], truth[0])
    assert np.hypot(*(start - truth)[:, :2].T).max() < 1.0
    solution = optimise_planar(start, fixed, edges, loss=Loss(), max_iterations=20)
    assert solution.converged
    assert np.hypot(*(solution.poses - truth)[-1, :2]) < 0.01


def test_from_dead_reckoning_it_takes_many_more():
    truth, poses, edges = drifting_loop(2.9)
    fixed = np.arange(len(truth)) == 0
    far = optimise_planar(poses, fixed, edges, loss=Loss(), max_iterations=50)
    near = optimise_planar(start_planar(poses, fixed, edges, loss=Loss()), fixed, edges, loss=Loss(), max_iterations=50)
    assert near.cost_after < 0.01 * far.cost_after
    assert near.iterations < far.iterations


def test_full_information_is_split_between_headings_and_positions():
    truth, _, first, second, measured = worlds.ring(translation_sigma=0, rotation_sigma=0)
    information = np.tile(np.array([[100.0, 5, 20], [5, 100, 10], [20, 10, 400]]), (len(first), 1, 1))
    edges = worlds.edges(first, second, measured, information=information)
    rng = np.random.default_rng(0)
    poses = truth + rng.normal(size=truth.shape) * [3.0, 3.0, 0.3] * (np.arange(len(truth)) > 0)[:, None]
    start = start_planar(poses, np.arange(len(truth)) == 0, edges, loss=Loss())
    np.testing.assert_allclose(start[:, :2], truth[:, :2], atol=1e-3)


def test_landmarks_and_other_edges_count_as_well():
    truth, _, first, second, measured = worlds.ring(translation_sigma=0, rotation_sigma=0)
    nodes = len(truth)
    chain = worlds.edges(first[: nodes - 1], second[: nodes - 1], measured[: nodes - 1])
    loops = worlds.edges(first[nodes - 1 :], second[nodes - 1 :], measured[nodes - 1 :], 100.0, 100.0)
    bent = truth * [1.1, 0.9, 1.0]
    start = start_planar(bent, np.arange(nodes) == 0, chain, loss=Loss(), more=[(loops, Loss(kind="huber"))])
    np.testing.assert_allclose(start[:, :2], truth[:, :2], atol=1e-3)
