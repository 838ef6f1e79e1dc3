# SPDX-License-Identifier: MIT
"""Matching of stamps against its naive twin, and what is told where nothing matches."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.errors import EstimationError, UsageError
from slamcli.trajectory import Trajectory, associate, match_stamps, seconds

S = 10**9


def naive(stamps, others, max_diff):
    """For each stamp look at all others."""
    kept, partners = [], []
    ordered = all(a <= b for a, b in itertools.pairwise(others))
    for i, stamp in enumerate(stamps):
        differences = [abs(other - stamp) for other in others]
        least = min(differences)
        if least <= max_diff:
            j = differences.index(least)
            if ordered:  # of equal stamps the last one
                j = max(k for k, other in enumerate(others) if other == others[j])
                later = [k for k, d in enumerate(differences) if d == least and others[k] > others[j]]
                j = later[0] if later and others[j] > stamp else j
                if others[j] > stamp:  # above: the first of equal ones
                    j = others.index(others[j])
            kept.append(i)
            partners.append(j)
    return kept, partners


numbers = st.lists(st.integers(0, 40).map(lambda i: i / 8), min_size=1, max_size=30)


@settings(max_examples=400, deadline=None)
@given(numbers, numbers, st.sampled_from([0.0, 0.125, 0.25, 1.0, 10.0]), st.booleans())
def test_equals_the_naive_search(stamps, others, max_diff, ordered):
    others = sorted(others) if ordered else others
    kept, partners = match_stamps(stamps, others, max_diff)
    assert (kept.tolist(), partners.tolist()) == tuple(naive(stamps, others, max_diff))


def trajectory(stamps_s, x=None):
    n = len(stamps_s)
    poses = np.zeros((n, 3))
    poses[:, 0] = np.arange(n) if x is None else x
    return Trajectory.from_se2(np.round(np.asarray(stamps_s) * S).astype(np.int64), poses)


def test_the_sparser_one_keeps_its_poses():
    dense, sparse = trajectory(np.arange(100) / 100), trajectory([0.104, 0.5, 0.996, 5.0])
    for reference, estimate in [(dense, sparse), (sparse, dense)]:
        matched = associate(reference, estimate)
        assert len(matched) == 3
        found = matched.reference if reference is dense else matched.estimate
        assert found.positions_m[:, 0].tolist() == [10, 50, 99]
        assert (matched.num_reference, matched.num_estimate) == (len(reference), len(estimate))


def test_offset_is_added_to_the_estimate():
    reference, estimate = trajectory(np.arange(10)), trajectory(np.arange(10) - 2.5)
    assert len(associate(reference, estimate, offset_s=2.5)) == 10
    assert len(associate(trajectory(np.arange(20)), estimate, offset_s=2.5)) == 10
    with pytest.raises(EstimationError, match="allow a larger difference"):
        associate(reference, estimate)


def test_interpolation_gives_the_denser_one_the_other_ones_stamps():
    reference, estimate = trajectory(np.arange(11)), trajectory([2.25, 7.5], x=[0, 0])
    matched = associate(reference, estimate, max_diff_s=1, method="interpolation")
    np.testing.assert_allclose(matched.reference.positions_m[:, 0], [2.25, 7.5])
    assert matched.reference.stamps_ns.tolist() == estimate.stamps_ns.tolist()


def test_nothing_matches_is_explained():
    a = trajectory(np.arange(10) + 1.7e9)
    with pytest.raises(EstimationError, match="do not overlap"):
        associate(a, trajectory(np.arange(10) + 1.6e9))
    with pytest.raises(EstimationError, match="factor of 1e"):
        associate(a, replace(a, stamps_ns=a.stamps_ns // 1000))


def test_poses_without_stamps_are_paired_by_number():
    a, b = (replace(trajectory(np.arange(n)), timed=False) for n in (5, 6))
    assert len(associate(a, a)) == 5
    with pytest.raises(UsageError, match="must be as many"):
        associate(a, b)
    mixed = associate(trajectory(np.arange(5) + 7), a)
    assert mixed.estimate.stamps_ns[0] == 7 * S
    assert mixed.estimate.timed


def test_seconds_are_the_nearest_double():
    rng = np.random.default_rng(0)
    stamps = np.concatenate([rng.integers(10**18, 2 * 10**18, 2000), rng.integers(-(10**12), 10**12, 2000)])
    for stamp, value in zip(stamps.tolist(), seconds(stamps).tolist(), strict=True):
        sign = "-" if stamp < 0 else ""
        assert value == float(f"{sign}{abs(stamp) // S}.{abs(stamp) % S:09d}")
