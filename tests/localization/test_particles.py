# SPDX-License-Identifier: MIT
"""Resampling, bins and groups against naive twins and numbers by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.localization import _particle_kernels as kernels
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.particles import effective_number, estimate, have_converged, resample

pytestmark = pytest.mark.kernels


def naive_bin(pose):
    return (
        math.floor(pose[0] / 0.5),
        math.floor(pose[1] / 0.5),
        math.floor((pose[2] + math.pi) / math.radians(10.0)) % 36,
    )


def naive_groups(poses):
    """Return a label for each pose: bins that touch are one group."""
    bins = list(dict.fromkeys(naive_bin(pose) for pose in poses))
    parent = {b: b for b in bins}

    def root(b):
        while parent[b] != b:
            b = parent[b]
        return b

    for a in bins:
        for b in bins:
            turn = min((a[2] - b[2]) % 36, (b[2] - a[2]) % 36)
            if abs(a[0] - b[0]) <= 1 and abs(a[1] - b[1]) <= 1 and turn <= 1:
                parent[root(a)] = root(b)
    names = {}
    return [names.setdefault(root(naive_bin(pose)), len(names)) for pose in poses]


def naive_limit(k, error, z, least, most):
    if k <= 1:
        return most
    b = 2.0 / (9.0 * (k - 1))
    return min(max(math.ceil((k - 1) / (2.0 * error) * (1.0 - b + math.sqrt(b) * z) ** 3), least), most)


def test_groups_equal_the_naive_twin():
    rng = np.random.default_rng(2)
    centres = np.column_stack([rng.uniform(-8, 8, (12, 2)), rng.uniform(-np.pi, np.pi, 12)])
    poses = centres[rng.integers(12, size=300)] + rng.normal(0, [0.3, 0.3, 0.1], (300, 3))
    poses[:, 2] = np.mod(poses[:, 2] + np.pi, 2 * np.pi) - np.pi
    weights = rng.random(300)
    weights /= weights.sum()
    labels = np.array(naive_groups(poses))
    found = estimate(poses, weights)
    sums = np.bincount(labels, weights)
    assert found.num_groups == len(sums)
    best = labels == sums.argmax()
    w = weights[best]
    assert found.best.weight == pytest.approx(sums.max())
    np.testing.assert_allclose(found.best.mean[:2], w @ poses[best, :2] / w.sum(), atol=1e-9)
    apart = poses[best] - found.best.mean
    apart[:, 2] = np.mod(apart[:, 2] + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(found.best.covariance, (apart.T * w) @ apart / w.sum(), atol=1e-9)


def test_headings_go_round():
    poses = np.array([[0.1, 0.1, math.pi - 0.02], [0.1, 0.1, -math.pi + 0.02]])
    found = estimate(poses, np.full(2, 0.5))
    assert found.num_groups == 1
    assert abs(found.best.mean[2]) == pytest.approx(math.pi)
    assert found.covariance[2, 2] == pytest.approx(0.02**2)


@pytest.mark.parametrize("bins", [0, 1, 2, 3, 10, 50, 400])
def test_the_kld_limit_equals_the_naive_twin(bins):
    assert kernels.kld_limit(bins, 0.01, 0.99, 100, 5000) == naive_limit(bins, 0.01, 0.99, 100, 5000)


def test_kld_by_hand():
    # 2 bins: k - 1 = 1; b = 2/9: 50 * (1 - 2/9 + sqrt(2/9) * 0.99)^3 = 50 * 1.244477^3
    assert kernels.kld_limit(2, 0.01, 0.99, 1, 5000) == math.ceil(50 * (1 - 2 / 9 + math.sqrt(2 / 9) * 0.99) ** 3) == 97


def test_one_place_needs_all_particles_and_few_places_few():
    p, rng = AmclParameters(), np.random.default_rng(0)
    none = np.empty((0, 3))
    alone = resample(np.zeros((10, 3)), np.full(10, 0.1), none, 0.0, p, rng)
    assert len(alone) == 5000  # one bin says nothing about the spread, as in amcl
    poses = np.array([[0.1, 0.1, 0.1], [3.1, 0.1, 0.1]])
    two = resample(poses, np.array([0.5, 0.5]), none, 0.0, p, rng)
    assert len(two) == 101  # one more than the fewest (97 would do)


def test_poses_are_drawn_by_weight():
    poses = np.array([[0.1, 0.0, 0.0], [5.1, 0.0, 0.0], [9.1, 0.0, 0.0]])
    p = AmclParameters(min_particles=5000)
    drawn = resample(poses, np.array([0.2, 0.0, 0.8]), np.empty((0, 3)), 0.0, p, np.random.default_rng(1))
    assert not (drawn[:, 0] == 5.1).any()
    assert (drawn[:, 0] == 9.1).mean() == pytest.approx(0.8, abs=0.02)


def test_others_come_at_their_share():
    p = AmclParameters(min_particles=5000)
    others = np.tile([7.0, 7.0, 0.0], (5000, 1))
    drawn = resample(np.zeros((4, 3)), np.full(4, 0.25), others, 0.3, p, np.random.default_rng(1))
    assert (drawn[:, 0] == 7.0).mean() == pytest.approx(0.3, abs=0.02)


def test_particles_have_converged_within_half_a_metre():
    assert have_converged(np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 3.0]]))
    assert not have_converged(np.array([[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]]))


def test_effective_number():
    assert effective_number(np.array([0.5, 0.5, 0.0, 0.0])) == pytest.approx(2.0)


def test_far_positions_share_a_bin_and_do_not_break_the_table():
    poses = np.array([[1e12, -1e12, 0.0], [1e13, -1e13, 0.0], [0.0, 0.0, 0.0]])
    assert estimate(poses, np.full(3, 1 / 3)).num_groups == 2
