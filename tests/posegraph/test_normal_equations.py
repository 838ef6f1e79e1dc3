# SPDX-License-Identifier: MIT
"""Sparse normal equations against a naive dense twin."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.posegraph.normal_equations import NormalEquations, components

pytestmark = pytest.mark.kernels


def naive_normal_matrix(count, variables, jacobians, residuals, weights):
    """The dense J'WJ (3V, 3V) and J'Wr (3V,) of one group."""
    dense = np.zeros((len(variables), jacobians.shape[1], count, 3))
    for n, row in enumerate(variables):
        for k, variable in enumerate(row):
            if variable >= 0:
                dense[n, :, variable] += jacobians[n, :, 3 * k : 3 * k + 3]
    flat = dense.reshape(len(variables) * jacobians.shape[1], 3 * count)
    scale = np.repeat(weights, jacobians.shape[1])
    return flat.T @ (scale[:, None] * flat), flat.T @ (scale * residuals.ravel())


def random_group(rng, count, edges, size, width):
    variables = rng.integers(-1, count, size=(edges, width))
    return variables, rng.normal(size=(edges, size, 3 * width)), rng.normal(size=(edges, size)), rng.random(edges)


@pytest.mark.parametrize("seed", range(5))
def test_solutions_are_those_of_the_dense_matrix(seed):
    rng = np.random.default_rng(seed)
    count = 25
    held = rng.random(count) < 0.2
    groups = [random_group(rng, count, 60, 3, 2), random_group(rng, count, 30, 6, 3)]
    equations = NormalEquations(held, [group[0] for group in groups])
    for i, (_, jacobians, residuals, weights) in enumerate(groups):
        equations.add(i, jacobians, residuals, weights)
    parts = [naive_normal_matrix(count, *group) for group in groups]
    matrix, gradient = sum(p[0] for p in parts), sum(p[1] for p in parts)
    free = (equations.variables[:, None] * 3 + np.arange(3)).ravel()
    assert sorted(equations.variables) == np.flatnonzero(~held).tolist()
    np.testing.assert_allclose(equations.gradient.ravel(), gradient[free], atol=1e-12)
    assert equations.factorise(np.full((len(equations.variables), 3), 0.5))
    dense = matrix[np.ix_(free, free)] + 0.5 * np.eye(len(free))
    solved = equations.solve(equations.gradient)
    np.testing.assert_allclose(solved.ravel(), np.linalg.solve(dense, gradient[free]), atol=1e-10)
    inverse = np.linalg.inv(dense).reshape(len(free) // 3, 3, -1, 3)
    np.testing.assert_allclose(equations.inverse_columns(2), inverse[:, :, 2], atol=1e-10)
    diagonal = np.einsum("iaib->iab", inverse)
    np.testing.assert_allclose(equations.inverse_diagonal(), diagonal, atol=1e-10)


def test_sums_start_again():
    rng = np.random.default_rng(0)
    variables, jacobians, residuals, weights = random_group(rng, 5, 9, 3, 2)
    equations = NormalEquations(np.zeros(5, bool), [variables])
    equations.add(0, jacobians, residuals, weights)
    once = equations.gradient.copy()
    equations.clear()
    equations.add(0, jacobians, residuals, weights)
    np.testing.assert_array_equal(equations.gradient, once)


def test_a_matrix_that_is_not_positive_definite_is_said():
    equations = NormalEquations(np.zeros(2, bool), [np.array([[0, 1]])])
    equations.add(0, np.ones((1, 1, 6)), np.ones((1, 1)), np.ones(1))
    assert not equations.factorise(np.zeros((2, 3)))
    assert equations.factorise(np.ones((2, 3)))


def test_the_factor_of_a_chain_with_a_hub_stays_sparse():
    nodes = np.arange(1, 400)
    chain = np.stack([nodes[:-1], nodes[1:]], axis=1)
    hub = np.stack([np.zeros_like(nodes), nodes], axis=1)
    equations = NormalEquations(np.zeros(400, bool), [chain, hub])
    assert equations.fill <= 2 * 400


def test_components_are_numbered_in_order():
    assert components(6, [np.array([[0, 2], [4, 5]]), np.array([[-1, 2, 3]])]).tolist() == [0, 1, 0, 0, 2, 2]
    assert components(2, []).tolist() == [0, 1]
