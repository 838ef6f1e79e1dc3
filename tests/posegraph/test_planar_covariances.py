# SPDX-License-Identifier: MIT
"""Covariances of planar graphs against the dense inverse, and against what random graphs show."""

from __future__ import annotations

import numpy as np
import planar_worlds as worlds
import pytest

from slamcli.errors import EstimationError
from slamcli.posegraph import planar
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar_covariances import PlanarCovariances, relative_covariances

pytestmark = pytest.mark.kernels


def dense_inverse(poses, edges, held):
    """The inverse of the normal matrix (F, 3, F, 3) with one pose held, and the free poses."""
    term = planar.terms_of(edges, Loss())
    jacobian = np.zeros((len(edges), 3, len(poses), 3))
    for n, row in enumerate(term.variables):
        for k in (0, 2):
            jacobian[n, :, row[k]] += term.jacobians(poses)[n, :, 3 * k : 3 * k + 3]
    free = [i for i in range(len(poses)) if i != held]
    flat = jacobian[:, :, free].reshape(3 * len(edges), -1)
    return np.linalg.inv(flat.T @ flat).reshape(len(free), 3, len(free), 3), free


@pytest.fixture
def graph():
    _, start, first, second, measured = worlds.ring(nodes=12, loops=4)
    return start, worlds.edges(first, second, measured)


def test_marginals_are_blocks_of_the_inverse(graph):
    poses, edges = graph
    inverse, free = dense_inverse(poses, edges, 2)
    found = PlanarCovariances(poses, np.arange(12) == 2, edges).marginals
    np.testing.assert_allclose(found[free], np.einsum("iaib->iab", inverse), rtol=1e-8, atol=1e-12)
    np.testing.assert_array_equal(found[2], 0)


@pytest.mark.parametrize("known", [0, 4, 9])
def test_relative_covariances_do_not_depend_on_what_is_held(graph, known):
    poses, edges = graph
    inverse, _ = dense_inverse(poses, edges, 4)
    c, s = np.cos(poses[4, 2]), np.sin(poses[4, 2])
    axes = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    found = PlanarCovariances(poses, np.arange(12) == known, edges).relative(4, np.array([0, 4, 11]))
    np.testing.assert_allclose(found[0], axes @ inverse[0, :, 0] @ axes.T, rtol=1e-7, atol=1e-10)
    np.testing.assert_array_equal(found[1], 0)
    np.testing.assert_allclose(found[2], axes @ inverse[-1, :, -1] @ axes.T, rtol=1e-7, atol=1e-10)


def test_edges_that_do_not_count_are_as_if_they_were_not_there(graph):
    poses, edges = graph
    counts = (np.arange(len(edges)) < 11) * 1.0
    chain = worlds.edges(edges.first[:11], edges.second[:11], edges.measured[:11])
    found = relative_covariances(poses, edges, 3, np.array([8]), weights=counts)
    np.testing.assert_allclose(found, relative_covariances(poses, chain, 3, np.array([8])), rtol=1e-9)


def test_covariances_are_those_of_many_random_graphs():
    step = np.array([[1.0, 0.0, 0.3]])
    edges = worlds.edges(np.arange(4), np.arange(1, 5), np.tile(step, (4, 1)), translation=20.0, rotation=50.0)
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(4000, 4, 3)) * [1 / 20, 1 / 20, 1 / 50]
    ends = np.zeros((4000, 3))
    poses = np.zeros((5, 3))
    for i in range(4):
        poses[i + 1] = poses[i] + [np.cos(poses[i, 2]), np.sin(poses[i, 2]), 0.3]
        x, y, yaw = (step + noise[:, i]).T
        c, s = np.cos(ends[:, 2]), np.sin(ends[:, 2])
        ends += np.stack([c * x - s * y, s * x + c * y, yaw], axis=1)
    found = relative_covariances(poses, edges, 0, np.array([4]))[0]
    np.testing.assert_allclose(found, np.cov(ends.T), rtol=0.1, atol=5e-4)


def test_what_no_edge_connects_has_an_infinite_covariance():
    edges = worlds.edges([0], [1], [[1.0, 0, 0]])
    found = relative_covariances(np.zeros((3, 3)), edges, 0, np.array([2]))
    assert np.all(np.isinf(np.diagonal(found[0])))


def test_fixed_poses_are_known_relative_to_each_other():
    edges = worlds.edges([0, 2], [1, 3], [[1.0, 0, 0]] * 2, translation=10.0)
    poses = np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0]])
    found = PlanarCovariances(poses, np.array([True, False, True, False]), edges).relative(1, np.array([3]))[0]
    assert found[0, 0] == pytest.approx(0.02)


def test_a_pose_that_its_edges_leave_open_is_an_error():
    edges = worlds.edges([0], [1], [[1.0, 0, 0]], rotation=0.0)
    with pytest.raises(EstimationError, match="undetermined"):
        relative_covariances(np.zeros((2, 3)), edges, 0, np.array([1]))
