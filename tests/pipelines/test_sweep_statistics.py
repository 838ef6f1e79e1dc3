# SPDX-License-Identifier: MIT
"""Statistics over seeds: whether a difference is more than chance."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import UsageError
from slamcli.pipelines.sweep_objective import DEFAULTS, WITHOUT_TRUTH, find_figure, find_objective
from slamcli.pipelines.sweep_statistics import Spread, compare, mean_ranks

NAN = math.nan


def test_spread_counts_failures_and_takes_quartiles_of_the_rest():
    spread = Spread.of([3.0, 1.0, NAN, 2.0, 5.0, 4.0])
    assert (spread.count, spread.failed) == (5, 1)
    assert (spread.median, spread.lower, spread.upper, spread.minimum, spread.maximum) == (3.0, 2.0, 4.0, 1.0, 5.0)
    assert spread.failure_rate == pytest.approx(1 / 6)
    assert math.isnan(Spread.of([NAN]).median)


def test_six_pairs_can_show_a_difference_and_five_cannot():
    base = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02])
    six, five = compare(base - 0.3, base, maximise=False), compare(base[:5] - 0.3, base[:5], maximise=False)
    assert (six.verdict, six.better_in, six.worse_in) == ("better", 6, 0)
    assert six.p_value == pytest.approx(2 / 64)
    assert six.median == pytest.approx(-0.3)
    assert five.verdict == "likely better"
    assert five.p_value == pytest.approx(2 / 32)
    assert compare(base - 0.3, base, maximise=True).verdict == "worse"


def test_what_seeds_do_as_well_is_within_the_spread():
    rng = np.random.default_rng(3)
    base, other = rng.normal(1.0, 0.1, 12), rng.normal(1.0, 0.1, 12)
    found = compare(other, base, maximise=False)
    assert found.verdict == "within the spread"
    assert found.low < 0 < found.high


def test_the_interval_holds_what_it_says():
    rng = np.random.default_rng(5)
    inside = [
        found.low <= 0.2 <= found.high
        for _ in range(200)
        for found in [compare(1.2 + rng.normal(0, 0.1, 15), 1.0 + rng.normal(0, 0.1, 15), maximise=False)]
    ]
    assert 0.88 < np.mean(inside) <= 1.0


def test_the_sign_test_is_the_binomial_sum():
    base = np.zeros(10)
    values = np.array([-1.0] * 8 + [1.0] * 2)
    expected = 2 * sum(math.comb(10, k) for k in range(3)) / 2**10
    assert compare(values, base, maximise=False).p_value == pytest.approx(expected)


@pytest.mark.parametrize(
    ("values", "base", "verdict"),
    [
        ([1.0], [2.0], "one run"),
        ([2.0], [2.0], "same"),
        ([1.0, 1.0], [2.0, 2.0], "better"),
        ([2.0, 2.0], [2.0, 2.0], "same"),
        ([NAN, NAN], [2.0, 2.0], "no value"),
        ([1.0, NAN], [2.0, 1.0], "one run"),
    ],
)
def test_few_pairs(values, base, verdict):
    assert compare(values, base, maximise=False).verdict == verdict


def test_ranks_share_ties_and_put_failures_last():
    assert mean_ranks([[3.0, 1.0, 1.0, NAN]], maximise=False) == [3.0, 1.5, 1.5, 4.0]
    assert mean_ranks([[3.0, 1.0, 2.0], [9.0, 7.0, 8.0]], maximise=True) == [1.0, 3.0, 2.0]


@pytest.mark.parametrize(
    ("key", "asked", "maximise"),
    [
        ("ate.rmse", None, False),
        ("map.f_score", None, True),
        ("map.mean_entropy", None, False),
        ("scan.near", None, True),
        ("coverage.poses", None, True),
        ("time.realtime_factor", None, True),
        ("time.total_s", None, False),
        ("peak_memory_bytes", None, False),
        ("relations.trans.mean", None, False),
        ("summary.keyframes", None, False),
        ("summary.keyframes", True, True),
    ],
)
def test_the_direction_of_a_figure(key, asked, maximise):
    assert find_objective(key, asked).maximise is maximise


def test_the_docs_name_what_is_ranked_by():
    page = (Path(__file__).resolve().parents[2] / "docs" / "sweep.md").read_text()
    for key in (*DEFAULTS.values(), WITHOUT_TRUTH):
        assert f"`{key}`, {find_objective(key, None).direction} first" in page


def test_a_direction_that_is_known_cannot_be_turned_round():
    with pytest.raises(UsageError, match="smaller it is"):
        find_objective("ate.rmse", True)


def test_a_figure_that_is_not_there_is_named_with_the_nearest():
    with pytest.raises(UsageError, match=r"did you mean ate\.rmse"):
        find_figure("ate.rsme", {"ate.rmse": 1.0, "rpe.rmse": 2.0})
