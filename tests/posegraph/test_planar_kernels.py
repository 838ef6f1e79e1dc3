# SPDX-License-Identifier: MIT
"""Residuals in the plane against a naive twin with matrices."""

from __future__ import annotations

import numpy as np
import planar_worlds as worlds
import pytest

from slamcli.posegraph import _planar_kernels as kernels

pytestmark = pytest.mark.kernels


def naive_residuals(poses, variables, ratios, measured, whitening):
    out = np.empty((len(variables), 3))
    for n, (a, until, b) in enumerate(variables):
        observer = poses[a] + ratios[n] * (poses[until] - poses[a])
        observer[2] = poses[a, 2] + ratios[n] * worlds.wrap(poses[until, 2] - poses[a, 2])
        error = worlds.seen_from(observer[None], poses[b][None])[0] - measured[n]
        error[2] = worlds.wrap(error[2])
        out[n] = whitening[n] @ error
    return out


@pytest.mark.parametrize("count", [0, 1, 50])
def test_residuals_are_those_of_the_naive_twin(count):
    rng = np.random.default_rng(count)
    poses = rng.normal(scale=3, size=(7, 3))
    variables = rng.integers(0, 7, size=(count, 3))
    measured, whitening = rng.normal(scale=2, size=(count, 3)), rng.normal(size=(count, 3, 3))
    ratios = rng.random(count)
    out = np.empty((count, 3))
    kernels.residuals(poses, variables, ratios, measured, whitening, out)
    np.testing.assert_allclose(out, naive_residuals(poses, variables, ratios, measured, whitening), atol=1e-12)


def test_angles_are_taken_the_short_way():
    poses = np.array([[0, 0, 3.1], [0, 0, -3.1]])
    out = np.empty((1, 3))
    kernels.residuals(poses, np.array([[0, 0, 1]]), np.zeros(1), np.zeros((1, 3)), np.eye(3)[None], out)
    assert out[0, 2] == pytest.approx(2 * np.pi - 6.2)
